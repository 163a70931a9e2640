"""Positions of all vehicles of a run over time, and their positions on its lanes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, Lane, LanePoints

LANE_POINT_SPACING = 1.0
"""m between lane points."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Trace:
    """R rows, sorted by vehicle and then by time."""

    ids: tuple[str, ...]
    """Of the V vehicles."""
    kind: NDArray[np.int8]
    """RoadUserType, (V,)."""
    length: Floats
    """m, (V,)."""
    vehicle: NDArray[np.int64]
    """Index of the vehicle, (R,)."""
    time: Floats
    """s, (R,)."""
    x: Floats
    """m, of the centre, (R,)."""
    y: Floats
    heading: Floats
    """rad, (R,)."""
    speed: Floats
    """m/s, (R,)."""
    learned: NDArray[np.bool_]
    """(R,)."""

    def __len__(self) -> int:
        return len(self.vehicle)

    @property
    def starts(self) -> Rows:
        """First row of each vehicle, and R at the end, (V + 1,)."""
        return np.searchsorted(self.vehicle, np.arange(len(self.ids) + 1))

    def steps(self, dt: float) -> Rows:
        """Rows that are followed by a row of the same vehicle `dt` s later."""
        same = (np.diff(self.vehicle) == 0) & (np.abs(np.diff(self.time) - dt) < 1e-6)
        return np.flatnonzero(same)


class TraceBuilder:
    """Collects the vehicles of worlds; call `add` for each."""

    def __init__(self) -> None:
        self._index: dict[str, int] = {}
        self._kind: list[int] = []
        self._length: list[float] = []
        self._parts: list[Floats] = []

    def add(self, world: WorldState) -> None:
        """Add the vehicles of `world`."""
        users = world.take(np.flatnonzero(world.type != RoadUserType.PEDESTRIAN))
        for name, kind, length in zip(users.ids, users.type.tolist(), users.length.tolist(), strict=True):
            if name not in self._index:
                self._index[name] = len(self._index)
                self._kind.append(kind)
                self._length.append(length)
        index = np.array([self._index[name] for name in users.ids], np.float64)
        time = np.full(len(users), world.time)
        self._parts.append(np.column_stack([index, time, users.x, users.y, users.heading, users.speed, users.learned]))

    def build(self) -> Trace:
        """All rows."""
        table = np.concatenate([np.zeros((0, 7)), *self._parts])
        table = table[np.lexsort((table[:, 1], table[:, 0]))]
        return Trace(
            ids=tuple(self._index),
            kind=np.array(self._kind, np.int8),
            length=np.array(self._length, np.float64),
            vehicle=table[:, 0].astype(np.int64),
            time=table[:, 1],
            x=table[:, 2],
            y=table[:, 3],
            heading=table[:, 4],
            speed=table[:, 5],
            learned=table[:, 6] > 0.0,
        )


@dataclass(frozen=True, eq=False)
class OnLanes:
    """Positions of R rows of cars on the car lanes `lanes`."""

    lanes: tuple[Lane, ...]
    row: Rows
    """Rows of the trace that are measured: those of cars, (r,)."""
    lane: NDArray[np.int64]
    """Index of the nearest lane of about the same direction, else of the nearest one, (r,)."""
    front: Floats
    """m of the front from the lane's start; beyond its end where the front is over the stop line, (r,)."""
    aside: Floats
    """m of the centre to the left of the centre line, (r,)."""
    outside: Floats
    """m of the centre from the edge of the nearest lane of any direction; 0 on a lane, (r,)."""


def on_lanes(trace: Trace, lanes: Sequence[Lane]) -> OnLanes:
    """Where the cars of `trace` are on those of `lanes` (also inside junctions) that motor vehicles may use."""
    roads = [lane for lane in lanes if lane.allowed & MOTOR_CLASSES and len(lane.shape) > 1]
    points = LanePoints(roads, LANE_POINT_SPACING)
    row = np.flatnonzero(trace.kind[trace.vehicle] == RoadUserType.CAR)
    x, y, heading = trace.x[row], trace.y[row], trace.heading[row]
    near = points.along(x, y, heading)
    half = np.array([0.5 * lane.width for lane in roads])[points.lane[near.rows]]
    outside = np.hypot(np.maximum(np.abs(near.aside) - half, 0.0), near.beyond).min(axis=1, initial=np.inf)
    point = near.own(near.rows)
    front = points.offset[point] + near.own(near.ahead) + 0.5 * trace.length[trace.vehicle[row]]
    return OnLanes(tuple(roads), row, points.lane[point].astype(np.int64), front, near.own(near.aside), outside)
