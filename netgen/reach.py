"""Which edges of a net are connected, by vehicle class."""

import heapq
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from lxml import etree


@dataclass(frozen=True)
class NetGraph:
    """Edges of a net and their connections for the vehicle classes of interest."""

    edges: Mapping[str, "NetEdge"]
    """The streets' edges (no internal ones), by id, in the net's order."""
    dead_ends: frozenset[str]
    """Junctions at the fringe, where road users enter and leave."""
    follows: Mapping[tuple[str, str], frozenset[str]]
    """(class, edge) -> edges one step further; also through walking areas and crossings, which count as edges."""
    inside: Mapping[str, float]
    """Lengths (m) of walking areas, crossings and all other edges inside junctions."""


@dataclass(frozen=True)
class NetEdge:
    """One direction of a street."""

    start: str
    end: str
    length: float
    """m."""
    classes: frozenset[str]
    """Those of CLASSES that may use at least one lane."""

    @property
    def ends(self) -> frozenset[str]:
        """Both of its junctions."""
        return frozenset((self.start, self.end))


CLASSES = ("passenger", "bicycle", "pedestrian")


def read_graph(net: bytes) -> NetGraph:
    """The graph of the contents of a .net.xml.

    Pedestrians walk in both directions on every surface, vehicles only with the lane. At dead ends pedestrians do not
    change to the other side of the street, although SUMO allows it: no path should lead around the end of the net.
    """
    root = etree.fromstring(net)
    allowed = {str(lane.attrib["id"]): _classes(lane) for lane in root.iter("lane")}
    edges, inside = {}, {}
    for edge in root.iter("edge"):
        lanes = edge.findall("lane")
        length = float(lanes[0].attrib["length"])
        if "from" not in edge.attrib:
            inside[str(edge.attrib["id"])] = length
        else:
            classes = frozenset[str]().union(*(allowed[str(lane.attrib["id"])] for lane in lanes))
            edges[str(edge.attrib["id"])] = NetEdge(str(edge.attrib["from"]), str(edge.attrib["to"]), length, classes)
    dead_ends = frozenset(str(j.attrib["id"]) for j in root.iter("junction") if j.attrib["type"] == "dead_end")
    follows: dict[tuple[str, str], set[str]] = defaultdict(set)
    for c in root.iter("connection"):
        a, b = str(c.attrib["from"]), str(c.attrib["to"])
        both = allowed[f"{a}_{c.get('fromLane')}"] & allowed[f"{b}_{c.get('toLane')}"]
        for name in both & {"passenger", "bicycle"}:
            follows[name, a].add(b)
        at_dead_end = any(i.startswith(":") and i[1:].rpartition("_")[0] in dead_ends for i in (a, b))
        if "pedestrian" in both and not at_dead_end:
            follows["pedestrian", a].add(b)
            follows["pedestrian", b].add(a)
    return NetGraph(edges, dead_ends, {k: frozenset(v) for k, v in follows.items()}, inside)


def reachable(graph: NetGraph, start: str, vehicle_class: str) -> frozenset[str]:
    """Ids of the streets' edges that a road user of `vehicle_class` on the edge `start` gets to, `start` included."""
    seen = {start}
    ahead = [start]
    while ahead:
        new = graph.follows.get((vehicle_class, ahead.pop()), frozenset()) - seen
        seen |= new
        ahead += new
    return frozenset(seen & graph.edges.keys())


def shortest_path(graph: NetGraph, start: str, end: str, vehicle_class: str) -> list[str]:
    """The streets' edges from `start` to `end`, both included, by the shortest way for `vehicle_class`.

    Raises ValueError where `end` is not reachable.
    """
    ahead: list[tuple[float, str, tuple[str, ...]]] = [(0.0, start, (start,))]
    seen = set()
    while ahead:
        covered, edge, path = heapq.heappop(ahead)
        if edge == end:
            return [e for e in path if e in graph.edges]
        if edge in seen:
            continue
        seen.add(edge)
        for onward in graph.follows.get((vehicle_class, edge), frozenset()) - seen:
            length = graph.edges[onward].length if onward in graph.edges else graph.inside[onward]
            heapq.heappush(ahead, (covered + length, onward, (*path, onward)))
    raise ValueError(f"no way leads from {start} to {end} for the class {vehicle_class}")


def _classes(lane: etree._Element) -> frozenset[str]:
    """Those of CLASSES that may use a lane: empty `allow` and `disallow` mean all."""
    if "allow" in lane.attrib:
        named = str(lane.attrib["allow"]).split()
        return frozenset(CLASSES if "all" in named else set(CLASSES) & set(named))
    return frozenset(set(CLASSES) - set(str(lane.attrib.get("disallow", "")).split()))
