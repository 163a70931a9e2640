"""Motorways: one carriageway with an on-ramp, an off-ramp and a lane that ends.

netconvert adds the lanes for speeding up and slowing down beside the ramps, see
https://sumo.dlr.de/docs/Simulation/Motorway_Ramps.html.
"""

from math import cos, pi, sin
from random import Random

from slrl_sumo.netgen.plan import Edge, Node, Plan
from slrl_sumo.netgen.specs import MotorwaySpec

RAMP_OPTIONS = ("--ramps.guess", "--ramps.ramp-length", "200", "--ramps.min-highway-speed", "16")
_PIECE = 40.0
"""m: curves are drawn by straight pieces of this length."""
_STRETCHES = ("begin", "between", "end")
_RAMP = 250.0
"""m."""


def place_motorway(spec: MotorwaySpec) -> Plan:
    """The edges begin, between and end follow each other, then `narrow` with one lane less; the ramp `on` joins before
    `between`, and `off` leaves after it. Stretches are straight or turn left or right, drawn from the seed."""
    random = Random(f"motorway-{spec.seed}")
    x, y, heading = 0.0, 0.0, random.uniform(-pi, pi)
    nodes = {"start": Node(x, y, "dead_end")}
    edges = {}
    ends = ("merge", "exit", "drop", "stop")
    last = "start"
    headings = [heading]
    for name, to in zip((*_STRETCHES, "narrow"), ends, strict=True):
        shape = [(x, y)]
        turn = random.choice((-1.0, 0.0, 1.0)) / spec.curve_radius
        for _ in range(round(spec.stretch / _PIECE)):
            heading += turn * _PIECE
            x, y = x + _PIECE * cos(heading), y + _PIECE * sin(heading)
            shape.append((x, y))
        nodes[to] = Node(x, y, "dead_end" if to == "stop" else "priority")
        lanes = spec.lanes - (name == "narrow")
        edges[name] = Edge(last, to, spec.speed_limit, ({"disallow": "pedestrian bicycle"},) * lanes, tuple(shape))
        headings.append(heading)
        last = to
    slow = ({"disallow": "pedestrian bicycle"},)
    for name, at, towards in (("on", "merge", -1.0), ("off", "exit", 1.0)):
        node, aside = nodes[at], headings[ends.index(at) + 1] - towards * 0.3
        end = f"{name}-ramp"
        nodes[end] = Node(node.x + towards * _RAMP * cos(aside), node.y + towards * _RAMP * sin(aside), "dead_end")
        start, stop = (end, at) if name == "on" else (at, end)
        edges[name] = Edge(start, stop, min(spec.ramp_limit, spec.speed_limit), slow)
    return Plan(nodes, edges)
