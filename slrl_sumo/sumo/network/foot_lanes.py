"""The lane, crossing or walking area under a person, found from its position."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.shape_index import index_by_tile, piece_boxes
from slrl_sumo.ground.surfaces import Area, Ribbon
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.loaded import is_crossing, is_walking_area

FOOT_LANE_MARGIN = 1.0
"""Distance (m) beside a lane up to which a person counts as on the lane; beyond it, a run counts the person as off its
surface."""
TILE = 40.0
"""Side (m) of a tile. In a junction, a tile has about 20 lanes for pedestrians, and a city stays far below the greatest
number of pieces."""


class FootLanes:
    """The lanes of a network that admit pedestrians, including crossings and walking areas, by position.

    `lanes`: the m lanes.
    """

    def __init__(self, lanes: Sequence[Lane]) -> None:
        # Vehicle lanes inside junctions are left out: SUMO has crossings and walking areas for persons there.
        self.lanes = tuple(
            lane
            for lane in lanes
            if ("pedestrian" in lane.allowed and not lane.internal) or is_crossing(lane.id) or is_walking_area(lane.id)
        )
        self.area = np.array([is_walking_area(lane.id) for lane in self.lanes], np.bool_)
        """Whether each lane is a walking area, (m,)."""
        self._half = np.where(self.area, 0.0, [0.5 * lane.width for lane in self.lanes])
        shapes = [
            Area(lane.surface, lane.shape) if area else Ribbon(lane.surface, lane.shape, lane.width)
            for lane, area in zip(self.lanes, self.area.tolist(), strict=True)
        ]
        self._tiles = index_by_tile(piece_boxes(shapes, TILE), TILE, FOOT_LANE_MARGIN)
        # Sides of outlines and parts of centre lines are both segments.
        lines = [
            np.concatenate([lane.shape, lane.shape[:1]]) if area else lane.shape
            for lane, area in zip(self.lanes, self.area.tolist(), strict=True)
        ]
        self._count = np.array([max(len(line) - 1, 0) for line in lines], np.intp)
        self._first = np.cumsum(self._count) - self._count
        self._begin = np.concatenate([np.zeros((0, 2)), *(line[:-1] for line in lines)])
        self._step = np.concatenate([np.zeros((0, 2)), *(np.diff(line, axis=0) for line in lines)])
        self._size = np.hypot(*self._step.T)
        reach = self._half[:, None] + FOOT_LANE_MARGIN
        self._low = np.array([lane.shape.min(axis=0) for lane in self.lanes]).reshape(-1, 2) - reach
        self._high = np.array([lane.shape.max(axis=0) for lane in self.lanes]).reshape(-1, 2) + reach
        walked = [np.cumsum(np.hypot(*np.diff(line, axis=0).T)) for line in lines]
        self._along = np.concatenate([np.zeros(0), *(w - np.diff(w, prepend=0.0) for w in walked)])
        """Position (m along the line) at which each segment begins."""
        total = np.array([w[-1] if len(w) else 1.0 for w in walked])
        # SUMO's length of a lane may differ from the length of its shape.
        self._measure = np.array([lane.length for lane in self.lanes]) / np.maximum(total, 1e-9)

    def at(self, x: Floats, y: Floats) -> tuple[NDArray[np.intp], Floats]:
        """Index of the lane under each of n positions (m), and position (m along it, in SUMO's measure), (n,) each.

        If several lanes contain a position, the lane in which it is deepest; if none does, the nearest lane within
        FOOT_LANE_MARGIN; else -1 and 0. Past the end of a lane or crossing, a walking area within FOOT_LANE_MARGIN
        comes first, because SUMO's persons wait for crossings there. On a walking area the position is 0: SUMO measures
        it along ways across the area.
        """
        lane, along = np.full(len(x), -1, np.intp), np.zeros(len(x))
        keys = np.floor(np.column_stack([x, y]) / TILE).astype(np.int64).tolist()
        none = np.zeros(0, np.intp)
        near = [self._tiles.get((i, j), none) for i, j in keys]
        user = np.repeat(np.arange(len(x)), [len(each) for each in near])
        candidate = np.concatenate([none, *near])
        place = np.column_stack([x[user], y[user]])
        possible = ((place >= self._low[candidate]) & (place <= self._high[candidate])).all(axis=1)
        user, candidate = user[possible], candidate[possible]
        if not len(user):
            return lane, along
        outside, beyond, on_lane = self._distances(x[user], y[user], candidate)
        order = np.lexsort((outside, beyond, user))
        order = order[outside[order] <= FOOT_LANE_MARGIN]
        first = order[np.diff(user[order], prepend=-1) != 0]
        lane[user[first]], along[user[first]] = candidate[first], on_lane[first]
        return lane, along

    def _distances(self, x: Floats, y: Floats, lane: NDArray[np.intp]) -> tuple[Floats, NDArray[np.bool_], Floats]:
        """Distance (m) from each position to the border of its lane (negative inside), whether it is past the lane's
        end, and the position (m along the lane), (p,) each."""
        count = self._count[lane]
        pair = np.repeat(np.arange(len(lane)), count)
        starts = np.cumsum(count) - count
        nth = np.arange(len(pair)) - starts[pair]
        segment = self._first[lane[pair]] + nth
        size, half, area = self._size[segment], self._half[lane[pair]], self.area[lane[pair]]
        (side_x, side_y), (px, py) = self._step[segment].T, np.stack([x[pair], y[pair]]) - self._begin[segment].T
        unit = np.maximum(size, 1e-9)
        dx, dy = side_x / unit, side_y / unit
        ahead, aside = px * dx + py * dy, py * dx - px * dy
        inner = np.clip(ahead, 0.0, size)
        # netconvert's outlines repeat corners: a side without length has no direction.
        distance = np.hypot(px - inner * dx, py - inner * dy)
        # A ribbon has square ends: past its end, the distance to the end counts.
        ends = ~area & (((nth == 0) & (ahead < 0.0)) | ((nth == count[pair] - 1) & (ahead > size)))
        square = np.hypot(ahead - inner, np.maximum(np.abs(aside) - half, 0.0))
        rim = np.where(ends, square, distance - half)
        outside = np.minimum.reduceat(rim, starts)
        # Inside an outline, a ray to the right crosses it an odd number of times.
        crossed = area & ((py >= 0.0) != (py >= side_y)) & ((aside > 0.0) == (side_y > 0.0))
        inside = np.bincount(pair, crossed, len(lane)) % 2 == 1
        nearest = np.flatnonzero(rim == outside[pair])
        best = nearest[np.diff(pair[nearest], prepend=-1) != 0]
        along = np.where(self.area[lane], 0.0, (self._along[segment[best]] + inner[best]) * self._measure[lane])
        return np.where(inside, -outside, outside), ends[best], along
