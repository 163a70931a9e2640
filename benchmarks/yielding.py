"""Braking of background vehicles for learned road users in their path, for those beside it, and its cost.

    python benchmarks/yielding.py [--json FILE] [--without] [--seconds 600] [--only meet|beside|cost]

Three parts; every case is a process of its own, because libsumo holds one simulation:

- meet: one learned road user appears again and again where SUMO may not see it (lane edge, junction, crossing, off its
  route, walking across); how many background vehicles that had room to stop drive into its box?
- beside: learned road users stand beside the ways of the background cars; how many cars brake more than in plain SUMO?
- cost: time of a step with many background vehicles and 64 learned road users.

`--without` also runs `meet` without yielding, to compare.
"""

import argparse
import json
import math
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from slrl_sumo.background.yielding import Yielding
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.netgen.scenario import scenario_files
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec, NetSpec, RandomSpec
from slrl_sumo.scene.geometry import boxes_overlap, to_ego
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.network.lanes import Lane, LanePoints
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

STEP = 0.4
WALKING_SPEED, RIDING_SPEED = 1.3, 2.0
CASES: tuple[str, ...] = ("lane centre", "0.7 m off", "1.4 m off", "1.6 m off", "junction", "crossing")
CASES += ("opposite lane", "walks across", "along the edge")
BESIDE = ("sidewalk", "beside the road", "opposite lane", "cycle lane", "kerb")
CROSS = IntersectionSpec(arm_length=150.0)
IN, OUT, BACK_IN, BACK_OUT, UNUSED = "in3", "out1", "in1", "out3", "in2"
"""Edges of the straight way north, which has right of way, and of the way back; their car lanes are the last ones."""
MEETING_FLOWS = (
    ("car", IN, OUT, 500), ("car", BACK_IN, BACK_OUT, 300), ("car", "in0", "out2", 100),
    ("car", IN, "out0", 60), ("car", IN, "out2", 40), ("car", BACK_IN, "out0", 40), ("bicycle", IN, OUT, 100),
)  # fmt: skip
"""Class, from, to, vehicles per hour."""


def write(spec: NetSpec, demand: DemandSpec, folder: Path, *, sublane: bool, routes: str = "") -> Path:
    """A scenario for a bench, with or without the sublane model, `routes` in place of the demand's."""
    files = scenario_files(spec, demand, "bench")
    if sublane:
        option = b'<processing>\n    <lateral-resolution value="0.8"/>'
        files["bench.sumocfg"] = files["bench.sumocfg"].replace(b"<processing>", option)
        assert option in files["bench.sumocfg"]
    if routes:
        files["bench.rou.xml"] = routes.encode()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / "bench.sumocfg"


def world(ids: tuple[str, ...], kinds: np.ndarray, pose: np.ndarray, speed: np.ndarray) -> WorldState:
    """Learned road users with rows x, y, heading in `pose`."""
    n = len(ids)
    return WorldState(
        time=0.0,
        ids=ids,
        type=kinds.astype(np.int8),
        x=pose[:, 0],
        y=pose[:, 1],
        heading=pose[:, 2],
        speed=speed,
        acceleration=np.zeros(n),
        yaw_rate=np.zeros(n),
        length=DEFAULT_LENGTH[kinds],
        width=DEFAULT_WIDTH[kinds],
        learned=np.ones(n, np.bool_),
    )


def move(session: SumoSession, users: WorldState) -> None:
    """As CoSimulation does it."""
    session.spawned.move(users.ids, users.type, users.x, users.y, users.heading, users.speed, users.length)


def lane_of(session: SumoSession, lane_id: str) -> Lane:
    """The lane of that id."""
    return next(lane for lane in session.network.lanes if lane.id == lane_id)


