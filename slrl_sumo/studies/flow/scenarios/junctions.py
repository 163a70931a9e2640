"""Situations at junctions: each function writes one into a folder and returns the .sumocfg."""

import math
from collections.abc import Callable
from pathlib import Path

from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.plan import Edge, Plan
from slrl_sumo.netgen.specs import RoundaboutSpec
from slrl_sumo.studies.flow.scenarios.scenario_files import (
    SPEED_LIMIT,
    element,
    flow,
    nodes,
    road,
    write_demand,
    write_situation,
)

ONWARD = {"n": "sew", "s": "new", "e": "wns", "w": "ens"}
"""From each arm of a crossing the arms straight on, to one side and to the other."""
LEFT = {"n": "e", "s": "w", "e": "s", "w": "n"}
"""The arm to the left of the traffic from each arm."""
RING_SPEED = 8.33
"""Speed limit (m/s) on the ring of a roundabout of two lanes."""


def queue(folder: Path) -> Path:
    """Two lanes end at a signal that is red for so long that a queue of 20 and more vehicles stands at each green."""
    plan = Plan(
        nodes({"a": (0.0, 0.0), "s": (400.0, 0.0), "b": (650.0, 0.0)}, s="traffic_light"),
        {"in": road("a", "s", 2), "out": road("s", "b", 2)},
    )
    phases = "".join(element("phase", duration=d, state=s) for d, s in ((80, "rr"), (50, "GG"), (5, "yy")))
    signal = f'<tlLogic id="s" type="static" programID="flow" offset="0">{phases}</tlLogic>'
    return write_situation(folder, plan, [flow("cars", "in", "out", 2400.0)], 405.0, additional=signal)


def crossing_roads(kind: str, lanes: int, per_hour: dict[str, float], seconds: float) -> Callable[[Path], Path]:
    """Two roads that cross at a junction of type `kind`.

    `per_hour`: cars from each arm (n, e, s, w); 70 % go straight on, 15 % turn to each side.
    """

    def build(folder: Path) -> Path:
        demand = [
            flow(f"{start}{end}", f"in_{start}", f"out_{end}", per_hour[start] * share)
            for start in per_hour
            for end, share in zip(ONWARD[start], (0.7, 0.15, 0.15), strict=True)
        ]
        return write_situation(folder, _cross(kind, lanes), demand, seconds)

    return build


def left_turns(folder: Path) -> Path:
    """Half of the cars of two opposite arms turn to the left at a signal that gives both green at once."""
    demand = [
        flow(f"{start}{end}", f"in_{start}", f"out_{end}", 300.0)
        for start in "we"
        for end in (ONWARD[start][0], LEFT[start])
    ]
    return write_situation(folder, _cross("traffic_light", 1), demand, 300.0, options=["--tls.layout", "opposites"])


def roundabout(folder: Path) -> Path:
    """A roundabout with four arms of one lane."""
    spec = RoundaboutSpec(
        arms=4,
        radius=18.0,
        arm_length=200.0,
        sidewalks=False,
        crossings=False,
        cycle_lanes=False,
        speed_limit=SPEED_LIMIT,
    )
    (folder / "flow.net.xml").write_bytes(build_net(spec))
    demand = [
        flow(f"{start}{end}", f"in{start}", f"out{end}", 150.0)
        for start in range(4)
        for end in range(4)
        if start != end
    ]
    return write_demand(folder, demand, 300.0)


def two_lane_roundabout(folder: Path) -> Path:
    """A roundabout with four arms; ring and approaches have two lanes, exits have one lane on the outer side."""
    plan = _two_lane_ring(arms=4, radius=25.0, arm=200.0)
    demand = [
        flow(f"{start}{end}", f"in{start}", f"out{end}", 220.0)
        for start in range(4)
        for end in range(4)
        if start != end
    ]
    return write_situation(folder, plan, demand, 300.0)


def crosswalk(folder: Path) -> Path:
    """Pedestrians with the right of way cross a street between junctions, which cars use in both directions."""
    lanes = ({"allow": "pedestrian", "width": "2.00"}, {"disallow": "pedestrian"})
    places = nodes({"w": (-200.0, 0.0), "m": (0.0, 0.0), "e": (200.0, 0.0)})
    edges = {f"{a}{b}": Edge(a, b, SPEED_LIMIT, lanes) for a, b in ("wm", "mw", "em", "me")}
    walks = [
        element("personFlow", id=f"walkers{side}", begin=0, end=3600, period="exp(0.05)", departPos=start)
        .replace("/>", ">") + element("walk", from_=a, to=b, arrivalPos=end) + "</personFlow>"
        for side, a, b, start, end in (("n", "mw", "wm", 30, 170), ("s", "wm", "mw", 170, 30))
    ]  # fmt: skip
    demand = [*walks, flow("eastward", "wm", "me", 450.0), flow("westward", "em", "mw", 450.0)]
    plan = Plan(places, edges, crossings={"m": ("wm", "mw")})
    return write_situation(folder, plan, demand, 240.0)


def _two_lane_ring(arms: int, radius: float, arm: float) -> Plan:
    """A ring of edges ring0, ring1, … of two lanes, with in0, out0, … at the arms; distances in m, 30 km/h on the ring.

    Each exit lies 7 m before the entry of the same arm.
    """
    spacing, half = math.tau / arms, 7.0 / radius
    angles = [k * spacing + side for k in range(arms) for side in (-half, half)]
    places = {f"{'xe'[k % 2]}{k // 2}": _polar(radius, angle) for k, angle in enumerate(angles)}
    names = list(places)
    edges = {}
    for k, start in enumerate(names):
        span = (angles[(k + 1) % len(names)] - angles[k]) % math.tau
        shape = tuple(_polar(radius, angles[k] + span * part / 8) for part in range(9))
        edges[f"ring{k}"] = Edge(start, names[(k + 1) % len(names)], RING_SPEED, ({}, {}), shape)
    ring = tuple(edges)
    for k in range(arms):
        places[f"a{k}"] = _polar(radius + arm, k * spacing)
        edges[f"in{k}"], edges[f"out{k}"] = road(f"a{k}", f"e{k}", 2), road(f"x{k}", f"a{k}")
    return Plan(nodes(places), edges, ring=ring)


def _polar(radius: float, angle: float) -> tuple[float, float]:
    return radius * math.cos(angle), radius * math.sin(angle)


def _cross(kind: str, lanes: int, arm: float = 250.0) -> Plan:
    """A crossing of two roads at a junction of type `kind`: edges in_n, out_n, …, for each arm."""
    ends = {"n": (0.0, arm), "e": (arm, 0.0), "s": (0.0, -arm), "w": (-arm, 0.0)}
    edges = {f"in_{end}": road(end, "c", lanes) for end in ends} | {f"out_{end}": road("c", end, lanes) for end in ends}
    return Plan(nodes({"c": (0.0, 0.0), **ends}, c=kind), edges)
