"""Paths of persons: one line along sidewalks, walking areas and crossings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.routing.walking.walking_area import BACK, back_from, distance_to, way_across
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network import is_walking_area
from slrl_sumo.sumo.network.lanes import Lane

CLEARANCE = 0.3
"""Distance (m) from the edges of lanes."""
ASIDE = 0.3
"""Distance (m) to the right of the middle of lanes, if they are wide enough: oncoming pedestrians pass each other. With
0, pedestrians near the middle walked into each other in crowds (4.3 instead of 3.5 contacts per 1,000 decisions)."""
OFF_VEHICLES = 1.6
"""The same on lanes of vehicles, which drive in the middle: with less, a pedestrian and an oncoming car stopped for
each other."""
CORNERED = 0.3
"""Share of their distance to the middle that persons keep between two crossings."""
WAITING_DISTANCE, FARTHEST_BACK = 0.6, 3.0
"""Least and greatest distance (m) before a crossing at which persons wait for its signal."""
SHORT_EDGE = 5.0
"""Distance (m) between its ends below which an edge is too short to hand a person back to SUMO on it."""

Step = tuple[str, bool]
"""An edge, and whether it is walked from begin to end."""


@dataclass(frozen=True)
class CrossingEntry:
    """The place where a path enters a crossing."""

    s: float
    """Position (m along the path) of the begin of the crossing."""
    wait: float
    """Position (m along the path) at which persons wait for the signal."""
    lane: str
    """Walking area from which the link with the signal leads to the crossing; it may lie at the other end."""
    crossing: str


@dataclass(frozen=True)
class WalkPath:
    """One line from a person's first edge to its destination."""

    line: Polyline
    crossings: tuple[CrossingEntry, ...]
    steps: tuple[Step, ...]
    """Edges of the path."""
    ends: tuple[float, ...]
    """Position (m along the line) at which each edge ends."""
    last_edge_end: float
    """The same for the last edge that is not short (SHORT_EDGE)."""
    arrival: float | None
    """Distance (m) from the begin of the last edge to the destination; None for random paths."""

    @property
    def second_edge_end(self) -> float:
        """Position (m along the line) at which the second edge ends: a person that begins its walk is before it."""
        return self.ends[min(1, len(self.ends) - 1)]


class PathDrawing:
    """A path that is being drawn.

    `side`: lateral position on each lane, from -1 (right edge) to 0 (beside the middle). `begin`: the place (m) on the
    lane `area` of a junction where the path begins, if it does not begin with an edge.
    """

    def __init__(self, side: float, begin: tuple[float, float] | None = None, area: Lane | None = None) -> None:
        self._side = side
        self._points = [] if begin is None else [begin]
        self._area = area if area is not None and is_walking_area(area.id) else None
        """Walking area at the present end of the path, if any."""
        self._crossings: list[tuple[int, Lane | None, str, str]] = []
        """For each crossing: index of its first point, walking area before it, lane of its link, lane of the
        crossing."""
        self._last_middle: tuple[float, float] | None = None
        """End (m) of the middle line of the previous crossing; None after an edge."""
        self._ends: list[int] = []
        self._last_edge_end = 0

    def walk_along(self, lane: Lane, forward: bool, arrival: float | None = None, *, on_left: bool = False) -> None:
        """Add the lane of an edge, up to `arrival` (m from its begin); `on_left`: on its left side, seen in the
        direction of walking."""
        shape = list(lane.points)
        if arrival is not None:
            whole, _ = line_through(shape)
            place = min(max(arrival, 0.0), lane.length) * whole.end / max(lane.length, 0.1)
            shape = whole.between(0.0, place) if forward else whole.between(place, whole.end)
        walk = _beside(shape if forward else shape[::-1], self._side, lane, -1.0 if on_left else 1.0)
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
                # From crossing to crossing, use the middle: at the inner side of a corner, one crossing ends where the
                # other one begins, both beyond the kerb, so that the way to the kerb and the way back would coincide.
                points[-1], over[0] = self._last_middle, _beside(middle, CORNERED * self._side, lane)[0]
                points.append(_behind_kerb(area, points[-1], self._side))
                kerb = _behind_kerb(area, over[0], self._side)
                points += [*_way_on(points, area, kerb), kerb]
            points += _way_on(points, area, over[0])
            self._crossings.append((len(points), area, link, lane.id))
            points += over
            self._area, self._last_middle = None, _beside(middle, CORNERED * self._side, lane)[-1]

    def path(self, steps: Sequence[Step], arrival: float | None) -> WalkPath:
        """The path drawn along the edges `steps`, to `arrival` on the last edge."""
        line, along = line_through(self._points)
        crossings = [
            CrossingEntry(along[i], _wait(line, along[i], area), *lanes) for i, area, *lanes in self._crossings
        ]
        ends = tuple(along[i] for i in self._ends)
        return WalkPath(line, tuple(crossings), tuple(steps), ends, along[self._last_edge_end], arrival)


