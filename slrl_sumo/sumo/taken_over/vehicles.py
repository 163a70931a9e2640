"""Vehicles that are moved from outside (rules: see slrl_sumo.sumo.taken_over)."""

import math
from collections.abc import Container
from dataclasses import dataclass

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.removing_edges import MAY_BE_REMOVED, RemovingEdges
from slrl_sumo.sumo.road_users import loaded_ids
from slrl_sumo.sumo.sublanes import Sublanes
from slrl_sumo.sumo.vehicle_classes import Shape, without_models

LEFT_TO_SUMO = frozenset(
    {
        *("tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"),
        *("ship", "container", "aircraft", "drone"),
    }
)
"""Vehicle classes that are never taken over
(https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html)."""
KEEP_ROUTE = 3
MOVED = 16
"""SUMO's speed mode of moved vehicles: SUMO does not plan their speeds, but they wait at red signals. With 0, fewer
background vehicles pass junctions (docs/measurements/archive/flow.md)."""
KEEP_ROUTE_STRICTLY = 1
"""keepRoute of moves onto the route, into the middle of a lane, from any position."""
MAX_LANE_OFFSET = 0.3
"""Greatest distance (m) from the middle of its lane at which a vehicle is handed back at its position."""
EVERYWHERE = 1e5
"""Distance (m) greater than any distance in a network."""
MATCH_THRESHOLD = 5.0
"""matchThreshold (m); SUMO's default of 100 m makes a call up to 40 times slower."""
NO_LANE, INTERRUPTED = "no lane", "stop ahead"
"""Reasons why a vehicle cannot be taken over: SUMO has it on no lane; a stop, a calibrator or a vaporizer is ahead."""


@dataclass(frozen=True)
class _Modes:
    """The modes of a vehicle before the takeover, and its lane change mode during the takeover."""

    speed: int
    lane_change: int
    lane_change_meanwhile: int
    """SUMO keeps bits of the mode that was set before."""


