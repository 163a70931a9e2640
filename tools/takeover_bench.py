"""Takeover and hand-back on real scenarios: who is taken, handed back, arrives, is lost; and how hard SUMO then brakes.

    python tools/takeover_bench.py --json takeover.json                 # the scenarios of the SUMO wheel, everywhere
    python tools/takeover_bench.py --scenarios intersection district --region auto --shares car=0.5,pedestrian=1

Every run is its own process. The wheel's scenarios are games whose signals wait for the player: both the plain run and
the run with takeover switch them every 30 s. See docs/takeover.md.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from slrl_sumo.agent.lane_driver import LaneDriver
from slrl_sumo.scene.geometry import boxes_overlap, wrap_angle
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.takeover import drawn, parse_shares
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario, shipped_scenarios
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl

WHEEL = ("cross", "fkk_in", "grid6")
HARD_BRAKE = 5.0
AFTER = 5.0
RIM = 5.0
GREEN = 30.0
COLUMNS = (
    *("scenario", "step_s", "taken", "handed_back", "arrived_home", "arrived_elsewhere", "still_under_way"),
    *("plain_under_way", "lost", "teleported", "jumps", "overlaps_ours", "plain_overlaps", "hard_brakes_after"),
    *("per_1000_s", "plain_per_1000_s", "driver_ms", "vehicles", "mean_speed", "plain_speed"),
)


def world_of(snapshot: Snapshot, rows: list[int], at: float, learned: bool) -> WorldState:
    none = np.zeros(len(rows))
    return WorldState(
        time=at,
        ids=tuple(snapshot.ids[i] for i in rows),
        type=snapshot.type[rows],
        x=snapshot.x[rows],
        y=snapshot.y[rows],
        heading=snapshot.heading[rows],
        speed=snapshot.speed[rows],
        acceleration=none,
        yaw_rate=none,
        length=snapshot.length[rows],
        width=snapshot.width[rows],
        learned=np.full(len(rows), learned),
    )


def between(a: WorldState, b: WorldState, share: float) -> WorldState:
    turn = wrap_angle(b.heading - a.heading)
    return replace(
        b,
        x=a.x + share * (b.x - a.x),
        y=a.y + share * (b.y - a.y),
        heading=wrap_angle(a.heading + share * turn),
    )


def overlapping(world: WorldState) -> set[tuple[str, str]]:
    """Pairs of vehicles whose boxes, 10 cm smaller all round, overlap."""
    rows = np.flatnonzero(world.type != RoadUserType.PEDESTRIAN)
    if len(rows) < 2:
        return set()
    boxes = np.column_stack([world.x, world.y, world.heading, world.length - 0.2, world.width - 0.2])[rows]
    pairs = cKDTree(boxes[:, :2]).query_pairs(15.0, output_type="ndarray")
    hits = pairs[boxes_overlap(boxes[pairs[:, 0]], boxes[pairs[:, 1]])]
    return {(world.ids[rows[a]], world.ids[rows[b]]) for a, b in hits.tolist()}


def note(*words: Any) -> None:
    """For people who run one case by hand (--name, --step)."""
    print(*words, file=sys.stderr)


class Watch:
    """Counts what becomes of everybody, from outside, step by step."""

    def __init__(self, api: Any, step: float) -> None:
        self.api, self.step = api, step
        self.count: Counter[str] = Counter()
        self.goal: dict[str, tuple[str, np.ndarray, float]] = {}
        self.last: dict[str, tuple[float, float, float, bool]] = {}
        self.given: dict[str, float] = {}
        self.followed: set[str] = set()
        self.overlaps: set[tuple[str, str]] = set()
        self.pairs: set[tuple[str, str]] = set()
        self.speed_sum = 0.0

    def take(self, road_user: str, person: bool) -> None:
        if road_user in self.goal:
            return
        self.count["taken"] += 1
        if person:
            edges, arrival = self.api.person.getEdges(road_user, 0), self.api.person.getStage(road_user, 0).arrivalPos
            length = self.api.lane.getLength(edges[-1] + "_0")
            place = self.api.simulation.convert2D(edges[-1], min(max(arrival, 0.0), length), 0)
            self.goal[road_user] = (edges[-1], np.array([place]), 8.0)
        else:
            edge = self.api.vehicle.getRoute(road_user)[-1]
            ends = [self.api.lane.getShape(f"{edge}_{i}")[-1] for i in range(self.api.edge.getLaneNumber(edge))]
            self.goal[road_user] = (edge, np.array(ends), 15.0)

    def follow(self, snapshot: Snapshot, loans: TakenOverControl, joins: bool) -> None:
        """Watch whom a takeover would have taken, without taking anybody: what SUMO alone makes of them."""
        fresh = [i for i, road_user in enumerate(snapshot.ids) if joins and road_user not in self.followed]
        able = loans.eligible([snapshot.ids[i] for i in fresh], snapshot.person[fresh])
        for i, may in zip(fresh, able.tolist(), strict=True):
            if may:
                self.followed.add(snapshot.ids[i])
                self.take(snapshot.ids[i], bool(snapshot.person[i]))

    def look(self, snapshot: Snapshot, now: float, own: set[str]) -> None:
        api, count = self.api, self.count
        gone = {*api.simulation.getArrivedIDList(), *api.simulation.getArrivedPersonIDList()}
        known = {*api.vehicle.getIDList(), *api.person.getIDList()}
        count["teleported"] += len(api.simulation.getStartingTeleportIDList())
        for hit in api.simulation.getCollisions():
            if (hit.collider, hit.victim) not in self.pairs:
                self.pairs.add((hit.collider, hit.victim))
                note("collision", now, hit.collider, hit.victim, hit.lane)
        for road_user in [g for g in self.goal if g not in known]:
            _, ends, reach = self.goal.pop(road_user)
            x, y, speed, _ = self.last.get(road_user, (1e9, 1e9, 0.0, False))
            if road_user not in gone:
                count["lost"] += 1
                note("lost", now, road_user)
            elif np.hypot(*(ends - (x, y)).T).min() < reach + speed * self.step:
                count["arrived_home"] += 1
            else:
                count["arrived_elsewhere"] += 1
                note("arrived elsewhere", now, road_user, x, y, ends.tolist())
            count["arrived_while_ours"] += road_user in own
        last = self.last
        self.last = {}
        for i, road_user in enumerate(snapshot.ids):
            x, y, speed = float(snapshot.x[i]), float(snapshot.y[i]), float(snapshot.speed[i])
            mine = road_user in own
            self.last[road_user] = (x, y, speed, mine)
            if not snapshot.person[i]:
                count["vehicle_steps"] += 1
                self.speed_sum += speed
            before = last.get(road_user)
            if before is None or mine:
                continue
            if before[3]:
                # SUMO's vehicles change lanes from one step to the next.
                slack = 1.0 if snapshot.person[i] else 3.5
                if np.hypot(x - before[0], y - before[1]) > max(speed, before[2]) * self.step + slack:
                    count["jumps"] += 1
                    note("jump", now, road_user, before, self.last[road_user], snapshot.lane[i])
            if snapshot.person[i]:
                continue
            fresh = now - self.given.get(road_user, -1e9) <= AFTER
            count["steps_after" if fresh else "steps_else"] += 1
            if (before[2] - speed) / self.step > HARD_BRAKE:
                count["brakes_after" if fresh else "brakes_else"] += 1
                if fresh:
                    note("hard brake", now, road_user, before[2], speed, snapshot.lane[i], self.given[road_user])


def play_signals(api: Any, now: float, switched: list[float]) -> None:
    if now - switched[0] < GREEN:
        return
    switched[0] = now
    for light in api.trafficlight.getIDList():
        if api.trafficlight.getPhaseDuration(light) >= 1000.0:
            program = api.trafficlight.getProgram(light)
            logics = api.trafficlight.getAllProgramLogics(light)
            phases = next(len(logic.phases) for logic in logics if logic.programID == program)
            api.trafficlight.setPhase(light, (api.trafficlight.getPhase(light) + 1) % phases)


def scenario_of(name: str) -> Any:
    if name in shipped_scenarios():
        return find_scenario(name)
    if name in WHEEL or not Path(name).exists():
        import sumo

        return find_scenario(str(Path(sumo.SUMO_HOME) / "tools" / "game" / f"{name}.sumocfg"))
    return find_scenario(name)


def auto_region(api: Any) -> str:
    """The junction where most lanes meet, with a radius of 60 m."""
    junctions = [j for j in api.junction.getIDList() if not j.startswith(":")]
    return f"junction:{max(junctions, key=lambda j: len(api.junction.getIncomingEdges(j)))},radius=60"


def run(options: argparse.Namespace) -> dict[str, Any]:
    """One run, here in this process."""
    import libsumo as api

    scenario, step = scenario_of(options.name), options.step
    if step > DECISION_INTERVAL:
        # As `slrl-sumo run` treats a scenario of such a step: 0.4 s.
        scenario, step = replace(scenario, options={**scenario.options, "step-length": f"{step:g}"}), None
    with SumoSession(scenario, seed=options.seed, step_length=step) as session:
        watch = Watch(api, session.step_length)
        loans, driver = TakenOverControl(api, session.network), LaneDriver(api, session.network)
        text = auto_region(api) if options.region == "auto" else options.region
        region = parse_region(text, session.network)
        shares = parse_shares(options.shares)
        learned = empty_world()
        settled: set[str] = set()
        # Not at the moment when everybody is handed back.
        switched, costs, most = [0.5 * GREEN], [], 0
        snapshot = session.reader.read()
        while session.time < options.seconds + options.tail:
            if session.time >= options.seconds and not learned.ids and not watch.goal:
                break
            if options.plain:
                watch.follow(snapshot, loans, session.time < options.seconds)
            else:
                learned = hand_over(session, snapshot, learned, loans, driver, region, shares, watch, settled, options)
            play_signals(api, session.time, switched)
            own = set(learned.ids)
            rest = [i for i, road_user in enumerate(snapshot.ids) if road_user not in own]
            begin = time.perf_counter()
            world = learned.join(world_of(snapshot, rest, session.time, False))
            fresh = overlapping(world) - watch.overlaps
            watch.overlaps |= fresh
            watch.count["overlaps_ours"] += sum(a in own or b in own for a, b in fresh)
            following = driver.drive(learned, DECISION_INTERVAL, world_of(snapshot, rest, session.time, False))
            if len(learned) > 20:
                costs.append((time.perf_counter() - begin) / len(learned) * 1e5)
            most = max(most, len(learned))
            for k in range(1, session.substeps + 1):
                at = between(learned, following, k / session.substeps)
                present = {*api.vehicle.getIDList(), *api.person.getIDList()}
                keep = [i for i, road_user in enumerate(at.ids) if road_user in present]
                at = at.take(np.array(keep, np.intp))
                walking = at.type == RoadUserType.PEDESTRIAN
                loans.move(at.ids, walking, at.x, at.y, at.heading, at.speed, at.length)
                session.step()
                snapshot = session.reader.read()
                watch.look(snapshot, session.time, own)
            present = {*api.vehicle.getIDList(), *api.person.getIDList()}
            for road_user in own - present:
                loans.forget([road_user])
                driver.forget((road_user,))
            learned = following.take(np.array([i for i, r in enumerate(following.ids) if r in present], np.intp))
        count, step_length = watch.count, session.step_length
        after, other = count["steps_after"] * step_length, count["steps_else"] * step_length
        return {
            "scenario": options.name,
            "step_s": options.step,
            "seed": options.seed,
            "taken": count["taken"],
            "handed_back": count["handed_back"],
            "arrived_home": count["arrived_home"],
            "arrived_elsewhere": count["arrived_elsewhere"],
            "arrived_while_ours": count["arrived_while_ours"],
            "still_under_way": len(watch.goal),
            "not_handed_back": len(learned),
            "lost": count["lost"],
            "teleported": count["teleported"],
            "jumps": int(count["jumps"]),
            "collisions": len(watch.pairs),
            "overlaps": len(watch.overlaps),
            "overlaps_ours": count["overlaps_ours"],
            "hard_brakes_after": count["brakes_after"],
            "vehicle_s_after": round(after, 1),
            "hard_brakes_else": count["brakes_else"],
            "vehicle_s_else": round(other, 1),
            "driver_ms": round(float(np.median(costs)), 2) if costs else 0.0,
            "vehicles": most,
            "mean_speed": round(watch.speed_sum / max(count["vehicle_steps"], 1), 2),
        }


def hand_over(
    session: SumoSession,
    snapshot: Snapshot,
    learned: WorldState,
    loans: TakenOverControl,
    driver: LaneDriver,
    region: Any,
    shares: Any,
    watch: Watch,
    settled: set[str],
    options: argparse.Namespace,
) -> WorldState:
    """Give back who is to go, take who has come; the road users that are ours from now on."""
    now = session.time
    over = now >= options.seconds
    if len(learned):
        near_end = driver.near_end(learned.ids)
        leaving = near_end | ~region.inside(learned.x, learned.y, RIM) | over
        walking = learned.type == RoadUserType.PEDESTRIAN
        rows = np.flatnonzero(leaving)
        back = loans.hand_back([learned.ids[i] for i in rows], walking[rows])
        gone = rows[back]
        for i in gone.tolist():
            watch.count["handed_back"] += 1
            watch.given[learned.ids[i]] = now
            if near_end[i]:
                settled.add(learned.ids[i])
        driver.forget(tuple(learned.ids[i] for i in gone))
        learned = learned.take(np.setdiff1d(np.arange(len(learned)), gone))
    if over:
        return learned
    own = set(learned.ids)
    inside = region.inside(snapshot.x, snapshot.y)
    wanted = drawn(snapshot.ids, snapshot.type, shares, options.seed)
    rows = [
        i
        for i, road_user in enumerate(snapshot.ids)
        if inside[i] and wanted[i] and road_user not in own and road_user not in settled
    ]
    able = loans.eligible([snapshot.ids[i] for i in rows], snapshot.person[rows])
    rows = [i for i, may in zip(rows, able.tolist(), strict=True) if may]
    for i in rows:
        watch.take(snapshot.ids[i], bool(snapshot.person[i]))
        watch.given.pop(snapshot.ids[i], None)
    watch.count["takings"] += len(rows)
    loans.take_over([snapshot.ids[i] for i in rows], snapshot.person[rows])
    return replace(learned.join(world_of(snapshot, rows, now, True)), time=now)


def table(rows: list[dict[str, Any]]) -> str:
    cells = [[str(c) for c in COLUMNS]] + [[str(row.get(c, "")) for c in COLUMNS] for row in rows]
    widths = [max(len(line[k]) for line in cells) for k in range(len(COLUMNS))]
    return "\n".join("  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)) for line in cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", nargs="+", default=list(WHEEL))
    parser.add_argument("--steps", nargs="+", type=float, default=[0.1, 0.2, 0.4, 1.0])
    parser.add_argument("--seconds", type=float, default=600.0, help="takeover until then")
    parser.add_argument("--tail", type=float, default=600.0, help="then wait so long for those taken to arrive")
    parser.add_argument("--shares", default="car=1,bicycle=1,pedestrian=1")
    parser.add_argument("--region", help="as for slrl-sumo run, or auto: the largest junction, radius 60")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--name", help=argparse.SUPPRESS)
    parser.add_argument("--step", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--plain", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.name:
        print("RESULT " + json.dumps(run(options)))
        return
    rows = []
    for name in options.scenarios:
        for step in options.steps:
            row = child(options, name, step, plain=False)
            plain = child(options, name, step, plain=True)
            row["plain_overlaps"], row["plain_speed"] = plain.get("overlaps"), plain.get("mean_speed")
            row["plain_under_way"] = plain.get("still_under_way")
            if "taken" in row:
                row["per_1000_s"] = round(1e3 * row["hard_brakes_after"] / max(row["vehicle_s_after"], 1.0), 2)
                row["plain_per_1000_s"] = round(1e3 * plain["hard_brakes_else"] / max(plain["vehicle_s_else"], 1.0), 2)
            rows.append(row)
            print(table(rows), flush=True)
            if options.json:
                options.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


def child(options: argparse.Namespace, name: str, step: float, plain: bool) -> dict[str, Any]:
    command = [sys.executable, "-X", "faulthandler", __file__, "--name", name, "--step", str(step)]
    command += ["--seconds", str(options.seconds), "--tail", str(options.tail)]
    command += ["--seed", str(options.seed), "--shares", options.shares]
    command += [*(["--region", options.region] if options.region else []), *(["--plain"] if plain else [])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    results = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    if done.returncode or not results:
        print(done.stderr[-3000:], file=sys.stderr)
        return {"scenario": name, "step_s": step, "died": done.returncode}
    return dict(json.loads(results[0].removeprefix("RESULT ")))


if __name__ == "__main__":
    main()
