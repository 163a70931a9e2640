"""Road users of the scenario that are taken over, moved from outside, and handed back to SUMO.

Rules (measured with libsumo 1.28, see docs/explanation/sumo.md):

- Vehicles move with keepRoute 3, so that their route survives, with speed mode and lane change mode 0. Both are
  restored on hand-back (otherwise SUMO ignores all obstacles), and `setSpeed(-1)` lets SUMO choose the speed again.
- A vehicle that is moved past a stop loses it silently: vehicles with stops ahead are left to SUMO.
- Vehicles with stops ahead, also with ones that a script or a taxi dispatch adds later, are handed back, and so are
  persons that begin another stage: SUMO refuses to move a person that rides or is in an <access> stage.
- Vehicles with a calibrator or vaporizer on their next edge are handed back, see `removing_edges`.
- A person on the way to a stop that it reaches by <access> is left to SUMO: if its walk is changed, SUMO begins the
  access at once, wherever it is.
- A walk over many edges ends in "Disconnected walk" or a crash when the person is moved. While a person is taken over,
  its walk is the one edge under it; on hand-back it gets the rest of its walk, and keeps its later stages.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, front_from_centre, heading_to_sumo
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.removing_edges import MAY_BE_REMOVED, RemovingEdges
from slrl_sumo.sumo.road_users import WALKING, loaded_ids
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
KEEP_ROUTE_VEHICLE, KEEP_ROUTE_PERSON = 3, 7
MOVED = 16
"""SUMO's speed mode of vehicles that are moved: it plans none of their speeds, but has them wait at red. With 0 fewer
of its own vehicles get through junctions (docs/measurements/flow.md)."""
KEEP_ROUTE_STRICTLY = 1
"""Onto the route, in the middle of a lane, wherever the given position is."""
BESIDE = 0.3
"""m beside the middle of its lane up to which a vehicle is handed back as it is."""
EVERYWHERE = 1e5
"""m; farther than any two places of a network are apart."""
MATCH_THRESHOLD = 5.0
"""m; SUMO's default of 100 m makes a call up to 40 times slower."""
MATCH_THRESHOLD_PERSON = 0.1
"""m; with 5 m SUMO moves persons beside their edge by up to 5 m towards it."""


NO_LANE, INTERRUPTED, NOT_WALKING, REFUSED = "no lane", "stop ahead", "no walk", "refused"
"""Why a road user cannot be taken over: SUMO has the vehicle on no lane; a stop, a calibrator or a vaporizer is
ahead; the person rides, waits or walks to a stop with <access>; SUMO refuses a call."""
NO_WALK = "it does not walk any more"
INFINITELY_WIDE = "it is on a lane of infinite width, where SUMO has persons nowhere"


@dataclass(frozen=True)
class _Modes:
    """The modes of a vehicle before the takeover, and the lane change mode that it has meanwhile."""

    speed: int
    lane_change: int
    lane_change_meanwhile: int
    """SUMO keeps bits of the mode that was set before."""


@dataclass
class _Walk:
    """The original walk of a person, and the one edge that it walks on while it is taken over."""

    edges: tuple[str, ...]
    arrival: float
    stop: str
    current_edge: str | None
    """None until the person is moved for the first time."""