class TakenOverVehicles:
    """Takes single vehicles over, moves them, and hands them back; `refusals`: vehicles that SUMO cannot move."""

    def __init__(self, api: SumoApi, network: Network, refusals: Refusals) -> None:
        self._api, self._network, self._refusals = api, network, refusals
        self._modes: dict[str, _Modes] = {}
        self._lost: list[str] = []
        self._beside: list[str] = []
        """Vehicles handed back since the last step: `_lost` on no lane, `_beside` beside the middle of their lane."""
        self._removing = RemovingEdges(api, network)
        self._sublanes = Sublanes(api, network)

    @property
    def ids(self) -> frozenset[str]:
        """Ids of the vehicles that are presently taken over."""
        return frozenset(self._modes)

    def obstacle(self, road_user: str, models: bool) -> str:
        """Reason why a vehicle cannot be taken over, '' if it can; with `models`, learned models must suit it."""
        vehicle = self._api.vehicle
        vehicle_class = vehicle.getVehicleClass(road_user)
        # SUMO 1.28 crashes in the step after a move has put a vehicle onto a walking area or a crossing. In networks of
        # netconvert, only vehicles of class "pedestrian" can be mapped to these.
        if vehicle_class in LEFT_TO_SUMO or vehicle_class in self._network.classes_on_foot:
            return f"class {vehicle_class}"
        if models:
            shape = Shape(vehicle_class, vehicle.getLength(road_user), vehicle.getWidth(road_user))
            if unlike := without_models(shape):
                return unlike
        if vehicle.getLaneID(road_user) == "":
            return NO_LANE
        return INTERRUPTED if self.is_interrupted(road_user) else ""

    def is_interrupted(self, road_user: str) -> bool:
        """Whether a vehicle must not be moved on: it has a stop, a calibrator or a vaporizer ahead."""
        vehicle = self._api.vehicle
        # Bits 1 and 8 and up of the stop state: at a stop, parked, or waiting for passengers.
        if vehicle.getStops(road_user, 1) or vehicle.getStopState(road_user) != 0:
            return True
        return self._removing.next_for(road_user)

    def take_over(self, road_user: str) -> bool:
        """Take a vehicle over; the caller must move it in each SUMO step from now on."""
        vehicle = self._api.vehicle
        speed, lane_change = vehicle.getSpeedMode(road_user), vehicle.getLaneChangeMode(road_user)
        vehicle.setSpeedMode(road_user, MOVED)
        vehicle.setLaneChangeMode(road_user, 0)
        self._modes[road_user] = _Modes(speed, lane_change, vehicle.getLaneChangeMode(road_user))
        return True

    def move(self, road_user: str, x: float, y: float, angle: float, speed: float) -> None:
        """Move the front of a vehicle to a position (m), facing a SUMO `angle` (degrees), at a `speed` (m/s), in the
        next SUMO step."""
        if self._removing.next_for(road_user, inside_junctions=True):
            self._refusals.add(road_user, MAY_BE_REMOVED)
            return
        self._sublanes.clear(road_user)
        self._api.vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE, MATCH_THRESHOLD)
        self._api.vehicle.setSpeed(road_user, speed)

    def put_on_route(self) -> None:
        """Let the next SUMO step put handed-back vehicles on no lane on the nearest place of their route."""
        lost, self._lost = self._lost, []
        for road_user in self._still_back(lost):
            with self._refusals.of(road_user):
                angle, (x, y) = self._api.vehicle.getAngle(road_user), self._api.vehicle.getPosition(road_user)
                self._api.vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE_STRICTLY, EVERYWHERE)

    def move_to_middle(self) -> None:
        """Let the next SUMO step move handed-back vehicles into the middle of their lane: SUMO would keep their offset
        for ever."""
        beside, self._beside = self._beside, []
        vehicle = self._api.vehicle
        for road_user in self._still_back(beside):
            dt = self._api.simulation.getDeltaT()
            with self._refusals.of(road_user):
                lane, way = vehicle.getLaneID(road_user), vehicle.getSpeed(road_user) * dt
                if lane and vehicle.getLanePosition(road_user) + way < self._api.lane.getLength(lane):
                    angle, (x, y) = vehicle.getAngle(road_user), vehicle.getPosition(road_user)
                    x, y = x + way * math.sin(math.radians(angle)), y + way * math.cos(math.radians(angle))
                    vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE_STRICTLY, MATCH_THRESHOLD)

    def _still_back(self, handed_back: list[str]) -> list[str]:
        """The handed-back vehicles that are still in SUMO and were not taken over again."""
        present = loaded_ids(self._api) if handed_back else frozenset[str]()
        return [road_user for road_user in handed_back if road_user not in self._modes and road_user in present]

    def hand_back(self, road_user: str, off_route: bool) -> bool:
        """Hand a vehicle back, with `off_route` also from no lane or inside a junction; returns whether it
        succeeded."""
        vehicle = self._api.vehicle
        # The edge does not tell: SUMO keeps the last edge of a vehicle far beside its lane, and would lose the vehicle.
        lane = vehicle.getLaneID(road_user)
        # Inside a junction, SUMO may brake hard for road users that were no foes of the learned vehicle.
        if (lane == "" or lane.startswith(":")) and not off_route:
            return False
        if lane == "":
            self._lost.append(road_user)
        self._sublanes.clear(road_user)
        self._sublanes.forget((road_user,))
        # In the sublane model, SUMO moves the vehicle into the middle itself.
        if not self._sublanes.on and abs(vehicle.getLateralLanePosition(road_user)) > MAX_LANE_OFFSET:
            self._beside.append(road_user)
        self._restore_modes(road_user)
        del self._modes[road_user]
        return True

    def abandon(self, road_user: str, present: Container[str]) -> None:
        """Return a vehicle to SUMO at its position; if its id is among those `present`, with its former modes."""
        if road_user in present:
            with self._refusals.of(road_user):
                self._restore_modes(road_user)
        self._modes.pop(road_user, None)
        self._sublanes.forget((road_user,))

    def _restore_modes(self, road_user: str) -> None:
        """Return the speed to SUMO, with the former modes; a mode that a script has set meanwhile stays."""
        vehicle, modes = self._api.vehicle, self._modes[road_user]
        vehicle.setSpeed(road_user, -1.0)
        if vehicle.getSpeedMode(road_user) == MOVED:
            vehicle.setSpeedMode(road_user, modes.speed)
        if vehicle.getLaneChangeMode(road_user) == modes.lane_change_meanwhile:
            vehicle.setLaneChangeMode(road_user, modes.lane_change)
