"""Lane keeping of cars: distance from the centre line, changes of side, and driving against the lane."""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.counters import ratio
from slrl_sumo.scene.geometry import Floats, to_ego
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, LanePoints

SWAY = 0.15
"""m beside the centre line beyond which a car is on one side of it."""
SPACING = 0.5
REACH = 5.0
"""m from the centre line beyond which a car is not beside that lane."""


@dataclass
class LaneKeeping:
    """Sums over the steps of cars on roads, outside junctions; call `add` after every decision interval.

    The lane is the nearest car lane in either direction, so that a car on the wrong side is measured from the lane it
    is on: `against` counts those steps.
    """

    network: Network
    distances: list[float] = field(default_factory=list)
    """m from the centre line of the nearest car lane to the centre of the box, one per step."""
    sways: int = 0
    """Changes from more than `SWAY` m on one side of the same lane to more than that on the other."""
    metres: float = 0.0
    """Distance driven on the lanes."""
    against: int = 0
    """Steps against the direction of the nearest lane."""

    def __post_init__(self) -> None:
        lanes = [lane for lane in self.network.lanes if not lane.internal and lane.allowed & MOTOR_CLASSES]
        self._points = LanePoints(lanes, SPACING)
        self._junctions = [area.points.astype(np.float32) for area in self.network.junctions]
        self._last: dict[str, tuple[int, float, float]] = {}
        self._side: dict[str, float] = {}

    def add(self, cars: WorldState) -> None:
        """Count one step of `cars`. A car that is missing in a step starts anew."""
        lane, offset, against = self.beside(cars.x, cars.y, cars.heading)
        last, self._last = self._last, {}
        for row in np.flatnonzero(lane >= 0).tolist():
            car, here, x, y = cars.ids[row], int(lane[row]), float(cars.x[row]), float(cars.y[row])
            self.distances.append(abs(float(offset[row])))
            self.against += bool(against[row])
            self._last[car] = (here, x, y)
            before = last.get(car)
            if before is None or before[0] != here:
                self._side.pop(car, None)
            else:
                self.metres += float(np.hypot(x - before[1], y - before[2]))
            if abs(offset[row]) > SWAY:
                side = float(np.sign(offset[row]))
                self.sways += self._side.get(car, side) != side
                self._side[car] = side

    def record(self) -> dict[str, Any]:
        """Means and shares (None without steps), ready for JSON."""
        distances = np.array(self.distances)
        return {
            "lane_distance_mean_m": round(float(distances.mean()), 4) if len(distances) else None,
            "lane_distance_p95_m": round(float(np.percentile(distances, 95)), 4) if len(distances) else None,
            "sways_per_100_m": ratio(100.0 * self.sways, self.metres, 5),
            "against_share": ratio(self.against, len(distances), 5),
        }

    def beside(self, x: Floats, y: Floats, heading: Floats) -> tuple[NDArray[np.intp], Floats, NDArray[np.bool_]]:
        """For n positions (m) and headings (rad): the nearest car lane, -1 inside junctions and off the lanes, (n,);
        m to the left of its centre line, (n,); whether the heading is against it, (n,)."""
        nearest = self._points.nearest(x, y)
        if nearest.shape[1] == 0:
            return np.full(len(x), -1, np.intp), np.zeros(len(x)), np.zeros(len(x), np.bool_)
        row = nearest[:, 0]
        ahead, left = to_ego(x - self._points.x[row], y - self._points.y[row], self._points.heading[row])
        on = (np.abs(ahead) <= 2.0 * SPACING) & (np.abs(left) <= REACH) & ~self._in_junction(x, y)
        against = np.cos(heading - self._points.heading[row]) < 0.0
        return np.where(on, self._points.lane[row], -1), left, against

    def _in_junction(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        inside = np.zeros(len(x), np.bool_)
        for corners in self._junctions:
            low, high = corners.min(axis=0), corners.max(axis=0)
            near = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]) & ~inside)
            for row in near.tolist():
                inside[row] = cv2.pointPolygonTest(corners, (float(x[row]), float(y[row])), False) >= 0
        return inside
