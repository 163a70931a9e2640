"""Paths of persons along the edges of their walks: sidewalks, walking areas and crossings as one line."""

import heapq
import math
import random
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.routing.walking_area import BACK, back_from, distance_to, way_across
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.lanes import Lane
from slrl_sumo.sumo.links import LaneLinks, edge_junctions
from slrl_sumo.sumo.network import Network, is_walking_area

RANDOM_EDGES = 12
"""Edges of a path without destination."""
CLEARANCE = 0.3
"""m kept from the edges of lanes."""
ASIDE = 0.3
"""m kept to the right of their middle, where they are that wide: two that meet pass each other. With 0, those at the
middle walked into each other in crowds (4.3 instead of 3.5 contacts per 1,000 decisions)."""
OFF_VEHICLES = 1.6
"""m kept likewise on lanes of vehicles, which drive in their middle: those that came towards a car stopped before it,
and it before them."""
CORNERED = 0.3
"""Share of their distance to the middle that persons keep where they come from another crossing or go to one."""
WAITING_DISTANCE, FARTHEST_BACK = 0.6, 3.0
"""m before a crossing at which persons wait for its signal, at least and at most."""
SHORT_EDGE = 5.0
"""m between its ends below which an edge is too short to hand a person back to SUMO on it."""


@dataclass(frozen=True)
class CrossingEntry:
    """Where a path enters a crossing."""

    s: float
    """m along the path."""
    wait: float
    """m along the path at which persons wait for its signal."""
    lane: str
    """The walking area from which the link with the signal leads to the crossing; it may lie at the other end."""
    crossing: str


@dataclass(frozen=True)
class WalkPath:
    """One line from a person's first edge to its destination."""

    line: Polyline
    crossings: tuple[CrossingEntry, ...]
    second_edge_end: float
    """m along the line at which the second edge ends: a person that begins its walk is before that."""
    last_edge_end: float
    """m along the line at which the last edge ends that is not short (SHORT_EDGE)."""