@dataclass(frozen=True)
class Way:
    """The straight way through the junction: its car lane in, and places beside it."""

    start: np.ndarray
    direction: float
    length: float
    lanes: tuple[Lane, ...]
    """Lanes of the edge, from the right-hand side."""

    def at(self, along: float, left: float, turn: float = 0.0) -> np.ndarray:
        """x, y, heading of a place `along` m from the lane's begin and `left` m to its left."""
        c, s = math.cos(self.direction), math.sin(self.direction)
        x, y = self.start + np.array([c * along - s * left, s * along + c * left])
        return np.array([x, y, math.remainder(self.direction + turn, math.tau)])

    def left_of(self, point: np.ndarray) -> tuple[float, float]:
        """Along and left of a point."""
        along, left = to_ego(point[0] - self.start[0], point[1] - self.start[1], np.array(self.direction))
        return float(along), float(left)


def straight_way(session: SumoSession) -> Way:
    """The way in on the edge `IN`."""
    lanes = tuple(lane for lane in session.network.lanes if lane.edge == IN)
    first, last = lanes[-1].shape[0], lanes[-1].shape[-1]
    return Way(first, math.atan2(*(last - first)[::-1]), float(np.hypot(*(last - first))), lanes)


def meet_case(session: SumoSession, case: str, kind: RoadUserType) -> tuple[np.ndarray, float]:
    """Where the road user appears (x, y, heading) and its speed."""
    way = straight_way(session)
    crossings = [way.left_of(c.shape.mean(axis=0)) for c in session.network.lanes if c.surface == Surface.CROSSING]
    crossing = min(abs(along - way.length) for along, _ in crossings) + way.length
    inside = next(link[4] for link in session.api.lane.getLinks(way.lanes[-1].id) if link[0].startswith(OUT))
    middle = way.length + 0.5 * float(np.hypot(*np.diff(lane_of(session, inside).shape, axis=0).T).sum())
    half = 0.55 * way.length
    across = math.pi / 2
    turn = across if kind == RoadUserType.PEDESTRIAN else 0.0
    table = {
        "lane centre": (way.at(half, 0.0, turn), 0.0),
        "0.7 m off": (way.at(half, -0.7, turn), 0.0),
        "1.4 m off": (way.at(half, -1.4, turn), 0.0),
        "1.6 m off": (way.at(half, -1.6, turn), 0.0),
        "junction": (way.at(middle, 0.0, across), 0.0),
        "crossing": (way.at(crossing, 0.0, across), 0.0),
        "opposite lane": (way.at(half, 3.2, math.pi), 0.0),
        "walks across": (way.at(half, -5.4 - 0.5 * float(DEFAULT_LENGTH[kind]), across), WALKING_SPEED),
        "along the edge": (way.at(0.3 * way.length, -1.2), RIDING_SPEED),
    }
    return table[case]


def meet(
    case: str, kind: RoadUserType, off_route: bool, sublane: bool, yields: bool, seconds: float, seed: int
) -> dict[str, Any]:
    """One case of the first part."""
    with TemporaryDirectory() as name:
        config = write(CROSS, DemandSpec(duration=seconds), Path(name), sublane=sublane, routes=routes(seconds))
        with SumoSession(find_scenario(str(config)), seed=seed, step_length=STEP) as session:
            return _meet(session, case, kind, off_route, yields, seconds)


