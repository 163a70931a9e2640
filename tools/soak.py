"""Soak test: learned road users in many scenarios for many agent-steps. Counts crashes, losses and jumps.

    python -m tools.soak --agent-steps 1000000 --json soak.json
    python -m tools.soak --scenarios district town/my.sumocfg --motions random --seeds 5 --agent-steps 50000

Every (scenario, motion, sublane or not, seed) is a process of its own, so that a crash is one more count, with the
command that repeats it. An agent-step is one learned road user in one SUMO step. Motions:

- prior, lane: added road users that the bundle's mode classifier or the lane follower drives;
- random: added road users on random walks with jumps, over all surfaces and off them;
- takeover: all of the scenario's own road users, everywhere, with the lane follower;
- takeover-random: the same on random walks without jumps, which leave their lanes, their routes and the scene.

Each run ends by handing back or removing all learned road users, and 10 s more of SUMO. Exit code 1 if there was any
crash, hang or loss.
"""

import argparse
import json
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.games import WaitingSignals, scenario_or_game
from slrl_sumo.agent.driver import Driver, Moved
from slrl_sumo.agent.make_driver import make_driver
from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.write import FcdWriter
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.geometry import front_from_centre, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.placement.spawn import starting_points, type_counts
from slrl_sumo.simulation.region import Region
from slrl_sumo.simulation.takeover import Takeover
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.reader import Reader, Snapshot
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.scenario import shipped_scenarios
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession

WHEEL = ("cross", "fkk_in", "square", "A10KW", "ramp", "corridor", "grid6")
MOTIONS = ("prior", "lane", "random", "takeover", "takeover-random")
SUBLANE = ["--lateral-resolution", "0.8"]
JUMP = 0.005
"""Probability that a road user on a random walk jumps in a decision."""
TOP_SPEED = np.array([15.0, 6.0, 2.0])
AFTER = 10.0
"""s of SUMO alone at the end of each run."""
DISPLACED = 0.5
"""m between where a road user was put and where SUMO has it that count as a jump."""
NEVER_BUSY = 600.0
"""s after which a takeover run ends although its agent-steps are not full: the scenario has run dry."""
HANG = 1800.0
"""s of wall clock after which a run counts as hung."""
COUNTS = ("agent_steps", "crashes", "lost", "jumps", "teleports")
COLUMNS = (
    "runs",
    *COUNTS,
    "taken",
    "handed_back",
    "returned_to_route",
    "arrived",
    "wrapped_around",
    "edge_share",
    "lane_share",
    "fcd_ok",
)


class RandomDriver:
    """Random walks: headings and speeds drift, road users stop and go, and jump with probability `jump`."""

    def __init__(self, seed: int, jump: float) -> None:
        self._rng, self._jump = np.random.default_rng(seed), jump
        self.max_speed, self.hardest_braking, self.has_models = TOP_SPEED, np.full(3, -np.inf), False
        self.refusals = Refusals()

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """See Driver."""
        rng, learned = self._rng, world.take(np.arange(n))
        heading = wrap_angle(learned.heading + rng.normal(0.0, 0.15, n))
        top = TOP_SPEED[learned.type]
        speed = np.clip(learned.speed + rng.normal(0.0, 1.0, n), 0.0, top)
        speed = np.where(rng.random(n) < 0.02, rng.choice([0.0, 0.5, 1.0], n) * top, speed)
        x = learned.x + DECISION_INTERVAL * speed * np.cos(heading)
        y = learned.y + DECISION_INTERVAL * speed * np.sin(heading)
        x0, y0, x1, y1 = road_map.bounds
        jumps = rng.random(n) < self._jump
        x = np.where(jumps, rng.uniform(x0, x1, n), x)
        y = np.where(jumps, rng.uniform(y0, y1, n), y)
        return Moved(replace(learned, x=x, y=y, heading=heading, speed=speed), None, {})

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver."""
        return np.zeros(len(ids), np.bool_)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver."""
        return np.zeros(len(ids), np.bool_)

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver."""
        return np.zeros(len(ids), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""


class LastRead(Reader):
    """The session's reader, which also keeps what it has read last."""

    last: Snapshot

    def read(self, spawned: Set[str] = frozenset()) -> Snapshot:
        """All road users, also those `spawned`, whose edges are compared with the surfaces under them."""
        self.last = super().read()
        return self.last