class WalkGraph:
    """The lanes of a loaded network that persons walk on, and how they are connected."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._lane_of: dict[str, Lane] = {}
        """The lane that persons walk on, by edge."""
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
        walkable = {**{lane.id: lane for lane in self._lane_of.values()}, **self._internal}
        self._neighbours: dict[str, list[str]] = {lane: [] for lane in walkable}
        self._entered_from: dict[str, str] = {}
        links = LaneLinks(api, network)
        # SUMO's links have a direction; persons walk either way.
        for lane_id in walkable:
            for target, _ in links(lane_id):
                if target in walkable and _is_for_walking(lane_id, walkable) and _is_for_walking(target, walkable):
                    self._neighbours[lane_id].append(target)
                    self._neighbours[target].append(lane_id)
                    self._entered_from[target] = lane_id
        self._junctions: dict[str, tuple[str, str]] = {}

    def path(
        self, edges: tuple[str, ...], arrival: float, side: float, x: float, y: float, here: str = ""
    ) -> WalkPath | None:
        """The path along `edges` to `arrival` (m from the begin of the last edge), for a person at a position (m); None
        where an edge is not walkable. `side`: where on each lane, from -1, its right edge, to 0, beside its middle.
        `here`: the edge, walking area or crossing under the person, which the path leads over.

        The direction on each edge follows from the junction that it shares with the next one. From an edge to the
        opposite one the path goes by the nearer of the two junctions, as SUMO's walks do.
        """
        if not edges or any(edge not in self._lane_of for edge in edges):
            return None
        ways = [self._directed(edges)]
        if len(edges) > 1 and set(self._junctions_of(edges[0])) == set(self._junctions_of(edges[1])):
            ways.append(self._directed(edges, backward=True))
            ways = [steps for steps in ways if self._leads_on(*steps[:2])] or ways[:1]
            ways = [steps for steps in ways if here.startswith(f":{self._left_by(*steps[0])}_")] or ways
        paths = [self._joined(steps, arrival, side, f"{here}_0") for steps in ways]
        return min(paths, key=lambda one: one.line.end - one.line.nearest(x, y, end=one.second_edge_end)[0])

    def _leads_on(self, step: tuple[str, bool], following: tuple[str, bool]) -> bool:
        """Whether walking areas and crossings lead from an edge to the following one."""
        begin, end = self._lane_of[step[0]].id, self._lane_of[following[0]].id
        return end in self._ways(begin, self._left_by(*step))

    def _left_by(self, edge: str, forward: bool) -> str:
        """The junction at the end of an edge."""
        return self._junctions_of(edge)[1 if forward else 0]

    def random_path(self, edge: str, forward: bool, side: float, rng: random.Random) -> WalkPath | None:
        """A path that begins along `edge` and continues at random, at dead ends back; `side` as in `path`."""
        if edge not in self._lane_of:
            return None
        steps = [(edge, forward)]
        while len(steps) < RANDOM_EDGES:
            here, forward = steps[-1]
            junction = self._left_by(here, forward)
            reached = self._ways(self._lane_of[here].id, junction)
            choices = sorted(e for lane in reached if (e := self._edge_of.get(lane, here)) != here)
            if not choices:
                steps.append((here, not forward))
                continue
            chosen = rng.choice(choices)
            steps.append((chosen, self._junctions_of(chosen)[0] == junction))
        return self._joined(steps, None, side)

    def _directed(self, edges: tuple[str, ...], *, backward: bool = False) -> list[tuple[str, bool]]:
        """Each edge, and whether it is walked from its begin to its end; `backward`: the first one to its begin."""
        steps: list[tuple[str, bool]] = []
        entered = self._junctions_of(edges[0])[1] if backward else ""
        for edge, following in pairwise(edges):
            ends = self._junctions_of(edge)
            shared = [j for j in ends if j in self._junctions_of(following)] or [ends[1]]
            # Opposite edges share both ends: continue, do not turn at the end where the first one was entered.
            left = next((j for j in reversed(shared) if j != entered), shared[-1])
            steps.append((edge, left == ends[1]))
            entered = left
        steps.append((edges[-1], entered != self._junctions_of(edges[-1])[1]))
        return steps

    def _joined(self, steps: list[tuple[str, bool]], arrival: float | None, side: float, here: str = "") -> WalkPath:
        """The path along directed edges; through the first junction by the lane `here`, if that is in it."""
        points: list[tuple[float, float]] = []
        crossings: list[tuple[int, Lane | None, str, str]] = []
        second_edge_end = last_edge_end = 0
        area: Lane | None = None
        crossed, last_middle = False, (0.0, 0.0)
        for i, (edge, forward) in enumerate(steps):
            lane = self._lane_of[edge]
            shape = list(lane.points)
            if i == len(steps) - 1 and arrival is not None:
                whole, _ = line_through(shape)
                place = min(max(arrival, 0.0), lane.length) * whole.end / max(lane.length, 0.1)
                shape = whole.between(0.0, place) if forward or len(steps) == 1 else whole.between(place, whole.end)
            walk = _beside(shape if forward else shape[::-1], side, lane)
            points += [*_way_on(points, area, walk[0]), *walk]
            crossed = False
            if math.dist(shape[0], shape[-1]) >= SHORT_EDGE or not last_edge_end:
                last_edge_end = len(points) - 1
            if i <= 1:
                second_edge_end = len(points) - 1
            if i == len(steps) - 1:
                break
            area = None
            following = self._lane_of[steps[i + 1][0]].id
            lanes = self._through(lane.id, following, self._left_by(edge, forward), here if i == 0 else "")
            for before, inside in pairwise(lanes):
                if inside not in self._internal:
                    continue
                if is_walking_area(inside):
                    area = self._internal[inside]
                    continue
                crossing = self._internal[inside]
                middle = _directed_from(area, points[-1], crossing)
                over = _beside(middle, side, crossing)
                if area is not None and crossed:
                    # By the middle from crossing to crossing: at the inner side of a corner, one ends where the other
                    # begins, both beyond the kerb, and the way to it and back would lie on each other.
                    points[-1], over[0] = last_middle, _beside(middle, CORNERED * side, crossing)[0]
                    points.append(_behind_kerb(area, points[-1], side))
                    kerb = _behind_kerb(area, over[0], side)
                    points += [*_way_on(points, area, kerb), kerb]
                points += _way_on(points, area, over[0])
                crossings.append((len(points), area, self._entered_from.get(inside, before), inside))
                points += over
                last_middle = _beside(middle, CORNERED * side, crossing)[-1]
                area, crossed = None, True
        line, along = line_through(points)
        return WalkPath(
            line,
            tuple(CrossingEntry(along[i], _wait(line, along[i], area), *lanes) for i, area, *lanes in crossings),
            along[second_edge_end],
            along[last_edge_end],
        )

    def _through(self, begin: str, end: str, junction: str, here: str) -> list[str]:
        """Lanes from `begin` to `end` over the walking areas and crossings of a junction, or only these two; by `here`
        if that is one of these: a person that SUMO has led to a crossing would cut across to another one."""
        if here in self._internal and here.startswith(f":{junction}_"):
            begun = self._ways(begin, junction).get(here)
            rest = self._ways(here, junction, frozenset(begun[:-1])).get(end) if begun else None
            if begun and rest:
                return begun + rest[1:]
        return self._ways(begin, junction).get(end, [begin, end])

    def _ways(self, begin: str, junction: str, without: frozenset[str] = frozenset()) -> dict[str, list[str]]:
        """The shortest way from a lane to each one reached from it inside a junction and on its edges, by the lane that
        it leads to; both are included. SUMO's persons go so; these mind red lights, too."""
        todo: list[tuple[float, list[str]]] = [(0.0, [begin])]
        ways: dict[str, list[str]] = {}
        while todo:
            length, way = heapq.heappop(todo)
            here = way[-1]
            if here in ways or here in without:
                continue
            ways[here] = way
            if here != begin and not here.startswith(f":{junction}_"):
                continue
            for lane in self._neighbours[here]:
                # Into the junction and out of it, but not along an edge.
                inside = lane.startswith(f":{junction}_")
                if inside or here.startswith(":"):
                    further = self._internal[lane].length if inside else 0.0
                    heapq.heappush(todo, (length + further, [*way, lane]))
        return ways

    def _junctions_of(self, edge: str) -> tuple[str, str]:
        ends = self._junctions.get(edge)
        if ends is None:
            ends = self._junctions[edge] = edge_junctions(self._api, edge)
        return ends


