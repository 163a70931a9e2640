"""Roundabouts: a ring of one-way edges around an island, arms that give way to it, crossings before it.

See https://sumo.dlr.de/docs/Networks/PlainXML.html#roundabouts: netconvert yields at the entries of a named ring.
"""

from math import ceil, cos, radians, sin, sqrt, tau
from random import Random

from slrl_sumo.netgen.plan import Edge, Node, Plan, lanes_of
from slrl_sumo.netgen.specs import RoundaboutSpec

_SET_BACK = 16.0
"""m from the island's edge to the middle of a crossing: before it one car can wait for pedestrians without blocking the
ring."""
_COMFORTABLE = 2.5
"""m/s², lateral: it gives the speed on the ring."""
_PIECE = radians(6.0)
"""Arcs are drawn by straight pieces that turn no more than this."""


def place_ring(spec: RoundaboutSpec) -> Plan:
    """The ring's edges ring0, ring1, ... each lead counter-clockwise from arm 0, 1, ... to the next, outer lanes first.

    Arms as in an intersection: in0, out0, in1, ..., counter-clockwise from about the east. With crossings an arm has a
    second piece between crossing and ring: entry0, exit0, ...
    """
    random = Random(f"ring-{spec.seed}")
    spread = radians(spec.angle_spread)
    at = [tau * k / spec.arms + random.uniform(-spread, spread) for k in range(spec.arms)]
    lanes = lanes_of(spec, 1)
    nodes: dict[str, Node] = {}
    edges: dict[str, Edge] = {}
    slow = min(spec.speed_limit, round(sqrt(_COMFORTABLE * spec.radius), 2))
    for k, angle in enumerate(at):
        ahead = (k + 1) % spec.arms
        nodes[f"ring{k}"] = _node(spec.radius, angle, "priority")
        nodes[f"arm{k}"] = _node(spec.arm_length, angle, "dead_end")
        arc = _arc(spec.radius, angle, at[ahead] if ahead else at[0] + tau)
        edges[f"ring{k}"] = Edge(f"ring{k}", f"ring{ahead}", slow, lanes, arc)
        inner = f"ring{k}"
        if spec.crossings:
            inner = f"crossing{k}"
            nodes[inner] = _node(spec.radius + _SET_BACK, angle, "priority")
            edges[f"entry{k}"] = Edge(inner, f"ring{k}", spec.speed_limit, lanes)
            edges[f"exit{k}"] = Edge(f"ring{k}", inner, spec.speed_limit, lanes)
        edges[f"in{k}"] = Edge(f"arm{k}", inner, spec.speed_limit, lanes)
        edges[f"out{k}"] = Edge(inner, f"arm{k}", spec.speed_limit, lanes)
    crossings = {f"crossing{k}": (f"in{k}", f"out{k}") for k in range(spec.arms)} if spec.crossings else {}
    return Plan(nodes, edges, tuple(f"ring{k}" for k in range(spec.arms)), crossings)


def _node(distance: float, angle: float, kind: str) -> Node:
    return Node(distance * cos(angle), distance * sin(angle), kind)


def _arc(radius: float, start: float, end: float) -> tuple[tuple[float, float], ...]:
    pieces = ceil((end - start) / _PIECE)
    angles = [start + (end - start) * i / pieces for i in range(pieces + 1)]
    return tuple((radius * cos(a), radius * sin(a)) for a in angles)