def _meet(
    session: SumoSession, case: str, kind: RoadUserType, off_route: bool, yields: bool, seconds: float
) -> dict[str, Any]:
    start, speed = meet_case(session, case, kind)
    # While it is away it is on a lane: off every lane, persons stay where they were for SUMO, and so do some vehicles
    # with the sublane model.
    waiting = lane_of(session, f"{UNUSED}_0" if kind == RoadUserType.PEDESTRIAN else f"{UNUSED}_2")
    if kind == RoadUserType.PEDESTRIAN and not off_route:
        # SpawnedControl renews the walk on every edge with a sidewalk: from this one it stays on the car lane.
        waiting = straight_way(session).lanes[0]
    away = np.append(0.93 * waiting.shape[0] + 0.07 * waiting.shape[-1], 0.0)
    home = (
        away
        if kind == RoadUserType.PEDESTRIAN
        else np.append(lane_of(session, f"{UNUSED}_2" if off_route else f"{IN}_2").shape.mean(axis=0), 0.0)
    )
    kinds = np.array([int(kind)])
    session.spawned.add(("learned.0",), kinds, home[:1], home[1:2])
    # A person's walk can only be renewed after it has departed.
    at_home = world(("learned.0",), kinds, home[None], np.zeros(1))
    for _ in range(2):
        move(session, at_home)
        session.step()
    yielding = Yielding(session.api, session.network, STEP)
    present, clock, pose = False, 0.0, away
    met: set[tuple[str, int]] = set()
    touched: dict[tuple[str, int], str] = {}
    first: list[Any] = []
    blocked: set[str] = set()
    stopped: set[tuple[str, int]] = set()
    appearances = 0
    hard = 0
    before: dict[str, float] = {}
    snapshot = session.reader.read()
    took = []
    until = 20.0 if speed == 0.0 else (18.0 / speed if case == "walks across" else 80.0 / speed)
    for _ in range(round(seconds / STEP)):
        clock += STEP
        if not present and clock > 8.0 and can_appear(snapshot, start):
            present, clock, pose = True, 0.0, start.copy()
            appearances += 1
            blocked = no_room_to_stop(session.api, snapshot, start) if case != "walks across" else set()
        elif present and clock > until:
            present, clock, pose = False, 0.0, away
        now = world(("learned.0",), kinds, pose[None], np.array([speed if present else 0.0]))
        if present:
            pose = pose + speed * STEP * np.array([math.cos(pose[2]), math.sin(pose[2]), 0.0])
        following = world(("learned.0",), kinds, pose[None], now.speed)
        begun = time.perf_counter()
        if yields:
            yielding.apply(snapshot, following)
        took.append(time.perf_counter() - begun)
        move(session, following)
        session.step()
        snapshot = session.reader.read()
        others = [i for i, v in enumerate(snapshot.ids) if v != "learned.0" and not snapshot.person[i]]
        speeds = {snapshot.ids[i]: snapshot.speed[i] for i in others}
        hard += sum(v in before and s - before[v] < -5.1 * STEP for v, s in speeds.items())
        before = speeds
        if not present or not others:
            continue
        ours = np.column_stack([snapshot.x, snapshot.y, snapshot.heading, snapshot.length, snapshot.width])[others]
        theirs = np.broadcast_to([*pose, now.length[0], now.width[0]], ours.shape)
        ahead, beside = to_ego(pose[0] - ours[:, 0], pose[1] - ours[:, 1], ours[:, 2])
        touching = boxes_overlap(ours, np.ascontiguousarray(theirs))
        for k, i in enumerate(others):
            key = snapshot.ids[i], appearances
            if 0 < ahead[k] - 0.5 * ours[k, 3] < 25 and abs(beside[k]) < 3.0:
                met.add(key)
                if snapshot.speed[i] < 0.1 and ahead[k] < 12:
                    stopped.add(key)
            if touching[k] and key not in touched:
                driving = snapshot.speed[i] > 0.1
                touched[key] = "no room" if key[0] in blocked else "hit" if driving else "run into"
                first.append(
                    [
                        *key,
                        touched[key],
                        round(float(snapshot.speed[i]), 2),
                        round(float(ahead[k]), 2),
                        round(float(beside[k]), 2),
                    ]
                )
    how = Counter(touched.values())
    return {
        "appearances": appearances, "met": len(met), "overlapped": how["hit"],
        "no_room": how["no room"], "run_into": how["run into"],
        "stopped": len(stopped), "interventions": yielding.interventions, "harder_than_5": int(hard),
        "touches": first, "apply_ms": round(1e3 * float(np.median(took)), 3),
    }  # fmt: skip


def can_appear(snapshot: Snapshot, start: np.ndarray) -> bool:
    """No vehicle is near the place where it will appear."""
    return not (np.hypot(snapshot.x - start[0], snapshot.y - start[1])[~snapshot.person] < 6.0).any()


