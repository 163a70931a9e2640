"""The graph of the lanes that persons walk on, and paths along the edges of a walk."""

import heapq
import random
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.routing.polyline import line_through
from slrl_sumo.routing.walking.walk_path import PathDrawing, Step, WalkPath
from slrl_sumo.routing.walking.walking_area import distance_to
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.network.lanes import Lane, neighbour
from slrl_sumo.sumo.network.links import LaneLinks

RANDOM_EDGES = 12
"""Number of edges of a path without destination."""


class WalkGraph:
    """The lanes of a loaded network that persons walk on, and how they are connected."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._edge_ends = network.edge_ends
        self._lane_of: dict[str, Lane] = {}
        """Lane that persons walk on, by edge."""
        self._internal: dict[str, Lane] = {}
        for lane in network.lanes:
            if "pedestrian" not in lane.allowed:
                continue
            if lane.internal:
                self._internal[lane.id] = lane
            elif lane.edge not in self._lane_of or (
                lane.surface == Surface.SIDEWALK and self._lane_of[lane.edge].surface != Surface.SIDEWALK
            ):
                self._lane_of[lane.edge] = lane
        self._edge_of = {lane.id: edge for edge, lane in self._lane_of.items()}
        lanes = {lane.id: lane for lane in network.lanes}
        self._next_on_left = {
            lane.edge: _is_left_of(beside, lane) for lane, beside in _on_carriageways(self._lane_of, lanes)
        }
        """Whether the next lane for vehicles is to the left of the lane that persons walk on, by edge with such a
        lane."""
        walkable = {**{lane.id: lane for lane in self._lane_of.values()}, **self._internal}
        self._neighbours: dict[str, list[str]] = {lane: [] for lane in walkable}
        self._entered_from: dict[str, str] = {}
        links = LaneLinks(api, network)
        # SUMO's links have a direction; persons walk in both directions.
        for lane_id in walkable:
            for target, _ in links(lane_id):
                if target in walkable and _is_for_walking(lane_id, walkable) and _is_for_walking(target, walkable):
                    self._neighbours[lane_id].append(target)
                    self._neighbours[target].append(lane_id)
                    self._entered_from[target] = lane_id
        self._near: dict[str, list[Lane]] = {}
        """Lanes for persons inside each junction and on its edges."""
        self._found: dict[tuple[str, str, frozenset[str]], dict[str, list[str]]] = {}
        """Shortest ways through junctions, see `_ways`."""

    def path(
        self, edges: tuple[str, ...], arrival: float, side: float, x: float, y: float, here: str = ""
    ) -> WalkPath | None:
        """The path along `edges` of a person at a position (m); None if an edge is not walkable.

        `arrival`: m from the begin of the last edge. `side`: lateral position on each lane, from -1 (right edge) to 0
        (beside the middle). `here`: the edge, walking area or crossing under the person, over which the path leads.

        The direction on each edge follows from the junction that it shares with the next edge. From an edge to the
        opposite edge the path leads over the nearer of the two junctions, as SUMO's walks do.
        """
        if not edges or any(edge not in self._lane_of for edge in edges):
            return None
        ways = [self._directed(edges)]
        if len(edges) > 1 and set(self._edge_ends[edges[0]]) == set(self._edge_ends[edges[1]]):
            ways.append(self._directed(edges, backward=True))
            ways = [steps for steps in ways if self._leads_on(*steps[:2])] or ways[:1]
            ways = [steps for steps in ways if here.startswith(f":{self._left_by(*steps[0])}_")] or ways
        paths = [self._joined(steps, arrival, PathDrawing(side), f"{here}_0") for steps in ways]
        return min(paths, key=lambda one: one.line.end - one.line.nearest(x, y, end=one.second_edge_end)[0])

    def back_on(self, path: WalkPath, s: float, side: float, x: float, y: float) -> WalkPath | None:
        """A new path from its position (m) for a person that has left its `path`; None if no way leads on.

        `s`: position (m along the path) of the nearest place.
        """
        rest = path.steps[min(bisect_right(path.ends, s), len(path.steps) - 1) :]
        lane = self._lane_at(x, y, self._entered_by(*rest[0]), self._left_by(*rest[0]))
        if lane is None:
            return None
        for k, (edge, _) in enumerate(rest):
            if lane.edge == edge:
                return self._joined(rest[k:], path.arrival, PathDrawing(side))
        inside = lane.id in self._internal
        junctions = (junction_of(lane.id)[1:],) if inside else self._edge_ends[lane.edge]
        # If the person is in the junction after that edge, it walks on to the next edge.
        rest = rest[1:] if self._entered_by(*rest[0]) not in junctions and len(rest) > 1 else rest
        junction = self._entered_by(*rest[0])
        way = self._ways(lane.id, junction).get(self._lane_of[rest[0][0]].id) if junction in junctions else None
        if way is None:
            return None
        if not inside:
            forward = junction == self._edge_ends[lane.edge][1]
            return self._joined([(lane.edge, forward), *rest], path.arrival, PathDrawing(side))
        drawn = PathDrawing(side, (x, y), lane)
        drawn.lead_through(self._inside(way))
        return self._joined(rest, path.arrival, drawn)

    def _lane_at(self, x: float, y: float, *junctions: str) -> Lane | None:
        """The lane under a position (m), or the nearest lane, inside `junctions` and on their edges; None without lanes
        for persons."""
        lanes = [lane for junction in junctions for lane in self._lanes_near(junction)]
        return min(lanes, key=lambda lane: _distance(lane, x, y), default=None)

    def _lanes_near(self, junction: str) -> list[Lane]:
        """The lanes for persons inside a junction and on its edges."""
        lanes = self._near.get(junction)
        if lanes is None:
            inside = [lane for lane in self._neighbours if lane.startswith(f":{junction}_")]
            outside = (lane for one in inside for lane in self._neighbours[one] if not lane.startswith(":"))
            every = dict.fromkeys([*inside, *outside])
            lanes = [self._internal.get(one) or self._lane_of[self._edge_of[one]] for one in every]
            self._near[junction] = lanes
        return lanes

    def _leads_on(self, step: Step, following: Step) -> bool:
        """Whether walking areas and crossings lead from an edge to the following one."""
        begin, end = self._lane_of[step[0]].id, self._lane_of[following[0]].id
        return end in self._ways(begin, self._left_by(*step))

    def _left_by(self, edge: str, forward: bool) -> str:
        """The junction at the end of an edge."""
        return self._edge_ends[edge][1 if forward else 0]

    def _entered_by(self, edge: str, forward: bool) -> str:
        """The junction at the begin of an edge."""
        return self._left_by(edge, not forward)

    def random_path(self, edge: str, forward: bool, side: float, rng: random.Random) -> WalkPath | None:
        """A path that begins along `edge`, continues at random and turns back at dead ends; `side`: see `path`."""
        if edge not in self._lane_of:
            return None
        steps: list[Step] = [(edge, forward)]
        while len(steps) < RANDOM_EDGES:
            here, forward = steps[-1]
            junction = self._left_by(here, forward)
            reached = self._ways(self._lane_of[here].id, junction)
            choices = sorted(e for lane in reached if (e := self._edge_of.get(lane, here)) != here)
            if not choices:
                steps.append((here, not forward))
                continue
            chosen = rng.choice(choices)
            steps.append((chosen, self._edge_ends[chosen][0] == junction))
        return self._joined(steps, None, PathDrawing(side))

    def _directed(self, edges: tuple[str, ...], *, backward: bool = False) -> list[Step]:
        """Each edge, and whether it is walked from begin to end; `backward`: walk the first edge to its begin."""
        steps: list[Step] = []
        entered = self._edge_ends[edges[0]][1] if backward else ""
        for edge, following in pairwise(edges):
            ends = self._edge_ends[edge]
            shared = [j for j in ends if j in self._edge_ends[following]] or [ends[1]]
            # Opposite edges share both junctions: do not turn back at the junction where the person entered the edge.
            left = next((j for j in reversed(shared) if j != entered), shared[-1])
            steps.append((edge, left == ends[1]))
            entered = left
        steps.append((edges[-1], entered != self._edge_ends[edges[-1]][1]))
        return steps

    def _joined(self, steps: Sequence[Step], arrival: float | None, drawn: PathDrawing, here: str = "") -> WalkPath:
        """Continue the path `drawn` along directed edges; through the first junction over the lane `here`, if
        inside."""
        for i, (edge, forward) in enumerate(steps):
            lane, last = self._lane_of[edge], i == len(steps) - 1
            # Between two lanes of a carriageway, cars on both sides would pass within 0.5 m: persons walk at its edge.
            on_left = self._next_on_left.get(edge, forward) != forward
            drawn.walk_along(lane, forward, arrival if last else None, on_left=on_left)
            if not last:
                following = self._lane_of[steps[i + 1][0]].id
                through = self._through(lane.id, following, self._left_by(edge, forward), here if i == 0 else "")
                drawn.lead_through(self._inside(through))
        return drawn.path(steps, arrival)

    def _inside(self, lanes: Sequence[str]) -> list[tuple[Lane, str]]:
        """The `lanes` after the first one that are inside a junction, each with the lane from which its link leads."""
        pairs = ((before, lane) for before, lane in pairwise(lanes) if lane in self._internal)
        return [(self._internal[lane], self._entered_from.get(lane, before)) for before, lane in pairs]

    def _through(self, begin: str, end: str, junction: str, here: str) -> list[str]:
        """Lanes from `begin` to `end` over the walking areas and crossings of a junction; only these two without a way.

        The way leads over `here`, if that lane is inside the junction: a person that SUMO has led to a crossing would
        otherwise cut across to another crossing.
        """
        if here in self._internal and here.startswith(f":{junction}_"):
            begun = self._ways(begin, junction).get(here)
            rest = self._ways(here, junction, frozenset(begun[:-1])).get(end) if begun else None
            if begun and rest:
                return begun + rest[1:]
        return self._ways(begin, junction).get(end, [begin, end])

    def _ways(self, begin: str, junction: str, without: frozenset[str] = frozenset()) -> dict[str, list[str]]:
        """The shortest ways from a lane to all lanes inside a junction and on its edges, by target lane.

        Each way includes both lanes. SUMO's persons use the same ways; learned pedestrians also obey red signals.
        """
        known = self._found.get((begin, junction, without))
        if known is not None:
            return known
        todo: list[tuple[float, list[str]]] = [(0.0, [begin])]
        ways = self._found[begin, junction, without] = {}
        while todo:
            length, way = heapq.heappop(todo)
            here = way[-1]
            if here in ways or here in without:
                continue
            ways[here] = way
            if here != begin and not here.startswith(f":{junction}_"):
                continue
            for lane in self._neighbours[here]:
                # A way may enter and leave the junction, but not follow an edge.
                inside = lane.startswith(f":{junction}_")
                if inside or here.startswith(":"):
                    further = self._internal[lane].length if inside else 0.0
                    heapq.heappush(todo, (length + further, [*way, lane]))
        return ways


def _on_carriageways(walked: Mapping[str, Lane], lanes: Mapping[str, Lane]) -> Iterator[tuple[Lane, Lane]]:
    """The lanes of vehicles among those `walked`, by edge, that have a next lane of vehicles, each with that lane."""
    for lane in walked.values():
        beside = neighbour(lane, 1, lanes)
        if beside is not None and lane.surface == beside.surface == Surface.ROAD:
            yield lane, beside


def _is_left_of(lane: Lane, other: Lane) -> bool:
    """Whether a lane begins to the left of the `other` one; to the right where traffic keeps to the left."""
    (x0, y0), (x1, y1), (x, y) = *other.points[:2], lane.points[0]
    return (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0)


def _distance(lane: Lane, x: float, y: float) -> float:
    """Distance (m) from a lane to a position (m); 0 on the lane."""
    if is_walking_area(lane.id):
        return max(distance_to(lane.shape, np.array([[x, y]])).item(), 0.0)
    line, _ = line_through(list(lane.points))
    return max(line.place(x, y, 0.0, line.end)[2] - 0.5 * lane.width, 0.0)


def _is_for_walking(lane: str, lanes: dict[str, Lane]) -> bool:
    """Whether a lane is not a carriageway through a junction: such carriageways may admit persons, too."""
    return not lane.startswith(":") or lanes[lane].surface == Surface.CROSSING or is_walking_area(lane)
