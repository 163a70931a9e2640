"""Removal of registrations that SUMO leaves behind for moved vehicles that may be on two lanes at once.

In the sublane model, and if lane changes take time (`lanechange.duration`), a vehicle that reaches over its lane's edge
is also registered on the neighbouring lane, and its rear on the neighbour of the previous lane. libsumo 1.28 removes
the registrations of the rear when it drives a vehicle itself, and when it puts a vehicle onto a lane; but not when
`moveToXY` moves a vehicle off all lanes, or so far along its lane that its rear is on the same lane. Other vehicles
then still find the vehicle there, and the look-up of its rear (`MSVehicle::getBackPositionOnLane`) reads invalid memory
and ends the process, perhaps many steps later. `vehicle.moveTo` puts a vehicle onto a lane immediately.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.sumo.api import SumoApi

if TYPE_CHECKING:
    # These modules import numba, which commands that only start a run do not need.
    from slrl_sumo.sumo.network import Network
    from slrl_sumo.sumo.network.lanes import Lane

REAR_ROOM = 0.5
"""Room (m) behind a vehicle that is put onto a lane, so that its rear is on no other lane."""


OPTIONS = ("lateral-resolution", "lanechange.duration")


def on_two_lanes(lateral_resolution: str, lane_change_duration: str) -> bool:
    """Whether vehicles may be on two lanes at once, with these values of OPTIONS ('' for options that are not set)."""
    try:
        return float(lateral_resolution or 0.0) > 0.0 or (parse_time(lane_change_duration) or 0.0) > 0.0
    except ValueError:
        return False  # SUMO reports it


class Sublanes:
    """Removes the registrations of moved vehicles; without effect if vehicles are on one lane at a time."""

    def __init__(self, api: SumoApi, network: "Network") -> None:
        self._api = api
        self._on = on_two_lanes(*(api.simulation.getOption(name) for name in OPTIONS))
        self._places: dict[str, tuple[str, float]] = {}
        self._lengths: dict[str, float] = {}
        self._lanes: dict[str, list[Lane]] = {}
        for lane in network.lanes if self._on else ():
            self._lanes.setdefault(lane.edge, []).append(lane)

    @property
    def on(self) -> bool:
        """Whether a vehicle may be on two lanes at once."""
        return self._on

    def clear(self, road_user: str) -> None:
        """Remove the registrations of a vehicle; call it before each move, in each SUMO step."""
        if not self._on:
            return
        vehicle = self._api.vehicle
        lane = vehicle.getLaneID(road_user)
        before = self._places.get(road_user)
        if lane:
            self._places[road_user] = (lane, vehicle.getLanePosition(road_user))
            position = self._places[road_user][1]
            if before is not None and before[0] == lane and before[1] < self._length(road_user) <= position:
                self._put(road_user, lane.rsplit("_", 1)[0], position, lane)
        elif before is not None:
            del self._places[road_user]
            # Put the vehicle onto a lane of its route for the next step; then it is off all lanes, without
            # registrations.
            edge = vehicle.getRoute(road_user)[max(vehicle.getRouteIndex(road_user), 0)]
            self._put(road_user, edge, max(before[1], self._length(road_user) + REAR_ROOM), "")

    def forget(self, vehicles: Iterable[str]) -> None:
        """Drop the data of vehicles that are no longer moved."""
        for road_user in vehicles:
            self._places.pop(road_user, None)
            self._lengths.pop(road_user, None)

    def _length(self, road_user: str) -> float:
        if road_user not in self._lengths:
            self._lengths[road_user] = self._api.vehicle.getLength(road_user)
        return self._lengths[road_user]

    def _put(self, road_user: str, edge: str, position: float, last: str) -> None:
        """Put a vehicle onto a lane of `edge` at `position` (m): onto `last`, or for '' onto a lane that it may use.

        SUMO ignores a move to the present or last lane of the vehicle: hence two moves to different lanes. An edge with
        one lane needs no move.
        """
        vehicle_class = self._api.vehicle.getVehicleClass(road_user)
        for lane in sorted(self._lanes[edge], key=lambda lane: (lane.id == last, vehicle_class in lane.allowed))[-2:]:
            self._api.vehicle.moveTo(road_user, lane.id, min(position, lane.length))
