"""Conflict areas: the parts of lanes inside a junction that cross or join other lanes."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.routing.lane_proximity import SPACING, near_parts, sampled
from slrl_sumo.scene.geometry import Floats

SWING, LONG = 0.1, 5.0
"""Room (m) beside the box of a turning vehicle, per m of its length up to LONG m: 0.5 m for a car, 0.16 m for a
bicycle. Lanes are 3.2 m apart, so that a lorry 2.5 m wide still fits beside a car."""
CROSSED = 2.0
"""Distance (m) between the centre lines of two lanes below which a vehicle on either lane blocks the other lane."""
STEP = 0.1
"""Resolution (m) of the lane distances for which areas are computed."""
TURNS = 0.35
"""Change of direction (rad) along a way from which vehicles swing out."""
TOGETHER = 0.9
"""Least cosine between the directions of two lanes that lead into, or out of, an area side by side."""


def half_width(length: float, width: float) -> float:
    """Room (m) that a turning vehicle of this size needs to either side of the centre line of its lane."""
    return 0.5 * width + SWING * min(length, LONG)


class ConflictArea(NamedTuple):
    """The part of a lane that is too close to another lane, in m along each of the two lanes."""

    begin: float
    end: float
    other_begin: float
    other_end: float
    together: bool
    """Both lanes lead into the area in the same direction: one road user can follow the other."""
    abreast: bool
    """Both lanes also lead out of the area in the same direction: two road users can pass it side by side."""

    def swapped(self) -> "ConflictArea":
        """The same area with the two lanes exchanged."""
        return ConflictArea(self.other_begin, self.other_end, self.begin, self.end, self.together, self.abreast)


class SharedArea(NamedTuple):
    """The conflict area of two lanes of two ways."""

    lane: int
    """Index of the lane on the first way."""
    other: int
    """Index of the lane on the second way."""
    area: ConflictArea


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """The sequence of lanes on which road users pass a junction; equal sequences share one object."""

    lanes: tuple[str, ...]
    origin: str
    """Lane outside the junction that leads to these lanes."""
    turns: bool
    """Whether the way turns (TURNS), so that vehicles need more room than their width."""
    pace: float = math.inf
    """Lowest speed limit (m/s) of the lanes, which SUMO's networks derive from the radius of the turn."""


class ConflictAreas:
    """The conflict areas of pairs of lanes, each computed on first use."""

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._points: dict[str, Floats] = {}
        self._areas: dict[tuple[str, str, int], ConflictArea | None] = {}
        self._ways: dict[tuple[str, ...], Way] = {}
        self._crossed_until: dict[str, float] = {}
        self._of_ways: dict[tuple[Way, Way, float, float], tuple[SharedArea, ...]] = {}

    def crossed_until(self, via: str) -> float:
        """Distance (m) from the begin of the internal lane `via` to where no other lane or pedestrian crossing crosses
        its way any more, at most SPACING too far; 0 if none does.

        Lanes of the same origin, and ways to the same target lane, do not count.
        """
        until = self._crossed_until.get(via)
        if until is None:
            lanes, target = self._through(via)
            before = until = 0.0
            for lane in lanes:
                for other in self._graph.inside[junction_of(via)]:
                    if self._graph.origin(other) == self._graph.origin(via) or self._through(other)[1] == target:
                        continue
                    if (area := self.between(lane, other, CROSSED)) is not None:
                        until = max(until, before + area.end + SPACING)
                before += self._points_of(lane).item(-1, 2)
            self._crossed_until[via] = until
        return until

    def _through(self, via: str) -> tuple[tuple[str, ...], str]:
        """The internal lanes from `via` on, and the lane after the junction ('' without one)."""
        lanes: list[str] = []
        while via.startswith(":") and via not in lanes:
            lanes.append(via)
            via = next((inner or target for target, inner in self._graph.links(via)), "")
        return tuple(lanes), via

    def add_line(self, name: str, line: Floats) -> None:
        """Add a line, points (k, 2) in m, that is compared in the same way as a lane, under a name."""
        if name not in self._points:
            self._points[name] = sampled(line)

    def between(self, lane: str, other: str, apart: float) -> ConflictArea | None:
        """The conflict area of two lanes whose centre lines must be `apart` m from each other; None without one."""
        steps = math.ceil(apart / STEP - 1e-6)
        key = (lane, other, steps)
        if key not in self._areas:
            self._areas[key] = area = _area(self._points_of(lane), self._points_of(other), steps * STEP)
            self._areas[other, lane, steps] = None if area is None else area.swapped()
        return self._areas[key]

    def way(self, lanes: tuple[str, ...]) -> Way:
        """The way along lanes of a junction, or along lines added with `add_line`."""
        way = self._ways.get(lanes)
        if way is None:
            directions = np.concatenate([self._points_of(lane)[:, 3:] for lane in lanes])
            turns = bool((directions @ directions[0] < math.cos(TURNS)).any())
            limits = [self._graph.lanes[lane].max_speed for lane in lanes if lane in self._graph.lanes]
            way = self._ways[lanes] = Way(lanes, self._graph.origin(lanes[0]), turns, min(limits, default=math.inf))
        return way

    def of_ways(self, way: Way, other: Way, apart: float, abreast: float) -> tuple[SharedArea, ...]:
        """The conflict areas of two ways, see `between`; none where both ways come from the same lane.

        `apart`: least distance (m) between the centre lines of two lanes. `abreast`: the same for two lanes that lead
        through an area side by side. Results are kept by pairs of ways: each decision asks for many pairs, and most
        pairs share no area.
        """
        key = (way, other, apart, abreast)
        shared = self._of_ways.get(key)
        if shared is None:
            found = []
            if way.origin != other.origin:
                for i, lane in enumerate(way.lanes):
                    for j, another in enumerate(other.lanes):
                        area = self.between(lane, another, apart)
                        if area is not None and area.abreast:
                            area = self.between(lane, another, abreast)
                        if area is not None:
                            found.append(SharedArea(i, j, area))
            shared = self._of_ways[key] = tuple(found)
        return shared

    def _points_of(self, lane: str) -> Floats:
        """Points of a lane every SPACING m, (points, 5): x, y, m along the lane, and the direction as a unit vector."""
        points = self._points.get(lane)
        if points is None:
            points = self._points[lane] = sampled(self._graph.lanes[lane].shape)
        return points


def _area(mine: Floats, theirs: Floats, apart: float) -> ConflictArea | None:
    first, last, their_first, their_last = near_parts(mine, theirs, apart)
    if first < 0:
        return None
    begin, end, their_begin, their_end = mine[first], mine[last], theirs[their_first], theirs[their_last]
    into, out = (bool(a[3] * b[3] + a[4] * b[4] > TOGETHER) for a, b in ((begin, their_begin), (end, their_end)))
    return ConflictArea(begin.item(2), end.item(2), their_begin.item(2), their_end.item(2), into, into and out)
