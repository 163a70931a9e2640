"""Where the lanes inside a junction cross or join each other."""

from typing import NamedTuple

import numpy as np

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.scene.geometry import Floats

WIDTH = 2.8
"""m between the centre lines of two lanes below which vehicles on them touch: the width of a car and 1 m,
because they swing out in turns."""
SPACING = 0.5
"""m between the points of lanes that are compared."""


class ConflictArea(NamedTuple):
    """Where a lane is too close to another one, in m along each of the two."""

    begin: float
    end: float
    other_begin: float
    other_end: float


class ConflictAreas:
    """The conflict areas of pairs of lanes, computed when they are first asked for."""

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._points: dict[str, Floats] = {}
        self._areas: dict[tuple[str, str], ConflictArea | None] = {}

    def between(self, lane: str, other: str) -> ConflictArea | None:
        """The conflict area of a lane with another one; None where both can be used at once."""
        key = (lane, other)
        if key not in self._areas:
            self._areas[key] = area = self._area(self._sampled(lane), self._sampled(other))
            self._areas[other, lane] = None if area is None else ConflictArea(*area[2:], *area[:2])
        return self._areas[key]

    def _area(self, mine: Floats, theirs: Floats) -> ConflictArea | None:
        near = np.hypot(mine[:, None, 0] - theirs[None, :, 0], mine[:, None, 1] - theirs[None, :, 1]) < WIDTH
        if not near.any():
            return None
        at, other = (np.flatnonzero(near.any(axis)) for axis in (1, 0))
        return ConflictArea(mine[at[0], 2], mine[at[-1], 2], theirs[other[0], 2], theirs[other[-1], 2])

    def _sampled(self, lane: str) -> Floats:
        """x, y and m along a lane, (points, 3), every SPACING m."""
        points = self._points.get(lane)
        if points is None:
            shape = self._graph.lanes[lane].shape
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
            s = np.linspace(0.0, along[-1], 2 + int(along[-1] / SPACING))
            points = self._points[lane] = np.stack(
                [np.interp(s, along, shape[:, 0]), np.interp(s, along, shape[:, 1]), s], axis=1
            )
        return points
