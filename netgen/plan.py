"""Plans of road networks, the input of netconvert: nodes, edges and crossings in SUMO's plain XML.

See https://sumo.dlr.de/docs/Networks/PlainXML.html.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from slrl_sumo.netgen.specs import IntersectionSpec, RandomSpec, RoundaboutSpec, SharedSpaceSpec

SIDEWALK_WIDTH = "2.00"
CYCLE_LANE_WIDTH = "1.50"
SHARED_PATH_WIDTH = "2.50"
"""m, in SUMO's notation."""


@dataclass(frozen=True)
class Node:
    """A junction or the end of a street, at (x, y) in m; `type` as SUMO names them."""

    x: float
    y: float
    type: str


@dataclass(frozen=True)
class Edge:
    """One direction of a street."""

    start: str
    end: str
    speed: float
    """m/s."""
    lanes: tuple[Mapping[str, str], ...]
    """Attributes of each lane, from the right-hand side."""
    shape: tuple[tuple[float, float], ...] = ()
    """Points from the start to the end, in m; without them the edge is straight."""


@dataclass(frozen=True)
class Plan:
    """Nodes and directed edges by id, before netconvert."""

    nodes: Mapping[str, Node]
    edges: Mapping[str, Edge]
    ring: tuple[str, ...] = ()
    """Edges of the ring of a roundabout: traffic on them has priority over entering traffic."""
    crossings: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Nodes with a crossing, and the two edges that it crosses, besides the crossings that netconvert guesses."""


def lanes_of(
    spec: IntersectionSpec | RandomSpec | RoundaboutSpec | SharedSpaceSpec, car_lanes: int
) -> tuple[Mapping[str, str], ...]:
    """One direction's lanes, from the right: sidewalk, cycle lane, car lanes; or one lane for all on a shared space."""
    if isinstance(spec, SharedSpaceSpec):
        return ({"allow": "passenger bicycle pedestrian", "width": f"{spec.width / 2:g}"},)
    made: list[Mapping[str, str]] = []
    barred = []
    if spec.sidewalks:
        made.append({"allow": "pedestrian", "width": SIDEWALK_WIDTH})
        barred.append("pedestrian")
    if spec.cycle_lanes:
        # Without a sidewalk, pedestrians use the edge of the street, which is the cycle lane.
        path = {"allow": "bicycle pedestrian", "width": SHARED_PATH_WIDTH}
        made.append({"allow": "bicycle", "width": CYCLE_LANE_WIDTH} if spec.sidewalks else path)
        barred = ["pedestrian", "bicycle"]
    car_lane = {"disallow": " ".join(barred)} if barred else {}
    return (*made, *[car_lane] * car_lanes)


def write_plan(plan: Plan, folder: Path) -> list[str]:
    """Write `plan` to files in `folder`; returns the options that make netconvert read them."""
    files = {"--node-files": ("plan.nod.xml", _nodes_xml(plan)), "--edge-files": ("plan.edg.xml", _edges_xml(plan))}
    if plan.crossings:
        files["--connection-files"] = ("plan.con.xml", _crossings_xml(plan.crossings))
    for name, content in files.values():
        (folder / name).write_bytes(content)
    return [part for option, (name, _) in files.items() for part in (option, name)]


def _nodes_xml(plan: Plan) -> bytes:
    root = etree.Element("nodes")
    for i, n in plan.nodes.items():
        etree.SubElement(root, "node", {"id": i, "x": f"{n.x:.2f}", "y": f"{n.y:.2f}", "type": n.type})
    return etree.tostring(root, pretty_print=True)


def _edges_xml(plan: Plan) -> bytes:
    root = etree.Element("edges")
    for i, e in plan.edges.items():
        street = {"id": i, "from": e.start, "to": e.end, "numLanes": str(len(e.lanes)), "speed": f"{e.speed:g}"}
        if e.shape:
            street["shape"] = " ".join(f"{x:.2f},{y:.2f}" for x, y in e.shape)
        edge = etree.SubElement(root, "edge", street)
        for k, lane in enumerate(e.lanes):
            etree.SubElement(edge, "lane", {"index": str(k), **lane})
    if plan.ring:
        nodes = " ".join(plan.edges[i].start for i in plan.ring)
        etree.SubElement(root, "roundabout", {"nodes": nodes, "edges": " ".join(plan.ring)})
    return etree.tostring(root, pretty_print=True)


def _crossings_xml(crossings: Mapping[str, tuple[str, str]]) -> bytes:
    root = etree.Element("connections")
    for node, edges in crossings.items():
        etree.SubElement(root, "crossing", {"node": node, "edges": " ".join(edges), "priority": "true"})
    return etree.tostring(root, pretty_print=True)
