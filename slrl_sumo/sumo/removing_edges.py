"""Edges to which vehicles must not be moved: edges with a calibrator or a vaporizer, which may remove vehicles.

Measured with libsumo 1.28: it crashes when a calibrator removes a vehicle that was moved onto its edge by `moveToXY` (a
town of 9 junctions with one calibrator: 6 of 6 runs), but not when SUMO itself has driven the vehicle onto the edge.

SUMO removes a vehicle when it drives onto an edge with a vaporizer. For a vehicle that is already on the edge, SUMO
skips the end of its step (`MSVehicle::executeMove`), which prepares lane changes. In the sublane model, a vehicle that
was moved there then has no expected speeds of the sublanes, or those of another edge:
`MSLCM_SL2015::_wantsChangeSublane` reads invalid memory, and ends the process if the vehicle was staged there.
"""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import LanePoints

MAY_BE_REMOVED = "it comes to an edge with a calibrator or vaporizer, which may remove vehicles"
ASSIGNMENT_REACH = 10.0
"""Distance (m) from the middle of a lane within which `moveToXY` may assign a vehicle to it: its threshold and half a
lane."""


class RemovingEdges:
    """The edges of a network that may remove vehicles; without effect in networks without such edges."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api, self._edges = api, network.removing
        self._points = LanePoints([lane for lane in network.lanes if lane.edge in self._edges], spacing=2.0)

    def near(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Whether SUMO may assign each position (m, (n,)) to such an edge, (n,)."""
        if not self._edges:
            return np.zeros(len(x), np.bool_)
        point = self._points.nearest(x, y)[:, 0]
        return np.asarray(np.hypot(self._points.x[point] - x, self._points.y[point] - y) < ASSIGNMENT_REACH)

    def next_for(self, vehicle: str, *, inside_junctions: bool = False) -> bool:
        """Whether a vehicle is on such an edge, or comes to one next.

        With `inside_junctions`, a vehicle on the edge before such an edge does not count.
        """
        if not self._edges:
            return False
        route, index = self._api.vehicle.getRoute(vehicle), max(self._api.vehicle.getRouteIndex(vehicle), 0)
        if inside_junctions and not self._api.vehicle.getRoadID(vehicle).startswith(":"):
            return route[index] in self._edges
        return not self._edges.isdisjoint(route[index : index + 2])
