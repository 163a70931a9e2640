"""Where the lanes inside a junction cross or join each other."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.routing.lane_proximity import near_parts, sampled
from slrl_sumo.scene.geometry import Floats

SWING, LONG = 0.1, 5.0
"""m beside the box of a vehicle, for each m of its length up to LONG m, that it needs in a turn: 0.5 m of a car, 0.16 m
of a bicycle. Lanes are 3.2 m apart, so that a lorry of 2.5 m still fits beside a car."""
CROSSED = 2.0
"""m between the centre lines of two lanes below which vehicles on the one stand in the way of those on the other."""
STEP = 0.1
"""m: areas are computed for distances of the lanes in these steps."""
TURNS = 0.35
"""rad between the first direction of a way and another one, from which vehicles on it swing out."""
TOGETHER = 0.9
"""Least cosine between two lanes where an area begins and where it ends, if they lead through it side by side."""


def half_width(length: float, width: float) -> float:
    """m to either side of its lane's centre line that a vehicle of this size needs in a junction."""
    return 0.5 * width + SWING * min(length, LONG)


class ConflictArea(NamedTuple):
    """Where a lane is too close to another one, in m along each of the two."""

    begin: float
    end: float
    other_begin: float
    other_end: float
    together: bool
    """Both lead into it in the same direction: one road user can follow the other."""
    abreast: bool
    """Both lead out of it in that direction, too: two road users can pass it side by side."""

    def swapped(self) -> "ConflictArea":
        """The area as the other lane has it."""
        return ConflictArea(self.other_begin, self.other_end, self.begin, self.end, self.together, self.abreast)


class SharedArea(NamedTuple):
    """The conflict area of two lanes of two ways."""

    lane: int
    """Number of the lane on the one way."""
    other: int
    """On the other way."""
    area: ConflictArea


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """Lanes of a junction on which road users pass it; the same object wherever the lanes are the same."""

    lanes: tuple[str, ...]
    origin: str
    """The lane outside the junction that leads to them."""
    turns: bool
    """Whether it turns (TURNS), so that vehicles on it need more room than their width."""
    pace: float = math.inf
    """m/s: the lowest limit of its lanes, which SUMO's networks have from the radius of the turn."""


class ConflictAreas:
    """The conflict areas of pairs of lanes, computed when they are first asked for."""

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._points: dict[str, Floats] = {}
        self._areas: dict[tuple[str, str, int], ConflictArea | None] = {}
        self._ways: dict[tuple[str, ...], Way] = {}
        self._crossed: dict[str, bool] = {}
        self._of_ways: dict[tuple[Way, Way, float, float], tuple[SharedArea, ...]] = {}

    def is_crossed(self, via: str) -> bool:
        """Whether other lanes or pedestrian crossings lead across the way that begins with an internal lane, and not to
        the same lane as it does."""
        crossed = self._crossed.get(via)
        if crossed is None:
            lanes, target = self._through(via)
            crossed = self._crossed[via] = any(
                self._graph.origin(other) != self._graph.origin(via)
                and self._through(other)[1] != target
                and self.between(lane, other, CROSSED) is not None
                for lane in lanes
                for other in self._graph.inside[junction_of(via)]
            )
        return crossed

    def _through(self, via: str) -> tuple[tuple[str, ...], str]:
        """The internal lanes from `via` on, and the lane after the junction; '' where there is none."""
        lanes: list[str] = []
        while via.startswith(":") and via not in lanes:
            lanes.append(via)
            via = next((inner or target for target, inner in self._graph.links(via)), "")
        return tuple(lanes), via

    def add_line(self, name: str, line: Floats) -> None:
        """Let `name` be a line, points (k, 2) in m, that is compared as lanes are."""
        if name not in self._points:
            self._points[name] = sampled(line)

    def between(self, lane: str, other: str, apart: float) -> ConflictArea | None:
        """The conflict area of a lane with another one for vehicles that touch where their centre lines are less than
        `apart` m from each other; None where both lanes can be used at once."""
        steps = math.ceil(apart / STEP - 1e-6)
        key = (lane, other, steps)
        if key not in self._areas:
            self._areas[key] = area = _area(self._points_of(lane), self._points_of(other), steps * STEP)
            self._areas[other, lane, steps] = None if area is None else area.swapped()
        return self._areas[key]

    def way(self, lanes: tuple[str, ...]) -> Way:
        """The way along lanes of a junction, or along lines (see `add_line`)."""
        way = self._ways.get(lanes)
        if way is None:
            directions = np.concatenate([self._points_of(lane)[:, 3:] for lane in lanes])
            turns = bool((directions @ directions[0] < math.cos(TURNS)).any())
            limits = [self._graph.lanes[lane].max_speed for lane in lanes if lane in self._graph.lanes]
            way = self._ways[lanes] = Way(lanes, self._graph.origin(lanes[0]), turns, min(limits, default=math.inf))
        return way

    def of_ways(self, way: Way, other: Way, apart: float, abreast: float) -> tuple[SharedArea, ...]:
        """The conflict areas of the lanes of a way with those of another one, see `between`; none where both ways come
        from the same lane. Where both lead in the same direction, `abreast` m are enough instead of `apart`.

        Kept by ways: vehicles ask this of each other in each decision, and most ways share nothing.
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
        """x, y, m along a lane and its direction, a unit vector, (points, 5), every SPACING m."""
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