def _way_on(
    points: list[tuple[float, float]], area: Lane | None, place: tuple[float, float]
) -> list[tuple[float, float]]:
    """The way from the end of a path, `points`, across a walking area, if there is one, to a place."""
    return way_across(area.shape, points[-1], place, CLEARANCE) if points and area is not None else []


def _behind_kerb(area: Lane, place: tuple[float, float], side: float) -> tuple[float, float]:
    """A place on a walking area near the end of a crossing, which may be beside it: from one crossing to the next, a
    path would not touch the area. Persons on different sides are at different distances from the edge."""
    return back_from(area.shape, *place, BACK * (1.0 + abs(side))) or place


def _wait(line: Polyline, s: float, area: Lane | None) -> float:
    """m along a line at which persons wait for a crossing that begins at `s`: on the walking area before it."""
    if area is None:
        return s - WAITING_DISTANCE
    places = s - np.arange(WAITING_DISTANCE, FARTHEST_BACK, 0.2)
    outside = distance_to(area.shape, np.array([line.at(place)[:2] for place in places.tolist()]))
    behind = outside <= -BACK
    # Where no place is that far inside, as on narrow areas, the one that is farthest.
    return places.item(int(behind.argmax() if behind.any() else outside.argmin()))


def _directed_from(area: Lane | None, here: tuple[float, float], crossing: Lane) -> list[tuple[float, float]]:
    """The middle of a crossing from the end that a walking area touches; without one, from the end nearer to `here`.

    Around the corner of two streets, the nearer end can be the one on the other side of the carriageway.
    """
    shape = list(crossing.points)
    if area is None:
        begin, end = (math.dist(one, here) for one in (shape[0], shape[-1]))
    else:
        begin, end = np.maximum(distance_to(area.shape, crossing.shape[[0, -1]]), 0.0).tolist()
    return shape if begin <= end else shape[::-1]


def _beside(shape: list[tuple[float, float]], side: float, lane: Lane) -> list[tuple[float, float]]:
    """The line beside the middle of a lane, which is `shape` in the direction of walking; `side` as in `path`."""
    points = np.array(shape)
    along = np.gradient(points, axis=0)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 0.01)[:, None]
    most = max(0.5 * lane.width - CLEARANCE, 0.0)
    least = min(OFF_VEHICLES if lane.surface == Surface.ROAD else ASIDE, most)
    points -= (least - side * (most - least)) * left
    return [(x, y) for x, y in points.tolist()]


def _is_for_walking(lane: str, lanes: dict[str, Lane]) -> bool:
    """Whether a lane is no carriageway through a junction: these may admit persons, too."""
    return not lane.startswith(":") or lanes[lane].surface == Surface.CROSSING or is_walking_area(lane)