class Mapping:
    """Agreement of SUMO's edges and lanes of road users with the surfaces under them.

    Counted outside junctions where its reference point (the front) is on the surface of exactly one edge, or of exactly
    one lane, which its class may use. A vehicle beside all lanes that it may use has an edge in SUMO but no lane.
    """

    def __init__(self, api: Any, network: Network) -> None:
        self._api = api
        self._classes: dict[str, str] = {}
        lanes = [lane for lane in network.lanes if not lane.internal]
        widths = sorted({lane.width for lane in lanes})
        self._points = [LanePoints([lane for lane in lanes if lane.width == w], spacing=1.0) for w in widths]
        self._lanes = {lane.id: lane for lane in network.lanes}
        self.count: Counter[str] = Counter()

    def look(self, users: WorldState, snapshot: Snapshot, rows: list[int]) -> None:
        """`rows` of the snapshot are the n users."""
        x, y = front_from_centre(users.x, users.y, users.heading, users.length)
        under: list[set[str]] = [set() for _ in rows]
        for points in self._points:
            for found, lane in zip(under, points.lanes_under(x, y).tolist(), strict=True):
                if lane >= 0:
                    found.add(points.lanes[lane].id)
        for road_user, row, lanes in zip(users.ids, rows, under, strict=True):
            edges = {self._lanes[lane].edge for lane in lanes}
            if len(edges) != 1:
                continue
            walks, place = bool(snapshot.person[row]), snapshot.lane[row]
            edge = place if walks else self._api.vehicle.getRoadID(road_user)
            self.count["on_edge"] += 1
            self.count["edge_right"] += edge in edges
            if (
                not walks
                and len(lanes) == 1
                and self._class(snapshot.sumo_type[row]) in self._lanes[min(lanes)].allowed
            ):
                self.count["on_lane"] += 1
                self.count["lane_right"] += place in lanes

    def _class(self, sumo_type: str) -> str:
        if sumo_type not in self._classes:
            self._classes[sumo_type] = self._api.vehicletype.getVehicleClass(sumo_type)
        return self._classes[sumo_type]


class Watch:
    """Compares in every SUMO step what SUMO has with what was asked for."""

    def __init__(self, session: SumoSession, fcd: FcdWriter | None) -> None:
        self._session, self._fcd = session, fcd
        self.reader = LastRead(session.api)
        session.reader = self.reader
        self.mapping = Mapping(session.api, session.network)
        self.count: Counter[str] = Counter()
        self.examples: list[str] = []
        self._returned: dict[str, tuple[float, float, float]] = {}

    def play(self, cosimulation: CoSimulation) -> None:
        """One SUMO step."""
        api: Any = self._session.api
        count = self.count
        n = len(cosimulation.population.world)
        step, decision = cosimulation.step()
        snapshot = self.reader.last
        users = step.world.take(np.arange(n))
        row_of = {road_user: row for row, road_user in enumerate(snapshot.ids)}
        count["agent_steps"] += n
        count["teleports"] += api.simulation.getStartingTeleportNumber()
        here = np.array([road_user in row_of for road_user in users.ids], np.bool_)
        users = users.take(np.flatnonzero(here))
        rows = [row_of[road_user] for road_user in users.ids]
        away = np.hypot(snapshot.x[rows] - users.x, snapshot.y[rows] - users.y)
        self._jumped(users.ids, away > DISPLACED, away, "away from where it was put")
        for road_user, (x, y, speed) in self._returned.items():
            if road_user in row_of:
                row = row_of[road_user]
                far = np.hypot(snapshot.x[row] - x, snapshot.y[row] - y)
                reach = max(speed, float(snapshot.speed[row])) * self._session.step_length + 1.5
                self._jumped((road_user,), np.array([far > reach]), np.array([far]), "in its first step back with SUMO")
        self._returned = {}
        if self._fcd is not None:
            self._fcd.write(step.time, step.world, step.places)
        if decision is None:
            return
        self.mapping.look(users, snapshot, rows)
        # The learned road users come first.
        lost = [road_user for road_user, gone in zip(step.world.ids[:n], decision.lost, strict=True) if gone]
        self._lose(lost)
        count["taken"] += len(decision.taken_over)
        count["handed_back"] += len(decision.handed_back)
        count["arrived"] += len(decision.arrived)
        count["wrapped_around"] += int(decision.wrapped_around.sum())
        count["returned_to_route"] += len(decision.returned_to_route)
        # Road users that had left the scene are put on their route again, at any distance.
        self.keep_returned(tuple(set(decision.handed_back) - set(decision.returned_to_route)))

    def keep_returned(self, ids: tuple[str, ...]) -> None:
        """Where road users that were given back are now, for the next step."""
        snapshot = self.reader.last
        row_of = {road_user: row for row, road_user in enumerate(snapshot.ids)}
        for road_user in ids:
            row = row_of[road_user]
            self._returned[road_user] = (float(snapshot.x[row]), float(snapshot.y[row]), float(snapshot.speed[row]))

    def _lose(self, ids: list[str]) -> None:
        self.count["lost"] += len(ids)
        self.examples += [f"{road_user} lost at {self._session.time:g} s" for road_user in ids]

    def _jumped(self, ids: tuple[str, ...], jumped: NDArray[np.bool_], far: NDArray[np.float64], how: str) -> None:
        self.count["jumps"] += int(jumped.sum())
        for row in np.flatnonzero(jumped).tolist():
            self.examples.append(f"{ids[row]} at {self._session.time:g} s: {far[row]:.1f} m {how}")