class TakenOverControl:
    """Takes road users of the scenario over, moves them, and hands them back to SUMO.

    `refusals`: those for which SUMO has refused a call. They remain taken over until `abandon`.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self._api = api
        self._modes: dict[str, _Modes] = {}
        self._walks: dict[str, _Walk] = {}
        self._beside: list[str] = []
        self._lengths: dict[str, float] = {}
        for lane in network.lanes:
            if not lane.internal and "pedestrian" in lane.allowed:
                self._lengths.setdefault(lane.edge, lane.length)
        self._network = network
        self._removing = RemovingEdges(api, network)
        self._edge_of_stop = {stop: api.busstop.getLaneID(stop).rpartition("_")[0] for stop in api.busstop.getIDList()}
        self._sublanes = Sublanes(api, network)

    @property
    def ids(self) -> frozenset[str]:
        """Ids of all road users that are taken over now."""
        return frozenset(self._modes) | frozenset(self._walks)

    def obstacles(self, ids: Sequence[str], person: NDArray[np.bool_], *, models: bool) -> tuple[str, ...]:
        """Why n road users on the network cannot be taken over, '' where they can; `person`: which of them are persons,
        (n,).

        Walking persons can, and vehicles on a lane without stops ahead that are no trains, ships or aircraft, and of no
        class that crossings admit; with `models`, only vehicles that these suit.
        """
        found = []
        for road_user, walks in zip(ids, person.tolist(), strict=True):
            reason = REFUSED
            with self.refusals.of(road_user):
                reason = self._obstacle_of_person(road_user) if walks else self._obstacle_of_vehicle(road_user, models)
            found.append(reason)
        return tuple(found)

    def unsupported(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which of n taken-over road users must be handed back, (n,): vehicles with stops, a
        calibrator or a vaporizer ahead, and persons that do not walk any more."""
        return self._each(ids, person, self._is_interrupted, self._does_not_walk)

    def take_over(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Take over n eligible road users; they must be moved in every SUMO step from now on. Returns which ones SUMO
        has given, (n,)."""
        return self._each(ids, person, self._take_over_vehicle, self._take_over_person)

    def move(
        self,
        ids: Sequence[str],
        person: NDArray[np.bool_],
        x: Floats,
        y: Floats,
        heading: Floats,
        speed: Floats,
        length: Floats,
    ) -> None:
        """Set the state of n road users after the next SUMO step: centres (m), headings (rad), speeds (m/s), (n,)."""
        front_x, front_y = (a.tolist() for a in front_from_centre(x, y, heading, length))
        angles, speeds = heading_to_sumo(heading).tolist(), speed.tolist()
        lanes_under = iter(self._network.walks.lanes_under(x[person], y[person]).tolist())
        vehicle, persons = self._api.vehicle, self._api.person
        for i, (road_user, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            lane = next(lanes_under) if walks else -1
            with self.refusals.of(road_user):
                if walks and self._does_not_walk(road_user):
                    # SUMO or a script has begun another stage: a move would let it walk again.
                    self.refusals.add(road_user, NO_WALK)
                elif walks and lane >= 0 and self._network.walks.lanes[lane].id in self._network.infinitely_wide:
                    self.refusals.add(road_user, INFINITELY_WIDE)
                elif walks:
                    self._shorten_walk(road_user, lane)
                    persons.moveToXY(
                        road_user, "", front_x[i], front_y[i], angles[i], KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON
                    )
                elif self._removing.next_for(road_user, inside_junctions=True):
                    self.refusals.add(road_user, MAY_BE_REMOVED)
                else:
                    self._sublanes.clear(road_user)
                    vehicle.moveToXY(
                        road_user, "", -1, front_x[i], front_y[i], angles[i], KEEP_ROUTE_VEHICLE, MATCH_THRESHOLD
                    )
                    vehicle.setSpeed(road_user, speeds[i])

    def move_to_middle(self) -> None:
        """Let the next SUMO step bring vehicles that were handed back beside the middle of their lane there: SUMO would
        keep their offset for ever.

        To be called directly before the step: a move that no step carries out is carried out in the next simulation of
        this process, where it has a vehicle of that name.
        """
        if not self._beside:
            return
        beside, self._beside = self._beside, []
        present, vehicle, dt = loaded_ids(self._api), self._api.vehicle, self._api.simulation.getDeltaT()
        for road_user in beside:
            if road_user in self._modes or road_user not in present:
                continue
            with self.refusals.of(road_user):
                lane, way = vehicle.getLaneID(road_user), vehicle.getSpeed(road_user) * dt
                if lane and vehicle.getLanePosition(road_user) + way < self._api.lane.getLength(lane):
                    angle, (x, y) = vehicle.getAngle(road_user), vehicle.getPosition(road_user)
                    x, y = x + way * math.sin(math.radians(angle)), y + way * math.cos(math.radians(angle))
                    vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE_STRICTLY, MATCH_THRESHOLD)

    def hand_back(self, ids: Sequence[str], person: NDArray[np.bool_], *, off_route: bool = False) -> NDArray[np.bool_]:
        """Hand n road users back to SUMO, (n,): False where one remains taken over and must be moved on.

        That is a vehicle that SUMO has on no lane or inside a junction, and a person off all edges, as on a crossing.
        `off_route`: vehicles on no lane are put on the nearest place of their route, however far that is.
        """
        return self._each(
            ids,
            person,
            lambda road_user: self._hand_back_vehicle(road_user, off_route),
            lambda road_user: self._hand_back_person(road_user, off_route),
        )

    def abandon(self, ids: Iterable[str]) -> None:
        """Give road users up where they are, as far as SUMO allows: those that are gone, that teleport, or for which it
        has refused a call."""
        present = loaded_ids(self._api)
        for road_user in self.ids.intersection(ids):
            if road_user in present:
                with self.refusals.of(road_user):
                    if road_user in self._modes:
                        self._restore_modes(road_user)
                    elif not self._does_not_walk(road_user) and (edges := self._rest_of(self._walks[road_user])):
                        self._restore_walk(road_user, edges)
            self._modes.pop(road_user, None)
            self._walks.pop(road_user, None)
        self._sublanes.forget(ids)

    def release(self) -> tuple[str, ...]:
        """Hand all road users back at once, if possible; returns the ids of the others.

        Persons go to the right side of their edge, also from a crossing or from beside it. Vehicles on no lane are put
        on the nearest place of their route, however far that is: beside it SUMO would lose them.
        """
        self.abandon(self.ids - loaded_ids(self._api))
        held = sorted(self.ids)
        persons = np.array([road_user in self._walks for road_user in held], np.bool_)
        back = self.hand_back(held, persons, off_route=True)
        return tuple(road_user for road_user, given in zip(held, back.tolist(), strict=True) if not given)

    def _each(
        self,
        ids: Sequence[str],
        person: NDArray[np.bool_],
        of_vehicle: Callable[[str], bool],
        of_person: Callable[[str], bool],
    ) -> NDArray[np.bool_]:
        """What the functions say about n road users, (n,); False where SUMO refuses a call."""
        said = np.zeros(len(ids), np.bool_)
        for i, (road_user, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            with self.refusals.of(road_user):
                said[i] = of_person(road_user) if walks else of_vehicle(road_user)
        return said

    def _is_interrupted(self, road_user: str) -> bool:
        vehicle = self._api.vehicle
        # Bits 1 and 8 and up of the stop state: at a stop, parked, or waiting for passengers.
        if vehicle.getStops(road_user, 1) or vehicle.getStopState(road_user) != 0:
            return True
        return self._removing.next_for(road_user)

    def _does_not_walk(self, road_user: str) -> bool:
        return self._api.person.getStage(road_user, 0).type != WALKING

    def _obstacle_of_vehicle(self, road_user: str, models: bool) -> str:
        vehicle = self._api.vehicle
        vehicle_class = vehicle.getVehicleClass(road_user)
        # SUMO 1.28 crashes in the step after a move has put a vehicle onto a walking area or a crossing. In networks of
        # netconvert only vehicles of class "pedestrian" can be mapped to one.
        if vehicle_class in LEFT_TO_SUMO or vehicle_class in self._network.classes_on_foot:
            return f"class {vehicle_class}"
        if models:
            shape = Shape(vehicle_class, vehicle.getLength(road_user), vehicle.getWidth(road_user))
            if unlike := without_models(shape):
                return unlike
        if vehicle.getLaneID(road_user) == "":
            return NO_LANE
        return INTERRUPTED if self._is_interrupted(road_user) else ""

    def _obstacle_of_person(self, road_user: str) -> str:
        person = self._api.person
        if person.getVehicle(road_user) != "" or person.getRoadID(road_user) == "":
            return NOT_WALKING
        stage = person.getStage(road_user, 0)
        if stage.type != WALKING:
            return NOT_WALKING
        # With <access>, SUMO ends the walk to a stop on another edge than that of the stop.
        whole = not stage.edges or self._edge_of_stop.get(stage.destStop, stage.edges[-1]) == stage.edges[-1]
        return "" if whole else NOT_WALKING

    def _take_over_vehicle(self, road_user: str) -> bool:
        vehicle = self._api.vehicle
        speed, lane_change = vehicle.getSpeedMode(road_user), vehicle.getLaneChangeMode(road_user)
        vehicle.setSpeedMode(road_user, MOVED)
        vehicle.setLaneChangeMode(road_user, 0)
        self._modes[road_user] = _Modes(speed, lane_change, vehicle.getLaneChangeMode(road_user))
        return True

    def _take_over_person(self, road_user: str) -> bool:
        stage = self._api.person.getStage(road_user, 0)
        # getEdges begins with the present edge, the stage with the first one.
        edges = tuple(self._api.person.getEdges(road_user, 0)) or tuple(stage.edges)
        self._walks[road_user] = _Walk(edges, stage.arrivalPos, stage.destStop, None)
        return True

    def _shorten_walk(self, road_user: str, lane: int) -> None:
        """Let a person walk on the edge under it only; `lane` -1 (no edge under it) keeps the last one."""
        walk = self._walks[road_user]
        edge = self._network.walks.lanes[lane].edge if lane >= 0 else walk.current_edge or walk.edges[0]
        if edge != walk.current_edge:
            self._set_walk(road_user, (edge,), 0.5 * self._lengths.get(edge, 0.0), "")
            walk.current_edge = edge

    def _set_walk(self, road_user: str, edges: tuple[str, ...], arrival: float, stop: str) -> None:
        stage = self._api.simulation.Stage(type=WALKING, edges=list(edges), arrivalPos=arrival, destStop=stop)
        self._api.person.replaceStage(road_user, 0, stage)

    def _hand_back_vehicle(self, road_user: str, off_route: bool) -> bool:
        vehicle = self._api.vehicle
        # Not the edge: for a vehicle far beside its lane SUMO keeps naming the last edge, and would lose it there.
        lane = vehicle.getLaneID(road_user)
        # Inside a junction, SUMO may brake hard for road users with which it would not have been in conflict.
        if (lane == "" or lane.startswith(":")) and not off_route:
            return False
        if lane == "":
            x, y = vehicle.getPosition(road_user)
            angle = vehicle.getAngle(road_user)
            vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE_STRICTLY, EVERYWHERE)
        self._sublanes.clear(road_user)
        self._sublanes.forget((road_user,))
        # In the sublane model SUMO moves it there.
        if not self._sublanes.on and abs(vehicle.getLateralLanePosition(road_user)) > BESIDE:
            self._beside.append(road_user)
        self._restore_modes(road_user)
        del self._modes[road_user]
        return True

    def _restore_modes(self, road_user: str) -> None:
        """Let SUMO choose the speed again, with the modes from before; a mode that a script has set meanwhile stays."""
        vehicle, modes = self._api.vehicle, self._modes[road_user]
        vehicle.setSpeed(road_user, -1.0)
        if vehicle.getSpeedMode(road_user) == MOVED:
            vehicle.setSpeedMode(road_user, modes.speed)
        if vehicle.getLaneChangeMode(road_user) == modes.lane_change_meanwhile:
            vehicle.setLaneChangeMode(road_user, modes.lane_change)

    def _hand_back_person(self, road_user: str, off_route: bool) -> bool:
        walk = self._walks[road_user]
        if walk.current_edge is None or self._does_not_walk(road_user):
            # Never moved: its walk is unchanged. Or SUMO or a script has begun another stage.
            del self._walks[road_user]
            return True
        x, y = self._api.person.getPosition(road_user)
        if self._api.person.getRoadID(road_user) != walk.current_edge or not (
            off_route or self._is_on(walk.current_edge, x, y)
        ):
            return False
        edges = self._rest_of(walk)
        if not edges:
            return False
        self._restore_walk(road_user, edges)
        if not off_route and not self._does_not_walk(road_user):
            # A new walk begins at the right side of the lane; this move keeps the person where it is. Not on release:
            # beside its edge a person would stand for ever, and if the simulation is closed with a move of a person
            # pending, libsumo crashes in the next simulation of the process. A walk that is at its end is over at once:
            # the person may ride or be in an <access> stage already.
            angle = self._api.person.getAngle(road_user)
            self._api.person.moveToXY(road_user, "", x, y, angle, KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON)
        del self._walks[road_user]
        return True

    def _restore_walk(self, road_user: str, edges: tuple[str, ...]) -> None:
        """Let a person walk along `edges` to its own destination."""
        walk = self._walks[road_user]
        arrival = min(max(walk.arrival, 0.0), self._lengths.get(edges[-1], 0.0))
        self._set_walk(road_user, edges, arrival, walk.stop)

    def _is_on(self, edge: str, x: float, y: float) -> bool:
        """Whether a position is on an edge, and not beside it or on a crossing that SUMO assigns to the edge."""
        lane = int(self._network.walks.lanes_under(np.array([x]), np.array([y]))[0])
        return lane >= 0 and self._network.walks.lanes[lane].edge == edge

    def _rest_of(self, walk: _Walk) -> tuple[str, ...]:
        """The edges from a person's present one to its destination; () where there is no route."""
        if walk.current_edge is None:
            return ()
        if walk.current_edge in walk.edges:
            return walk.edges[walk.edges.index(walk.current_edge) :]
        stages = self._api.simulation.findIntermodalRoute(walk.current_edge, walk.edges[-1], "")
        return tuple(edge for stage in stages if stage.type == WALKING for edge in stage.edges)
