"""Paths of persons: sidewalks, walking areas and crossings as one line."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.routing.walking_area import BACK, back_from, distance_to, way_across
from slrl_sumo.sumo.network import is_walking_area
from slrl_sumo.sumo.network.lanes import Lane

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

Step = tuple[str, bool]
"""An edge, and whether it is walked from its begin to its end."""


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
    steps: tuple[Step, ...]
    """Its edges."""
    ends: tuple[float, ...]
    """m along the line at which each of them ends."""
    last_edge_end: float
    """The same of the last edge that is not short (SHORT_EDGE)."""
    arrival: float | None
    """m from the begin of the last edge to the destination; None of random paths."""

    @property
    def second_edge_end(self) -> float:
        """m along the line at which the second edge ends: a person that begins its walk is before that."""
        return self.ends[min(1, len(self.ends) - 1)]


class PathDrawing:
    """A path that is being drawn.

    `side`: where on each lane, from -1, its right edge, to 0, beside its middle; `begin`: the place (m) on the lane
    `area` of a junction where it begins, if not with an edge.
    """

    def __init__(self, side: float, begin: tuple[float, float] | None = None, area: Lane | None = None) -> None:
        self._side = side
        self._points = [] if begin is None else [begin]
        self._area = area if area is not None and is_walking_area(area.id) else None
        """The walking area at its end, if it is on one."""
        self._crossings: list[tuple[int, Lane | None, str, str]] = []
        """Of each crossing: its first point, the area before it, the lane of its link, its own."""
        self._last_middle: tuple[float, float] | None = None
        """Where the middle of the crossing ends that it comes from, m; None where it comes from none."""
        self._ends: list[int] = []
        self._last_edge_end = 0

    def walk_along(self, lane: Lane, forward: bool, arrival: float | None = None) -> None:
        """Add the lane of an edge, up to `arrival` (m from its begin)."""
        shape = list(lane.points)
        if arrival is not None:
            whole, _ = line_through(shape)
            place = min(max(arrival, 0.0), lane.length) * whole.end / max(lane.length, 0.1)
            shape = whole.between(0.0, place) if forward else whole.between(place, whole.end)
        walk = _beside(shape if forward else shape[::-1], self._side, lane)
        self._points += [*_way_on(self._points, self._area, walk[0]), *walk]
        self._ends.append(len(self._points) - 1)
        if math.dist(shape[0], shape[-1]) >= SHORT_EDGE or len(self._ends) == 1:
            self._last_edge_end = self._ends[-1]
        self._area = self._last_middle = None

    def lead_through(self, lanes: Sequence[tuple[Lane, str]]) -> None:
        """Add walking areas and crossings of a junction, each with the lane from which the link to it leads."""
        for lane, link in lanes:
            if is_walking_area(lane.id):
                self._area = lane
                continue
            area, points = self._area, self._points
            middle = _directed_from(area, points[-1], lane)
            over = _beside(middle, self._side, lane)
            if area is not None and self._last_middle is not None:
                # By the middle from crossing to crossing: at the inner side of a corner, one ends where the other
                # begins, both beyond the kerb, and the way to it and back would lie on each other.
                points[-1], over[0] = self._last_middle, _beside(middle, CORNERED * self._side, lane)[0]
                points.append(_behind_kerb(area, points[-1], self._side))
                kerb = _behind_kerb(area, over[0], self._side)
                points += [*_way_on(points, area, kerb), kerb]
            points += _way_on(points, area, over[0])
            self._crossings.append((len(points), area, link, lane.id))
            points += over
            self._area, self._last_middle = None, _beside(middle, CORNERED * self._side, lane)[-1]

    def path(self, steps: Sequence[Step], arrival: float | None) -> WalkPath:
        """The path that has been drawn along the edges `steps`, to `arrival` on the last one."""
        line, along = line_through(self._points)
        crossings = [
            CrossingEntry(along[i], _wait(line, along[i], area), *lanes) for i, area, *lanes in self._crossings
        ]
        ends = tuple(along[i] for i in self._ends)
        return WalkPath(line, tuple(crossings), tuple(steps), ends, along[self._last_edge_end], arrival)


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
