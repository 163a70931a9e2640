"""Road networks: netgenerate draws the streets, netconvert builds them with sidewalks, crossings and signals.

netgenerate's own net has straight arms and one kind of street. Its plain XML (nodes and edges) is therefore edited:
streets are turned, removed and given lanes, and netconvert builds the net. Roundabouts, which netgenerate lacks, come
from slrl_sumo.netgen.roundabout, motorways from netgen.motorway. See https://sumo.dlr.de/docs/netgenerate.html and
https://sumo.dlr.de/docs/Networks/PlainXML.html.
"""

import re
from dataclasses import replace
from math import atan2, cos, hypot, radians, sin
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from lxml import etree

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.motorway import RAMP_OPTIONS, place_motorway
from slrl_sumo.netgen.plan import Edge, Node, Plan, lanes_of, write_plan
from slrl_sumo.netgen.roundabout import place_ring
from slrl_sumo.netgen.specs import IntersectionSpec, MotorwaySpec, NetSpec, RandomSpec, RoundaboutSpec, SharedSpaceSpec

_HEADER = re.compile(rb"<!-- generated on .*?-->\s*", re.DOTALL)


def build_net(spec: NetSpec) -> bytes:
    """The contents of a .net.xml for `spec`; the same spec gives the same bytes (the dated header is left out)."""
    with TemporaryDirectory(prefix="netgen-") as name:
        folder = Path(name)
        # One arm at a time gets green: in a shared phase, left-turning cyclists and cars of opposite arms waited for
        # each other for ever (in 3 of 3 runs of 600 s; never with this).
        options = ["--no-turnarounds", "--walkingareas", "--tls.layout", "incoming"]
        if isinstance(spec, RandomSpec):
            plan = _dress_streets(_draw_streets(spec, folder), spec)
            options += ["--crossings.guess"] if spec.crossings else []
        elif isinstance(spec, RoundaboutSpec):
            plan = place_ring(spec)
        elif isinstance(spec, MotorwaySpec):
            plan = place_motorway(spec)
            options = ["--no-turnarounds", *RAMP_OPTIONS]
        else:
            plan = _place_arms(_draw_cross(spec.arm_length, folder), spec)
            if isinstance(spec, SharedSpaceSpec):
                options += ["--default.junctions.radius", f"{spec.corner_radius:g}"]
            elif spec.crossings:
                options += ["--crossings.guess"]
        options += ["--output-file", "made.net.xml"]
        run_program("netconvert", write_plan(plan, folder) + options, folder)
        return _HEADER.sub(b"", (folder / "made.net.xml").read_bytes(), count=1)


def _draw_cross(arm_length: float, folder: Path) -> Plan:
    one = ["--grid", "--grid.x-number", "1", "--grid.y-number", "1", "--grid.attach-length", f"{arm_length:g}"]
    return _netgenerate(one, folder)


def _draw_streets(spec: RandomSpec, folder: Path) -> Plan:
    options = ["--rand", "--rand.iterations", str(spec.iterations), "--seed", str(spec.seed)]
    options += ["--rand.min-distance", f"{0.8 * spec.street_length:g}"]
    options += ["--rand.max-distance", f"{1.3 * spec.street_length:g}"]
    # Sharper corners leave no room for sidewalks and cycle lanes of both streets.
    return _netgenerate([*options, "--rand.min-angle", "60"], folder)


def _netgenerate(options: list[str], folder: Path) -> Plan:
    outputs = ["--plain-output-prefix", "drawn", "--output-file", "drawn.net.xml"]
    run_program("netgenerate", [*options, *outputs], folder)
    nodes = {
        str(n.attrib["id"]): Node(float(n.attrib["x"]), float(n.attrib["y"]), str(n.attrib.get("type", "priority")))
        for n in etree.parse(folder / "drawn.nod.xml").getroot().iter("node")
    }
    edges = {
        str(e.attrib["id"]): Edge(str(e.attrib["from"]), str(e.attrib["to"]), float(e.attrib["speed"]), ())
        for e in etree.parse(folder / "drawn.edg.xml").getroot().iter("edge")
    }
    if not edges:
        raise NetgenError("netgenerate drew no street: give another seed or more iterations")
    return Plan(nodes, edges)


def _place_arms(cross: Plan, spec: IntersectionSpec | SharedSpaceSpec) -> Plan:
    """The arms counted counter-clockwise from the east, surplus ones dropped, each turned; edges in0, out0, in1, ..."""
    middle_id = next(i for i in cross.nodes if sum(e.end == i for e in cross.edges.values()) > 1)
    middle = cross.nodes[middle_id]

    def bearing(node: Node) -> float:
        return atan2(node.y - middle.y, node.x - middle.x) % radians(360)

    order = sorted((n for i, n in cross.nodes.items() if i != middle_id), key=bearing)
    kept = {2: (0, 2), 3: (0, 2, 3), 4: (0, 1, 2, 3)}[spec.arms]
    control = spec.control if isinstance(spec, IntersectionSpec) else "right_before_left"
    nodes = {"centre": replace(middle, type=control)}
    edges = {}
    random = Random(f"arms-{spec.seed}")
    lanes = lanes_of(spec, spec.lanes if isinstance(spec, IntersectionSpec) else 1)
    for k, old in enumerate(kept):
        turned = bearing(order[old]) + radians(random.uniform(-spec.angle_spread, spec.angle_spread))
        reach = hypot(order[old].x - middle.x, order[old].y - middle.y)
        nodes[f"arm{k}"] = Node(middle.x + reach * cos(turned), middle.y + reach * sin(turned), "dead_end")
        edges[f"in{k}"] = Edge(f"arm{k}", "centre", spec.speed_limit, lanes)
        edges[f"out{k}"] = Edge("centre", f"arm{k}", spec.speed_limit, lanes)
    return Plan(nodes, edges)


def _dress_streets(plan: Plan, spec: RandomSpec) -> Plan:
    """Lane numbers by street (both directions alike) and signals by junction, drawn from the spec's seed."""
    random = Random(f"streets-{spec.seed}")
    streets = sorted({_street(e) for e in plan.edges.values()})
    lanes = {street: lanes_of(spec, 2 if random.random() < spec.two_lane_share else 1) for street in streets}
    edges = {i: replace(e, speed=spec.speed_limit, lanes=lanes[_street(e)]) for i, e in plan.edges.items()}
    meeting = [i for i in sorted(plan.nodes) if sum(i in street for street in streets) >= 3]
    signals = set(random.sample(meeting, round(spec.signal_share * len(meeting))))
    nodes = {i: replace(n, type="traffic_light") if i in signals else n for i, n in plan.nodes.items()}
    return Plan(nodes, edges)


def _street(edge: Edge) -> tuple[str, str]:
    """The same for both directions."""
    return min(edge.start, edge.end), max(edge.start, edge.end)
