"""The lanes of a network, and points sampled along them: starting points, and the lane under a position."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.geometry import Floats, to_ego, wrap_angle
from slrl_sumo.scene.nearest import PointIndex

MOTOR_CLASSES = frozenset(
    {"passenger", "private", "taxi", "bus", "coach", "truck", "trailer", "motorcycle", "hov", "evehicle"}
)
"""SUMO classes that make a lane a carriageway. "delivery" and "emergency" are left out, because they often may use
footpaths (https://sumo.dlr.de/docs/Simulation/VehiclePermissions.html)."""
ALL_CLASSES = MOTOR_CLASSES | {"bicycle", "pedestrian"}
"""The classes listed for a lane that admits every class."""


@dataclass(frozen=True, eq=False)
class Lane:
    """One lane of a network."""

    id: str
    edge: str
    shape: NDArray[np.float64]
    """Centre line (k, 2) in m; the outline of a walking area."""
    width: float
    """m."""
    length: float
    """Length (m) in SUMO; it may differ from the length of `shape` (attribute "length" of the network file)."""
    max_speed: float
    """Speed limit, m/s."""
    allowed: frozenset[str]
    """SUMO vehicle classes that may use the lane."""
    internal: bool
    """Whether the lane is part of a junction."""
    surface: Surface

    @cached_property
    def points(self) -> tuple[tuple[float, float], ...]:
        """`shape` as pairs of numbers, which are faster for single accesses."""
        return tuple((x, y) for x, y in self.shape.tolist())

    def admits(self, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use the lane."""
        return vehicle_class in self.allowed or self.allowed >= ALL_CLASSES


def lane_index(lane: str) -> int:
    """The index of a lane, by its id, on its edge: SUMO counts from the kerb."""
    return int(lane.rpartition("_")[2])


def neighbour(lane: Lane, step: int, lanes: Mapping[str, Lane]) -> Lane | None:
    """The lane `step` lanes to the left on the same edge, of the `lanes` by id; to the right where traffic keeps to
    the left. None without one."""
    return lanes.get(f"{lane.edge}_{lane_index(lane.id) + step}")


LANE_CANDIDATES = 12
"""Number of nearest lane points among which the lane of a road user is searched."""
ALONG = np.pi / 6.0
"""Greatest angle (rad) between a road user and its lane."""


class PointsAlong(NamedTuple):
    """Lane points near n positions, (n, candidates) each, except `best`."""

    rows: NDArray[np.intp]
    """Indices of the points."""
    ahead: Floats
    """Distance (m) along the lane from the point to the position."""
    aside: Floats
    """Distance (m) to the left of the lane's centre line."""
    beyond: Floats
    """Distance (m) past the segment of the lane that the point represents."""
    best: NDArray[np.intp]
    """Column of the point on the nearest lane of about the same direction, else of the nearest lane, (n,)."""

    def own(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of the best candidates, (n,), from the values of all candidates."""
        return values[np.arange(len(self.best)), self.best]


class LanePoints:
    """Points along `lanes`, every `spacing` metres, at least half of that from the lane's ends.

    Points lie on the centre line, or side by side where a lane is wide enough for several strips of width `strip` (m).

    Arrays of length p: `x`, `y` (m), `heading` (rad, the lane's direction), `offset` (m along the lane, in SUMO's
    measure), `lane` (index into `lanes`). A lane shorter than `spacing` gets one point in its middle.
    """

    def __init__(self, lanes: Sequence[Lane], spacing: float, strip: float = np.inf) -> None:
        self.lanes = tuple(lanes)
        # A city has millions of points: no array per lane is stored, and no copy.
        places, headings, offsets, counts = bytearray(), bytearray(), bytearray(), []
        for lane in self.lanes:
            sample = _sample(lane, spacing, strip)
            places += sample[:, :2].tobytes()
            headings += sample[:, 2].tobytes()
            offsets += sample[:, 3].tobytes()
            counts.append(len(sample))
        points = np.frombuffer(places).reshape(-1, 2)
        self.x, self.y = points.T
        self.heading, self.offset = np.frombuffer(headings), np.frombuffer(offsets)
        self.lane = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        self._half_width = np.array([0.5 * lane.width for lane in self.lanes])
        self._max_speed = np.array([lane.max_speed for lane in self.lanes])
        self._length = np.array([lane.length for lane in self.lanes])
        self._spacing = spacing
        self._index = PointIndex(self.x, self.y)

    def __len__(self) -> int:
        return len(self.x)

    def take(self, rows: NDArray[np.intp]) -> "LanePoints":
        """The points `rows` (indices), on the same lanes."""
        some = copy(self)
        some.x, some.y, some.heading, some.offset = (a[rows] for a in (self.x, self.y, self.heading, self.offset))
        some.lane = self.lane[rows]
        some._index = PointIndex(some.x, some.y)
        return some

    def nearest(self, x: Floats, y: Floats, count: int = 1) -> NDArray[np.intp]:
        """Indices of the `count` points nearest to each of n positions, nearest first: (n, min(count, p))."""
        return self._index.nearest(x, y, min(count, len(self)))[0]

    def nearest_point(self, x: Floats, y: Floats) -> NDArray[np.intp]:
        """Index of the point nearest to each of n positions, (n,). ValueError without points."""
        return self.nearest(x, y).reshape(len(x))

    def max_speed(self, rows: NDArray[np.intp]) -> Floats:
        """Speed limit (m/s) of the lanes of the points `rows`."""
        return self._max_speed[self.lane[rows]]

    def rest_of_lane(self, rows: NDArray[np.intp]) -> Floats:
        """Distances (m) from the points `rows` to the ends of their lanes."""
        return self._length[self.lane[rows]] - self.offset[rows]

    def lanes_under(self, x: Floats, y: Floats) -> NDArray[np.intp]:
        """Index of the lane that covers each of n positions, (n,); -1 without one."""
        if not len(self):
            return np.full(len(x), -1, np.intp)
        rows, under = self.nearest_lanes(x, y)
        return np.where(under, self.lane[rows], -1)

    def along(self, x: Floats, y: Floats, heading: Floats) -> "PointsAlong":
        """The points nearest to each of n positions, and among them the best candidate.

        That is the point on the nearest lane of about the direction `heading` (rad, (n,)), because lanes cross inside
        junctions.
        """
        rows = self.nearest(x, y, LANE_CANDIDATES)
        ahead, aside = to_ego(x[:, None] - self.x[rows], y[:, None] - self.y[rows], self.heading[rows])
        beyond = np.maximum(np.abs(ahead) - 0.5 * self._spacing, 0.0)
        crossing = np.abs(wrap_angle(heading[:, None] - self.heading[rows])) >= ALONG
        best = (np.hypot(aside, beyond) + np.where(crossing, 1e3, 0.0)).argmin(axis=1)
        return PointsAlong(rows, ahead, aside, beyond, best)

    def nearest_lanes(self, x: Floats, y: Floats) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """The point nearest to each of n positions, (n,), and whether the surface of its lane lies under the position.

        ValueError without points.
        """
        if not len(self):
            raise ValueError("there are no lanes")
        rows, distance = self._index.nearest(x, y)
        points = rows[:, 0]
        reach = np.hypot(self._half_width[self.lane[points]], 0.5 * self._spacing)
        return points, distance[:, 0] <= reach


def _sample(lane: Lane, spacing: float, strip: float) -> Floats:
    """Rows x, y, heading, offset of the points on one lane."""
    steps = np.diff(lane.shape, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    total = along[-1]
    if total <= 0.0:
        return np.zeros((0, 4))
    count = max(1, int(total // spacing))
    s = (np.arange(count) + 0.5) * total / count
    segment = np.minimum(np.searchsorted(along, s, side="right") - 1, len(steps) - 1)
    heading = np.arctan2(steps[segment, 1], steps[segment, 0])
    x, y = np.interp(s, along, lane.shape[:, 0]), np.interp(s, along, lane.shape[:, 1])
    # A lane's length in SUMO may differ from the length of its shape (attribute "length" of the network file).
    offset = s * lane.length / total
    strips = max(1, int(lane.width / strip))
    aside = (np.arange(strips) - 0.5 * (strips - 1)) * lane.width / strips
    return np.concatenate(
        [np.column_stack([x - a * np.sin(heading), y + a * np.cos(heading), heading, offset]) for a in aside]
    )