def no_room_to_stop(api: Any, snapshot: Snapshot, start: np.ndarray) -> set[str]:
    """Vehicles nearer than the way they need to stop in with their `decel`, two steps and 2 m included."""
    distance = np.hypot(snapshot.x - start[0], snapshot.y - start[1])
    decel = np.array(
        [4.0 if person else api.vehicle.getDecel(v) for v, person in zip(snapshot.ids, snapshot.person, strict=True)]
    )
    need = snapshot.speed**2 / (2 * decel) + snapshot.speed * 2 * STEP + 0.5 * snapshot.length + 4.5
    return {v for v, short in zip(snapshot.ids, distance < need, strict=True) if short}


def routes(duration: float, flows: tuple[tuple[str, str, str, float], ...] = MEETING_FLOWS) -> str:
    """The contents of a .rou.xml with Poisson flows."""
    types = '<vType id="car" vClass="passenger"/><vType id="bicycle" vClass="bicycle"/>'
    made = "".join(
        f'<flow id="{kind}.{k}" type="{kind}" begin="0" end="{duration:g}" '
        f'period="exp({rate / 3600:g})" from="{start}" to="{end}" '
        'departLane="best" departSpeed="max"/>'
        for k, (kind, start, end, rate) in enumerate(flows)
    )
    return f"<routes>{types}{made}</routes>"


def beside(case: str, setting: str, sublane: bool, seconds: float, seed: int) -> dict[str, Any]:
    """One case of the second part; `setting`: plain SUMO, agents without yielding, agents with yielding."""
    ways = [(IN, OUT)] if case == "opposite lane" else [(IN, OUT), (BACK_IN, BACK_OUT)]
    flows = tuple(("car", a, b, 500.0) for a, b in ways)
    with TemporaryDirectory() as name:
        config = write(CROSS, DemandSpec(duration=seconds), Path(name), sublane=sublane, routes=routes(seconds, flows))
        with SumoSession(find_scenario(str(config)), seed=seed, step_length=STEP) as session:
            return _beside(session, case, setting, seconds)


def _beside(session: SumoSession, case: str, setting: str, seconds: float) -> dict[str, Any]:
    way = straight_way(session)
    walk, cycle = (way.left_of(lane.shape[0])[1] for lane in way.lanes[:2])
    lateral, kinds_list, turn = {
        "sidewalk": (walk, (2, 2, 2, 1, 2, 2), 0.0),
        "beside the road": (walk - 3.0, (0, 1, 2, 0, 1, 2), 0.0),
        "opposite lane": (3.2, (0, 1, 2, 0, 1, 2), math.pi),
        "cycle lane": (cycle, (1, 2, 1, 2, 1, 2), 0.0),
        "kerb": (walk + 1.0, (2, 2, 2, 2, 2, 2), math.pi / 2),
    }[case]
    kinds = np.array(kinds_list)
    ids = tuple(f"learned.{k}" for k in range(len(kinds)))
    pose = np.array([way.at(share * way.length, lateral, turn) for share in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)])
    users = world(ids, kinds, pose, np.zeros(len(kinds)))
    if setting != "plain":
        session.spawned.add(ids, users.type, users.x, users.y)
    yielding = Yielding(session.api, session.network, STEP)
    snapshot = session.reader.read()
    last: dict[str, float] = {}
    cars: set[str] = set()
    braked: set[str] = set()
    warm_up = 3
    for step in range(round(seconds / STEP)):
        if setting == "yielding" and step >= warm_up:
            yielding.apply(snapshot, users)
        if setting != "plain":
            move(session, users)
        session.step()
        snapshot = session.reader.read()
        speeds = {
            v: s for v, s in zip(snapshot.ids, snapshot.speed.tolist(), strict=True) if not v.startswith("learned")
        }
        cars |= speeds.keys()
        braked |= {v for v, s in speeds.items() if v in last and (last[v] - s > 2.0 * STEP or s < 0.1)}
        last = speeds
    return {"cars": len(cars), "braked": len(braked), "interventions": yielding.interventions}