def spawn(cosimulation: CoSimulation, session: SumoSession, agents: int, seed: int) -> int:
    """Add as many road users as fit, up to `agents`; how many that are."""
    max_speed = load_bundle("intersection", training=False).max_speed
    while True:
        counts, _ = type_counts(agents, None, starting_points(session.network), session.scenario.name)
        try:
            cosimulation.spawn(counts, max_speed, seed)
        except InputError:
            if agents < 2:
                raise
            agents //= 2
        else:
            return agents


def one(options: argparse.Namespace) -> dict[str, Any]:
    """One run, here in this process."""
    scenario = with_options(scenario_or_game(options.scenario), SUBLANE if options.sublane else [])
    motion = options.motion
    taking = motion.startswith("takeover")
    with tempfile.TemporaryDirectory() as folder, SumoSession(scenario, seed=options.seed) as session:
        fcd = FcdWriter(Path(folder) / "fcd.xml") if options.fcd else None
        watch = Watch(session, fcd)
        driver: Driver
        if motion.endswith("random"):
            driver = RandomDriver(options.seed, 0.0 if taking else JUMP)
        else:
            bundle = load_bundle("intersection", training=False)
            driver = make_driver("lane" if taking else motion, bundle, session.api, session.network, options.seed)
        rule = Takeover(np.ones(3), Region("everywhere"), options.seed) if taking else None
        cosimulation = CoSimulation(session, driver, takeover=rule, traced=fcd is not None)
        agents = 0 if taking else spawn(cosimulation, session, options.agents, options.seed)
        begin, wall = session.time, time.perf_counter()
        cosimulation.start()
        signals, steps = WaitingSignals(session.api, begin), 0
        while watch.count["agent_steps"] < options.agent_steps:
            if taking and session.time - begin > NEVER_BUSY:
                break
            signals.update(session.time)
            watch.play(cosimulation)
            steps += 1
            if steps % 20 == 0:
                print(f"AT {session.time:.2f} {watch.count['agent_steps']}", flush=True)
        end = session.time
        cosimulation.release()
        while session.time < end + AFTER:
            session.step()
        result: dict[str, Any] = {name: watch.count[name] for name in ("agent_steps", "lost", "jumps", "teleports")}
        result |= {
            name: watch.count[name]
            for name in ("taken", "handed_back", "returned_to_route", "arrived", "wrapped_around")
        }
        result |= {name: watch.mapping.count[name] for name in ("on_edge", "edge_right", "on_lane", "lane_right")}
        result |= {"agents": agents, "sumo_steps": steps, "sumo_step_s": session.step_length}
        result |= {"simulated_s": round(end - begin, 1), "wall_s": round(time.perf_counter() - wall, 1)}
        result |= {"kinds": np.bincount(cosimulation.world.type[cosimulation.world.learned], minlength=3).tolist()}
        if fcd is not None:
            fcd.close()
            result["fcd_ok"] = valid(fcd.path)
    # After the session: SUMO may die while it is closed.
    return {**result, "examples": watch.examples[:5]}


def valid(file: Path) -> bool:
    """Whether a trace is FCD by SUMO's own schema."""
    import sumo
    from lxml import etree

    schema = etree.XMLSchema(etree.parse(str(Path(sumo.SUMO_HOME) / "data" / "xsd" / "fcd_file.xsd")))
    return bool(schema.validate(etree.parse(str(file))))


def child(options: argparse.Namespace, case: tuple[str, str, bool, int], agent_steps: int) -> dict[str, Any]:
    """One run in a process of its own."""
    name, motion, sublane, seed = case
    command = [
        sys.executable,
        "-X",
        "faulthandler",
        "-m",
        "tools.soak",
        "--one",
        "--scenario",
        name,
        "--motion",
        motion,
    ]
    command += ["--seed", str(seed), "--agents", str(options.agents), "--agent-steps", str(agent_steps)]
    command += [*(["--sublane"] if sublane else []), *(["--fcd"] if options.fcd else [])]
    row: dict[str, Any] = {"scenario": name, "motion": motion, "sublane": sublane, "seed": seed}
    row["command"] = shlex.join(command)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG)
    except subprocess.TimeoutExpired:
        return {**row, "crashes": 1, "died": f"hung: no end after {HANG:g} s"}
    lines = done.stdout.splitlines()
    results = [line.removeprefix("RESULT ") for line in lines if line.startswith("RESULT ")]
    if done.returncode == 0 and results:
        return {**row, "crashes": 0, **json.loads(results[0])}
    last = next((line for line in reversed(lines) if line.startswith("AT ")), "AT 0 0").split()
    words = [line for line in done.stderr.splitlines() if line and not line.startswith((" ", "Extension modules"))]
    how = signal.Signals(-done.returncode).name if done.returncode < 0 else f"exit code {done.returncode}"
    died = f"{how} after {last[1]} s{f'; {words[-1]}' if words and done.returncode > 0 else ''}"
    return {**row, "crashes": 1, "agent_steps": int(last[2]), "died": died, "stderr": done.stderr[-3000:]}


