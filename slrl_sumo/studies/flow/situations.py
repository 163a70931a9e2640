"""The situations in which flow is measured: each a small network with its demand, or a whole network."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from netgen.plan import Plan
from slrl_sumo.studies.flow.scenario_files import LIMIT, element, flow, nodes, road, write_situation
from slrl_sumo.studies.flow.towns import TOWN_SECONDS, town

BICYCLE_SPEED = 5.56
"""m/s: what SUMO's default bicycle wants to go, 20 km/h."""


@dataclass(frozen=True)
class Situation:
    """One situation."""

    about: str
    """What it measures, one line."""
    seconds: float
    """Simulated time, s."""
    build: Callable[[Path], Path]
    """Writes its files into a folder, which is there; returns the .sumocfg."""
    desired: float | None = None
    """m/s that each of its vehicles wants to go, where they are alone and all want the same."""
    network: bool = False
    """Whether it is a whole network, which takes minutes."""


def _straight(length: float, lanes: int = 1) -> Plan:
    return Plan(nodes({"a": (0.0, 0.0), "b": (length, 0.0)}), {"road": road("a", "b", lanes)})


def _alone(kind: str, length: float, period: float, seconds: float, speeds: tuple[str, ...]) -> Callable[[Path], Path]:
    """Vehicles on a straight road of `length` m, one every `period` s; their departure speeds take turns."""

    def build(folder: Path) -> Path:
        count = int((seconds - 60.0) / period)
        demand = [element("vType", id="rider", vClass="bicycle", sigma=0, speedDev=0)] + [
            element("trip", id=f"{n}", type=kind, depart=n * period, from_="road", to="road")[:-2]
            + f' departSpeed="{speeds[n % len(speeds)]}"/>'
            for n in range(count)
        ]
        return write_situation(folder, _straight(length), demand, seconds)

    return build


def _following(folder: Path) -> Path:
    """A platoon behind a car that stops twice on a road of one lane."""
    demand = [
        '<trip id="leader" type="exact" depart="0" from="road" to="road" departSpeed="8" color="red">'
        '<stop lane="road_0" endPos="300" duration="15"/><stop lane="road_0" endPos="700" duration="15"/></trip>',
        flow("followers", "road", "road", 1200.0, begin=1),
    ]
    return write_situation(folder, _straight(1200.0), demand, 240.0)


def _queue(folder: Path) -> Path:
    """Two lanes end at a signal that is red for so long that a queue of 20 and more vehicles stands at each green."""
    plan = Plan(
        nodes({"a": (0.0, 0.0), "s": (400.0, 0.0), "b": (650.0, 0.0)}, s="traffic_light"),
        {"in": road("a", "s", 2), "out": road("s", "b", 2)},
    )
    phases = "".join(element("phase", duration=d, state=s) for d, s in ((80, "rr"), (50, "GG"), (5, "yy")))
    signal = f'<tlLogic id="s" type="static" programID="flow" offset="0">{phases}</tlLogic>'
    return write_situation(folder, plan, [flow("cars", "in", "out", 2400.0)], 405.0, additional=signal)


def cross(kind: str, lanes: int = 1, arm: float = 250.0) -> Plan:
    """A crossing of two roads at a junction of type `kind`: edges in_n, out_n, …, for each arm."""
    ends = {"n": (0.0, arm), "e": (arm, 0.0), "s": (0.0, -arm), "w": (-arm, 0.0)}
    edges = {f"in_{end}": road(end, "c", lanes) for end in ends} | {f"out_{end}": road("c", end, lanes) for end in ends}
    return Plan(nodes({"c": (0.0, 0.0), **ends}, c=kind), edges)


def _signal(folder: Path) -> Path:
    """A crossing with two lanes on each arm; more vehicles come than get through."""
    onward = {"n": "sew", "s": "new", "e": "wns", "w": "ens"}
    shares = (0.7, 0.15, 0.15)
    demand = [
        flow(f"{start}{end}", f"in_{start}", f"out_{end}", 1400.0 * share)
        for start, ends in onward.items()
        for end, share in zip(ends, shares, strict=True)
    ]
    return write_situation(folder, cross("traffic_light", lanes=2), demand, 360.0)


SITUATIONS: dict[str, Situation] = {
    "free-road": Situation(
        "cars alone on a road of 1,200 m, that depart at 7 m/s, 10 m/s or their desired speed",
        300.0,
        _alone("exact", 1200.0, 30.0, 300.0, ("7", "10", "max")),
        LIMIT,
    ),
    "start-car": Situation(
        "cars that start from a stand on an empty road", 240.0, _alone("exact", 600.0, 20.0, 240.0, ("0",)), LIMIT
    ),
    "start-bicycle": Situation(
        "bicycles that start from a stand on an empty road",
        240.0,
        _alone("rider", 300.0, 20.0, 240.0, ("0",)),
        BICYCLE_SPEED,
    ),
    "following": Situation("a platoon behind a car that stops twice, on one lane", 240.0, _following),
    "queue": Situation("queues of 20 and more cars that discharge at a signal, two lanes", 405.0, _queue),
    "signal": Situation("a signalised crossing with more demand than capacity, two lanes", 360.0, _signal),
    "town-1": Situation("a generated town, 1,000 departures", TOWN_SECONDS, town(1), network=True),
    "town-2": Situation("another generated town, 1,000 departures", TOWN_SECONDS, town(2), network=True),
}
"""All situations by name, in the order of the table."""