def cost(seconds: float, seed: int, agents: int = 64) -> dict[str, Any]:
    """The third part: a street net with about 500 vehicles; a third of the road users on each kind of lane, moving."""
    demand = DemandSpec(cars_per_hour=14000, bicycles_per_hour=2000, pedestrians_per_hour=0, duration=10000, seed=seed)
    with TemporaryDirectory() as name:
        config = write(RandomSpec(iterations=150, seed=seed), demand, Path(name), sublane=False)
        with SumoSession(find_scenario(str(config)), seed=seed, step_length=STEP) as session:
            return _cost(session, seconds, seed, agents)


def _cost(session: SumoSession, seconds: float, seed: int, agents: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    kinds = np.arange(agents) % 3
    surfaces = (Surface.ROAD, Surface.CYCLEWAY, Surface.SIDEWALK)
    rows = []
    for kind in kinds:
        points = LanePoints(
            [lane for lane in session.network.lanes if lane.surface == surfaces[kind] and not lane.internal], 2.0
        )
        pick = rng.integers(len(points))
        rows.append((points.x[pick], points.y[pick], points.heading[pick]))
    home = np.array(rows)
    speed = np.array([3.0, 3.0, 1.3])[kinds]
    ids = tuple(f"learned.{k}" for k in range(agents))
    yielding = Yielding(session.api, session.network, STEP)
    while len(session.api.vehicle.getIDList()) < 500 and session.time < 400:
        session.step()
    users = world(ids, kinds, home, speed)
    session.spawned.add(ids, users.type, users.x, users.y)
    move(session, users)
    session.step()
    snapshot = session.reader.read()
    took: dict[str, list[float]] = {"apply": [], "step": [], "read": [], "move": []}
    counts, holding = [], []
    for step in range(round(seconds / STEP)):
        # To and fro along the lane, 10 s each.
        phase = (step * STEP) % 20.0
        along = speed * np.minimum(phase, 20.0 - phase)
        pose = home + np.column_stack([along * np.cos(home[:, 2]), along * np.sin(home[:, 2]), np.zeros(agents)])
        users = world(ids, kinds, pose, speed)
        marks = [time.perf_counter()]
        yielding.apply(snapshot, users)
        marks.append(time.perf_counter())
        move(session, users)
        marks.append(time.perf_counter())
        session.step()
        marks.append(time.perf_counter())
        snapshot = session.reader.read()
        marks.append(time.perf_counter())
        for part, span in zip(("apply", "move", "step", "read"), np.diff(marks), strict=True):
            took[part].append(1e3 * span)
        counts.append(int((~snapshot.person).sum()) - int((kinds < 2).sum()))
        holding.append(len(yielding.held))
    ms = {part: float(np.median(spans)) for part, spans in took.items()}
    return {
        "vehicles": int(np.median(counts)), "agents": agents, "held": float(np.median(holding)),
        "apply_ms": round(ms["apply"], 2), "apply_ms_p90": round(float(np.quantile(took["apply"], 0.9)), 2),
        "step_ms": round(ms["step"], 2), "read_ms": round(ms["read"], 2), "move_ms": round(ms["move"], 2),
        "share_of_floor": round(ms["apply"] / (ms["step"] + ms["read"] + ms["move"]), 2),
    }  # fmt: skip


def case_arguments(only: str, without: bool, seconds: float, seeds: int) -> Iterator[dict[str, Any]]:
    """All cases, as the arguments of their functions."""
    if only in ("meet", "all"):
        for sublane in (False, True):
            for case in CASES:
                for kind in range(3):
                    if case == "along the edge" and kind == 2:
                        continue
                    for off_route in (False, True):
                        for yields in (True, False) if without else (True,):
                            for seed in range(1, seeds + 1):
                                yield {
                                    "part": "meet", "case": case, "kind": kind, "off_route": off_route,
                                    "sublane": sublane, "yields": yields, "seconds": seconds, "seed": seed,
                                }  # fmt: skip
    if only in ("beside", "all"):
        for sublane in (False, True):
            for case in BESIDE:
                for setting in ("plain", "agents", "yielding"):
                    for seed in range(1, seeds + 1):
                        yield {
                            "part": "beside", "case": case, "setting": setting, "sublane": sublane,
                            "seconds": seconds, "seed": seed,
                        }  # fmt: skip
    if only in ("cost", "all"):
        yield {"part": "cost", "seconds": min(seconds, 80.0), "seed": 1}


def run_case(arguments: dict[str, Any]) -> dict[str, Any]:
    """A case in a process of its own; a process that dies is a result."""
    done = subprocess.run(
        [sys.executable, __file__, "--case", json.dumps(arguments)], capture_output=True, text=True, check=False
    )
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        return arguments | {"died": done.returncode, "said": done.stderr.strip().splitlines()[-1:]}
    result: dict[str, Any] = json.loads(lines[-1])
    return arguments | result


def one_case(arguments: dict[str, Any]) -> dict[str, Any]:
    """A case in this process."""
    part = arguments.pop("part")
    if part == "meet":
        return meet(**(arguments | {"kind": RoadUserType(arguments["kind"])}))
    return beside(**arguments) if part == "beside" else cost(**arguments)


def print_tables(rows: list[dict[str, Any]], console: Console) -> None:
    """Print the results as tables."""
    dead = [r for r in rows if "died" in r]
    rows = [r for r in rows if "died" not in r]
    met = [r for r in rows if r["part"] == "meet"]
    if met:
        table = Table(
            title="background vehicles that drove into the road user / that met it (those without room apart)"
        )
        for column in (
            "case",
            "road user",
            "sublane",
            "yielding",
            "on its route",
            "off its route",
            "no room",
            "run into",
            "stopped",
        ):
            table.add_column(column)
        for key in dict.fromkeys((r["case"], r["kind"], r["sublane"], r["yields"]) for r in met):
            some = [r for r in met if (r["case"], r["kind"], r["sublane"], r["yields"]) == key]
            shares = []
            for off_route in (False, True):
                these = [r for r in some if r["off_route"] == off_route]
                shares.append(f"{sum(r['overlapped'] for r in these)}/{sum(r['met'] for r in these)}" if these else "")
            sums = [str(sum(r[c] for r in some)) for c in ("no_room", "run_into", "stopped")]
            table.add_row(key[0], TYPE_NAMES[key[1]], *("yes" if k else "no" for k in key[2:]), *shares, *sums)
        console.print(table)
    seen = [r for r in rows if r["part"] == "beside"]
    if seen:
        table = Table(title="cars that braked by more than 2 m/s² or stopped, of all cars")
        for column in ("case", "sublane", "plain SUMO", "agents, no yielding", "agents, yielding", "interventions"):
            table.add_column(column)
        for case, sublane in dict.fromkeys((r["case"], r["sublane"]) for r in seen):
            cells = []
            for setting in ("plain", "agents", "yielding"):
                some = [r for r in seen if (r["case"], r["sublane"]) == (case, sublane) and r["setting"] == setting]
                cells.append(f"{sum(r['braked'] for r in some)}/{sum(r['cars'] for r in some)}")
            table.add_row(case, "yes" if sublane else "no", *cells, str(sum(r["interventions"] for r in some)))
        console.print(table)
    for r in rows:
        if r["part"] == "cost":
            console.print({k: v for k, v in r.items() if k not in ("part", "seed")})
    for r in dead:
        console.print("DIED", r)


def main() -> None:
    """Run all cases and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write all rows to this file")
    parser.add_argument("--only", choices=("meet", "beside", "cost", "all"), default="all")
    parser.add_argument("--without", action="store_true", help="also without yielding, to compare")
    parser.add_argument("--seconds", type=float, default=600.0, help="simulated time of each case")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each case of `meet` and `beside`")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(one_case(json.loads(arguments.case))))
        return
    cases = list(case_arguments(arguments.only, arguments.without, arguments.seconds, arguments.seeds))
    # The timing must not share the machine with other cases.
    timed = [c for c in cases if c["part"] == "cost"]
    with ThreadPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(run_case, [c for c in cases if c["part"] != "cost"]))
    rows += [run_case(c) for c in timed]
    print_tables(rows, Console(width=140))
    if arguments.json:
        arguments.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