def _way_on(
    points: list[tuple[float, float]], area: Lane | None, place: tuple[float, float]
) -> list[tuple[float, float]]:
    """The way from the end of a path, `points`, across a walking area to a place; empty without an area."""
    return way_across(area.shape, points[-1], place, CLEARANCE) if points and area is not None else []


def _behind_kerb(area: Lane, place: tuple[float, float], side: float) -> tuple[float, float]:
    """A place on a walking area near `place`, the end of a crossing, which may be beside the area.

    Without it, a path from one crossing to the next would not touch the area. The distance from the edge of the area
    depends on `side`, so that persons keep apart.
    """
    return back_from(area.shape, *place, BACK * (1.0 + abs(side))) or place


def _wait(line: Polyline, s: float, area: Lane | None) -> float:
    """Position (m along a line) on the walking area at which persons wait for a crossing that begins at `s`."""
    if area is None:
        return s - WAITING_DISTANCE
    places = s - np.arange(WAITING_DISTANCE, FARTHEST_BACK, 0.2)
    outside = distance_to(area.shape, np.array([line.at(place)[:2] for place in places.tolist()]))
    behind = outside <= -BACK
    # If no place is BACK inside the area, such as on narrow areas, take the place that is farthest inside.
    return places.item(int(behind.argmax() if behind.any() else outside.argmin()))


def _directed_from(area: Lane | None, here: tuple[float, float], crossing: Lane) -> list[tuple[float, float]]:
    """The middle line of a crossing, from the end at the walking area; without an area, from the end nearer to `here`.

    Around the corner of two streets, the nearer end can be on the other side of the carriageway.
    """
    shape = list(crossing.points)
    if area is None:
        begin, end = (math.dist(one, here) for one in (shape[0], shape[-1]))
    else:
        begin, end = np.maximum(distance_to(area.shape, crossing.shape[[0, -1]]), 0.0).tolist()
    return shape if begin <= end else shape[::-1]


def _beside(
    shape: list[tuple[float, float]], side: float, lane: Lane, to_the_right: float = 1.0
) -> list[tuple[float, float]]:
    """The line beside the middle of a lane; `shape`: its middle line in the direction of walking, `side`: see
    `path`. `to_the_right`: 1, or -1 for a line to the left of the middle."""
    most = max(0.5 * lane.width - CLEARANCE, 0.0)
    least = min(OFF_VEHICLES if lane.surface == Surface.ROAD else ASIDE, most)
    aside = to_the_right * (least - side * (most - least))
    return [(x, y) for x, y in _to_the_right(np.array(shape), aside).tolist()]


@compiled
def _to_the_right(points: Floats, aside: float) -> Floats:
    """The points of a line (k, 2), each moved by `aside` (m) to the right."""
    moved, last = np.empty_like(points), len(points) - 1
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        x, y = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]
        if after - before > 1:
            x, y = x / 2.0, y / 2.0
        length = max(math.hypot(x, y), 0.01)
        moved[k, 0], moved[k, 1] = points[k, 0] - aside * (-y / length), points[k, 1] - aside * (x / length)
    return moved
