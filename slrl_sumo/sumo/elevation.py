"""Heights and slopes in networks that have heights."""

from collections.abc import Sequence
from math import atan2, degrees, hypot, nan

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.network.lanes import Lane, lane_index

SLOPE_REACH = 0.05
"""Distance (m) to both sides of a place between which its slope is measured: segments of lanes are longer."""
WALKING_AREA_MARGIN = 0.5
"""Distance (m) around a walking area within which lanes and crossings end on it."""


def has_elevation(api: SumoApi, network: Network) -> bool:
    """Whether any lane has a height other than 0: only then SUMO writes z. Takes 1 us per point of all lanes in a flat
    network."""
    return any(
        api.simulation.convert3D(lane.edge, place, lane_index(lane.id))[2] != 0.0
        for lane in network.lanes
        for place in _corners(lane)
    )


class Elevation:
    """Heights and slopes of road users, from SUMO, and of places."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        ribbons = [lane for lane in network.lanes if "pedestrian" in lane.allowed and not is_walking_area(lane.id)]
        self._ends = [(lane, place) for lane in ribbons for place in (0.0, lane.length)]
        self._end_x, self._end_y = np.array([lane.shape[k] for lane in ribbons for k in (0, -1)]).reshape(-1, 2).T
        self._around: dict[str, Floats] = {}
        self._last: dict[tuple[str, bool], float] = {}

    def of_road_users(self, ids: Sequence[str], person: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Height (m) and slope (degrees) of n road users in SUMO, (n,) each.

        A road user that SUMO has removed has its last height, else 0, and a slope of NaN; a vehicle beside all lanes
        has a height, but no slope. Values of moved persons are wrong: 0 m off their edge, and otherwise of another
        place.
        """
        domains = self._api.vehicle, self._api.person
        present = [frozenset(domain.getIDList()) for domain in domains]
        z, slope = np.zeros(len(ids)), np.full(len(ids), nan)
        for row, (name, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            if name in present[walks]:
                z[row], angle = domains[walks].getPosition3D(name)[2], domains[walks].getSlope(name)
                # SUMO gives -2^30 to vehicles beside all lanes.
                slope[row] = angle if abs(angle) <= 90.0 else nan
            else:
                z[row] = self._last.get((name, walks), 0.0)
        return z, slope

    def last(self, person: str) -> float:
        """Height (m) of a person in the last step; 0 if unknown."""
        return self._last.get((person, True), 0.0)

    def keep(self, ids: Sequence[str], person: NDArray[np.bool_], z: Floats) -> None:
        """Store the heights (m) of all road users in this step."""
        self._last = dict(zip(zip(ids, person.tolist(), strict=True), z.tolist(), strict=True))

    def on_lane(self, lane: Lane, place: float) -> tuple[float, float]:
        """Height (m) and slope (degrees) at a place (m along it) of a lane or crossing."""
        low, high = max(place - SLOPE_REACH, 0.0), min(place + SLOPE_REACH, lane.length)
        (ax, ay, az), (bx, by, bz) = (self._at(lane, each) for each in (low, high))
        return self._at(lane, min(max(place, 0.0), lane.length))[2], degrees(atan2(bz - az, hypot(bx - ax, by - ay)))

    def in_area(self, area: Lane, x: float, y: float) -> float:
        """Height (m) at a position in a walking area, interpolated between the lanes and crossings that end there.

        SUMO has heights along the outline only.
        """
        ends = self._around.get(area.id)
        if ends is None:
            low, high = area.shape.min(axis=0) - WALKING_AREA_MARGIN, area.shape.max(axis=0) + WALKING_AREA_MARGIN
            near = (self._end_x >= low[0]) & (self._end_x <= high[0])
            near &= (self._end_y >= low[1]) & (self._end_y <= high[1])
            ends = np.array([self._at(*self._ends[k]) for k in np.flatnonzero(near)] or [self._at(area, 0.0)])
            self._around[area.id] = ends
        weights = 1.0 / np.maximum((ends[:, 0] - x) ** 2 + (ends[:, 1] - y) ** 2, 1e-4)
        return float(weights @ ends[:, 2] / weights.sum())

    def _at(self, lane: Lane, place: float) -> tuple[float, float, float]:
        return self._api.simulation.convert3D(lane.edge, place, lane_index(lane.id))


def _corners(lane: Lane) -> list[float]:
    """Positions (m along a lane, in SUMO's measure) of the points of its shape; for walking areas up to the length."""
    drawn = np.append(0.0, np.cumsum(np.hypot(*np.diff(lane.shape, axis=0).T)))
    measure = 1.0 if is_walking_area(lane.id) else lane.length / max(drawn[-1], 1e-9)
    corners: list[float] = np.minimum(drawn * measure, lane.length).tolist()
    return corners