def cases(options: argparse.Namespace) -> Iterator[tuple[str, str, bool, int]]:
    """All runs, seed by seed without end, so that a soak may go on until its agent-steps are full."""
    for seed in count(options.seed):
        for name in options.scenarios:
            for motion in options.motions:
                for sublane in (False, True):
                    yield name, motion, sublane, seed


def table(rows: list[dict[str, Any]]) -> str:
    """Counts by scenario and by motion, with and without sublanes, and in all."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for key in ("scenario", "motion"):
        for row in rows:
            groups.setdefault(f"{row[key]}{' sublane' if row['sublane'] else ''}", []).append(row)
    groups["all"] = rows
    lines: list[tuple[str, ...]] = [("", *COLUMNS)]
    for name, group in groups.items():
        total: Counter[str] = Counter()
        for row in group:
            total.update({key: value for key, value in row.items() if isinstance(value, int) and key != "seed"})
        shares = [
            f"{100 * total[right] / total[on]:.1f} %" if total[on] else "-"
            for right, on in (("edge_right", "on_edge"), ("lane_right", "on_lane"))
        ]
        traced = [row["fcd_ok"] for row in group if "fcd_ok" in row]
        counts = [str(total[key]) for key in COLUMNS[1:-3]]
        lines.append((name, str(len(group)), *counts, *shares, f"{sum(traced)}/{len(traced)}" if traced else "-"))
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True))])
        for line in lines
    )


def soak(options: argparse.Namespace) -> list[dict[str, Any]]:
    """All runs; those of a further seed only while agent-steps are missing."""
    runs = len(options.scenarios) * len(options.motions) * 2
    share = max(1, -(-options.agent_steps // (runs * options.seeds)))
    rows: list[dict[str, Any]] = []
    source = cases(options)
    done, begin = 0, time.perf_counter()
    with ThreadPoolExecutor(options.processes) as pool:
        batch = runs * options.seeds
        # Takeover runs end early where a scenario runs dry; further seeds make up for them.
        while batch and len(rows) < 4 * runs * options.seeds:
            for row in pool.map(lambda case: child(options, case, share), list(islice(source, batch))):
                rows.append(row)
                done += row.get("agent_steps", 0)
                seconds = time.perf_counter() - begin
                what = f"{row['scenario']} {row['motion']}{' sublane' if row['sublane'] else ''} seed {row['seed']}"
                trouble = row.get("died") or "; ".join(row.get("examples", ())[:2])
                print(f"{seconds:6.0f} s {done:9d} agent-steps  {what}  {trouble}", flush=True)
                if row["crashes"] or row.get("lost"):
                    print(f"         repeat it with: {row['command']}", flush=True)
                if options.json:
                    options.json.write_text(json.dumps({"runs": rows}, indent=1) + "\n")
            batch = options.processes if done < options.agent_steps else 0
    return rows


def main() -> None:
    """The command line: a soak, or with --one a single run of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--agent-steps", type=int, default=1_000_000, help="in all (with --one: of this run)")
    parser.add_argument("--scenarios", nargs="+", default=[*shipped_scenarios(), *WHEEL], help="names or paths")
    parser.add_argument("--motions", nargs="+", choices=MOTIONS, default=list(MOTIONS))
    parser.add_argument("--seeds", type=int, default=1, help="how many to share out the agent-steps on")
    parser.add_argument("--seed", type=int, default=1, help="the first")
    parser.add_argument("--agents", type=int, default=64, help="road users to add, where they fit")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--fcd", action="store_true", help="also write each run's FCD and check it against the schema")
    parser.add_argument("--json", type=Path, help="every run with its counts and the command that repeats it")
    parser.add_argument("--one", action="store_true", help="a single run, in this process:")
    parser.add_argument("--scenario")
    parser.add_argument("--motion", choices=MOTIONS)
    parser.add_argument("--sublane", action="store_true")
    options = parser.parse_args()
    if options.one:
        print("RESULT " + json.dumps(one(options)))
        return
    rows = soak(options)
    print(table(rows))
    if any(row["crashes"] or row.get("lost") for row in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
