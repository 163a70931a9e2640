"""Situations on roads between junctions: each function writes one into a folder and returns the .sumocfg."""

from collections.abc import Callable
from math import cos, radians, sin
from pathlib import Path

from slrl_sumo.netgen.motorway import RAMP_OPTIONS, place_motorway
from slrl_sumo.netgen.plan import Edge, Plan
from slrl_sumo.netgen.specs import MotorwaySpec
from slrl_sumo.studies.flow.scenarios.scenario_files import SPEED_LIMIT, element, flow, nodes, road, write_situation

BENDS = (30, -60, 90, -110, 130)
"""Degrees by which the road turns to the left at each bend."""


def alone(kind: str, length: float, period: float, seconds: float, speeds: tuple[str, ...]) -> Callable[[Path], Path]:
    """Vehicles of type `kind` on a straight road of `length` m, one every `period` s; no one departs in the last 60 s.

    Their departure speeds, as SUMO writes them, take turns.
    """

    def build(folder: Path) -> Path:
        demand = [
            element(
                "trip",
                id=n,
                type=kind,
                depart=n * period,
                from_="road",
                to="road",
                departSpeed=speeds[n % len(speeds)],
            )
            for n in range(int((seconds - 60.0) / period))
        ]
        return write_situation(folder, _straight(length), demand, seconds)

    return build


def following(folder: Path) -> Path:
    """A platoon behind a car that stops twice on a road of one lane."""
    stops = "".join(element("stop", lane="road_0", endPos=place, duration=15) for place in (300, 700))
    leader = element("trip", id="leader", type="exact", depart=0, from_="road", to="road", departSpeed=8)
    demand = [leader.replace("/>", f">{stops}</trip>"), flow("followers", "road", "road", 1200.0, begin=1)]
    return write_situation(folder, _straight(1200.0), demand, 240.0)


def overtaking(folder: Path) -> Path:
    """A street of two lanes with cars and, every 40 s, a bicycle at less than half of their speed."""
    plan = Plan(nodes({"a": (0.0, 0.0), "b": (1000.0, 0.0)}), {"road": road("a", "b", 2)})
    riders = {"type": "rider", "begin": 0, "end": 3600, "period": 40}
    demand = [element("flow", id="riders", from_="road", to="road", **riders), flow("cars", "road", "road", 500.0)]
    return write_situation(folder, plan, demand, 300.0)


def shared_path(folder: Path) -> Path:
    """A street with a path of 3 m on each side that pedestrians and bicycles share: a bicycle every 20 s and a person
    every 15 s on each."""
    lanes = ({"allow": "pedestrian bicycle", "width": "3.00"}, {"disallow": "pedestrian bicycle"})
    places = nodes({"w": (-200.0, 0.0), "m": (0.0, 0.0), "e": (160.0, 80.0)})
    plan = Plan(places, {f"{a}{b}": Edge(a, b, SPEED_LIMIT, lanes) for a, b in ("wm", "mw", "em", "me")})
    demand = []
    for a, b in ("we", "ew"):
        walk = element("walk", edges=f"{a}m m{b}")
        persons = element("personFlow", id=f"persons{a}", begin=0, end=3600, period="exp(0.067)")
        demand += [
            flow(f"cars{a}", f"{a}m", f"m{b}", 200.0),
            flow(f"riders{a}", f"{a}m", f"m{b}", 180.0, type="rider"),
            persons.replace("/>", f">{walk}</personFlow>"),
        ]
    return write_situation(folder, plan, demand, 300.0)


def merge(through: float, joining: float) -> Callable[[Path], Path]:
    """A ramp with an acceleration lane of 200 m joins a road of one lane; cars per hour on the road and on the ramp."""
    plan = Plan(
        nodes({"a": (0.0, 0.0), "r": (150.0, -80.0), "m": (400.0, 0.0), "n": (600.0, 0.0), "b": (900.0, 0.0)}),
        {
            "main": road("a", "m"),
            "ramp": road("r", "m"),
            "both": Edge("m", "n", road("m", "n").speed, ({"acceleration": "true"}, {})),
            "out": road("n", "b"),
        },
    )
    links = (("main", "both", 0, 1), ("ramp", "both", 0, 0), ("both", "out", 1, 0))
    demand = [flow("through", "main", "out", through), flow("joining", "ramp", "out", joining)]
    return lambda folder: write_situation(folder, plan, demand, 300.0, connections=_connections(links))


def lane_drop(per_hour: float) -> Callable[[Path], Path]:
    """A road of two lanes, with so many cars per hour, of which the right one ends."""
    plan = Plan(
        nodes({"a": (0.0, 0.0), "m": (500.0, 0.0), "b": (800.0, 0.0)}),
        {"two": road("a", "m", 2), "one": road("m", "b")},
    )
    demand = [flow("cars", "two", "one", per_hour, departLane="random")]
    links = _connections((("two", "one", 1, 0),))
    return lambda folder: write_situation(folder, plan, demand, 300.0, connections=links)


def motorway(folder: Path) -> Path:
    """A motorway of three lanes for 33 m/s, with an on-ramp, an off-ramp and a lane that ends, at three quarters of its
    capacity."""
    plan = place_motorway(MotorwaySpec(lanes=3, seed=1))
    trips = (("begin", "narrow", 1800.0), ("begin", "off", 500.0), ("on", "narrow", 700.0))
    demand = [flow(f"{start}-{end}", start, end, per_hour) for start, end, per_hour in trips]
    return write_situation(folder, plan, demand, 300.0, options=RAMP_OPTIONS)


def bends(folder: Path) -> Path:
    """A road of one lane that turns by BENDS, with 120 m between bends."""
    places, heading = {"0": (0.0, 0.0)}, 0.0
    for number, turn in enumerate((*BENDS, 0), start=1):
        x, y = places[str(number - 1)]
        places[str(number)] = (x + 120.0 * cos(radians(heading)), y + 120.0 * sin(radians(heading)))
        heading += turn
    edges = {f"road{k}": road(str(k), str(k + 1)) for k in range(len(BENDS) + 1)}
    demand = [flow("cars", "road0", f"road{len(BENDS)}", 400.0)]
    return write_situation(folder, Plan(nodes(places), edges), demand, 240.0)


def _straight(length: float) -> Plan:
    return Plan(nodes({"a": (0.0, 0.0), "b": (length, 0.0)}), {"road": road("a", "b")})


def _connections(links: tuple[tuple[str, str, int, int], ...]) -> str:
    """Connection elements from (edge, edge, lane, lane)."""
    return "".join(element("connection", from_=a, to=b, fromLane=k, toLane=m) for a, b, k, m in links)
