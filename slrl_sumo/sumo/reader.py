"""Reading all road users out of SUMO, once per step."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, centre_from_front, heading_from_sumo
from slrl_sumo.scene.types import MAX_POSITION, RoadUserType
from slrl_sumo.sumo.api import PersonDomain, SumoApi, VehicleDomain

# Numbers of TraCI variables and commands, the same in libsumo and traci
# (https://sumo.dlr.de/docs/TraCI/Vehicle_Value_Retrieval.html).
POSITION, ANGLE, SPEED, ROAD_ID, LANE_ID, LANE_POSITION, TYPE, RIDES_IN = 0x42, 0x43, 0x40, 0x50, 0x51, 0x56, 0x4F, 0xC3
VEHICLES, PERSONS = 0xA4, 0xAE
VEHICLE_VARIABLES = (POSITION, ANGLE, SPEED, LANE_ID, LANE_POSITION, TYPE)
PERSON_VARIABLES = (POSITION, ANGLE, SPEED, ROAD_ID, LANE_POSITION, TYPE, RIDES_IN)
EVERYWHERE = 1e7
"""Distance (m) greater than any network."""
INVALID = -1e9
"""A position below this means that SUMO has the vehicle on no lane (it writes -2^30)."""

_Front = tuple[str, tuple[float, float], str, float]
"""Id of a spawned vehicle, position of its front, lane, and position (m) along the lane."""
_Row = tuple[str, str, tuple[float, float], float, float, str, float]
"""Id, vType, position, angle, speed, lane or edge, and position (m) along the lane or edge."""


@dataclass(frozen=True)
class SpawnedPlaces:
    """The spawned road users on the network after a SUMO step, whose states the caller knows."""

    persons: tuple[str, ...]
    vehicles: tuple[str, ...]
    front_x: Floats
    """Front of each vehicle, m."""
    front_y: Floats
    lane: tuple[str, ...]
    """Lane of each vehicle; '' for vehicles that SUMO has on no lane."""
    lane_position: Floats
    """Position, m from the begin of the lane; 0 if `lane` is ''."""


@dataclass(frozen=True)
class Snapshot:
    """All road users on the network after a SUMO step: parallel tuples and arrays of length n.

    Vehicles come first, then persons on foot, each in SUMO's order. World frame: centres, m, rad, m/s.
    """

    ids: tuple[str, ...]
    person: NDArray[np.bool_]
    type: NDArray[np.int8]
    """RoadUserType; each vehicle that is not a bicycle counts as CAR."""
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats
    sumo_type: tuple[str, ...]
    """vType id."""
    lane: tuple[str, ...]
    """Lane id of vehicles, edge id of persons; '' for road users that SUMO has on no lane or edge."""
    lane_position: Floats
    """Position, m from the begin of the lane or edge; 0 if `lane` is ''."""
    spawned: SpawnedPlaces
    """The spawned road users, which are not among the n."""

    @property
    def present(self) -> frozenset[str]:
        """Ids of all road users on the network."""
        return frozenset(self.ids).union(self.spawned.persons, self.spawned.vehicles)


class Reader:
    """Reads all road users of a simulation with one call.

    With libsumo, each value needs a call. Over a TraCI connection, each call is a message; there, two context
    subscriptions with unlimited range, of an edge and of a lane, deliver all vehicles and all persons. For them, SUMO
    visits each lane of the network in each step, which took 26 ms in a city of 81,000 lanes, and elsewhere twice the
    time of the step. Subscriptions to the road users themselves would mix with the subscriptions of a user's script:
    SUMO has one subscription per road user, merges the variables, and cancels all of them together.
    """

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._subscribes = getattr(api, "__name__", "") != "libsumo"
        self._types: dict[tuple[str, bool], tuple[int, float, float]] = {}
        # Without edges there are no road users to read.
        self._edge, self._lane = min(api.edge.getIDList(), default=""), min(api.lane.getIDList(), default="")
        self._subscribed = False
        self._headings: tuple[tuple[str, ...], Floats] = (), np.zeros(0)
        """Ids and headings of the road users at the last reading."""

    def read(self, spawned: Set[str] = frozenset()) -> Snapshot:
        """All road users on the network now. Takes about 2 us per road user with libsumo.

        `spawned`: ids of spawned road users that the caller moves: only what it does not know of them is read.
        """
        of_edge: Mapping[str, Mapping[int, Any]] = {}
        of_lane = of_edge
        if self._subscribes:
            self._subscribe()
            of_edge = self._api.edge.getContextSubscriptionResults(self._edge)
            of_lane = self._api.lane.getContextSubscriptionResults(self._lane)
        vehicles, fronts = _vehicles(self._api.vehicle, of_edge, spawned)
        persons, spawned_persons = _persons(self._api.person, of_lane, spawned)
        rows = vehicles + persons
        ids, types, positions, angles, speeds, lanes, lane_positions = (
            tuple(column) for column in (zip(*rows, strict=True) if rows else ((),) * 7)
        )
        person = np.arange(len(rows)) >= len(vehicles)
        statics = [self._static(key) for key in zip(types, person.tolist(), strict=True)]
        length = np.array([s[1] for s in statics], np.float64)
        width = np.array([s[2] for s in statics], np.float64)
        front = np.array(positions, np.float64).reshape(-1, 2)
        heading = self._without_nan(ids, heading_from_sumo(np.array(angles, np.float64)))
        x, y = centre_from_front(front[:, 0], front[:, 1], heading, length)
        on_lane, along = _on_lanes(lanes, lane_positions)
        return Snapshot(
            ids=ids,
            person=person,
            type=np.array([s[0] for s in statics], np.int8),
            x=x,
            y=y,
            heading=heading,
            # After rounding, SUMO reports tiny negative speeds.
            speed=np.maximum(_finite(speeds), 0.0),
            length=length,
            width=width,
            sumo_type=types,
            lane=on_lane,
            lane_position=along,
            spawned=_spawned(spawned_persons, fronts),
        )

    def _without_nan(self, ids: tuple[str, ...], heading: Floats) -> Floats:
        """`heading` with NaN replaced by the heading of the last reading, else 0.

        libsumo 1.28 returned NaN in one step for a vehicle of 0.6 m that started again 4 m beside the middle of its
        lane.
        """
        unknown = np.flatnonzero(~np.isfinite(heading))
        if len(unknown):
            before = dict(zip(*self._headings, strict=True))
            heading[unknown] = [before.get(ids[row], 0.0) for row in unknown]
        self._headings = ids, heading
        return heading

    def forget(self) -> None:
        """Cancel the subscriptions of this reader."""
        if self._subscribed:
            self._api.edge.unsubscribeContext(self._edge, VEHICLES, EVERYWHERE)
            self._api.lane.unsubscribeContext(self._lane, PERSONS, EVERYWHERE)
            self._subscribed = False

    def _subscribe(self) -> None:
        if not self._subscribed:
            self._api.edge.subscribeContext(self._edge, VEHICLES, EVERYWHERE, VEHICLE_VARIABLES)
            self._api.lane.subscribeContext(self._lane, PERSONS, EVERYWHERE, PERSON_VARIABLES)
            self._subscribed = True

    def _static(self, key: tuple[str, bool]) -> tuple[int, float, float]:
        """RoadUserType, length and width (m) of a vType, by id and whether it is a person's; SUMO gives vehicles with
        changed parameters their own vType."""
        static = self._types.get(key)
        if static is None:
            types, (sumo_type, person) = self._api.vehicletype, key
            kind = RoadUserType.PEDESTRIAN
            if not person:
                kind = RoadUserType.BICYCLE if types.getVehicleClass(sumo_type) == "bicycle" else RoadUserType.CAR
            static = self._types[key] = int(kind), types.getLength(sumo_type), types.getWidth(sumo_type)
        return static


def _vehicles(
    domain: VehicleDomain, subscribed: Mapping[str, Mapping[int, Any]], spawned: Set[str]
) -> tuple[list[_Row], list[_Front]]:
    """The vehicles on the network, without vehicles that teleport or are not inserted yet: others, and `spawned`."""
    rows: list[_Row] = []
    fronts: list[_Front] = []
    for vehicle in domain.getIDList():
        # The context subscription lacks vehicles beside all lanes, where moved vehicles may be.
        values = subscribed.get(vehicle)
        if vehicle in spawned:
            position = domain.getPosition(vehicle) if values is None else values[POSITION]
            if _is_place(position):
                lane = domain.getLaneID(vehicle) if values is None else values[LANE_ID]
                along = domain.getLanePosition(vehicle) if values is None else values[LANE_POSITION]
                fronts.append((vehicle, position, lane, along))
        elif values is not None:
            if _is_place(values[POSITION]):
                rows.append(_subscribed_row(vehicle, values, values[LANE_ID]))
        elif _is_place(position := domain.getPosition(vehicle)):
            rows.append(
                (
                    vehicle,
                    domain.getTypeID(vehicle),
                    position,
                    domain.getAngle(vehicle),
                    domain.getSpeed(vehicle),
                    domain.getLaneID(vehicle),
                    domain.getLanePosition(vehicle),
                )
            )
    return rows, fronts


def _persons(
    domain: PersonDomain, subscribed: Mapping[str, Mapping[int, Any]], spawned: Set[str]
) -> tuple[list[_Row], tuple[str, ...]]:
    """The persons on foot: others, and the ids of the `spawned` ones."""
    rows: list[_Row] = []
    found: list[str] = []
    for person in domain.getIDList():
        values = subscribed.get(person)
        if person in spawned:
            if _is_place(domain.getPosition(person) if values is None else values[POSITION]):
                found.append(person)
        elif values is not None:
            if _is_place(values[POSITION]) and not values[RIDES_IN]:
                rows.append(_subscribed_row(person, values, values[ROAD_ID]))
        elif _is_place(position := domain.getPosition(person)) and not domain.getVehicle(person):
            rows.append(
                (
                    person,
                    domain.getTypeID(person),
                    position,
                    domain.getAngle(person),
                    domain.getSpeed(person),
                    domain.getRoadID(person),
                    domain.getLanePosition(person),
                )
            )
    return rows, tuple(found)


def _spawned(persons: tuple[str, ...], vehicles: Sequence[_Front]) -> SpawnedPlaces:
    ids, fronts, lanes, lane_positions = zip(*vehicles, strict=True) if vehicles else ((),) * 4
    front = np.array(fronts, np.float64).reshape(-1, 2)
    return SpawnedPlaces(persons, ids, front[:, 0], front[:, 1], *_on_lanes(lanes, lane_positions))


def _on_lanes(lanes: Sequence[str], positions: Sequence[float]) -> tuple[tuple[str, ...], Floats]:
    """Lanes and positions (m) along them; '' and 0 for road users that SUMO has on no lane."""
    along = _finite(positions)
    on_lane = tuple(["" if p < INVALID else lane for lane, p in zip(lanes, positions, strict=True)])
    return on_lane, np.where(along < INVALID, 0.0, np.maximum(along, 0.0))


def _finite(values: Sequence[float]) -> Floats:
    """The values, (n,), with 0 for values that are not finite.

    libsumo 1.28 returned NaN for the speed and the position of a person in a walking area.
    """
    given = np.array(values, np.float64)
    return np.where(np.isfinite(given), given, 0.0)


def _is_place(position: tuple[float, ...]) -> bool:
    """Whether a position is valid: SUMO gives INVALID to road users off the network, and infinity on lanes without
    width."""
    x, y = position[:2]
    return -MAX_POSITION < x < MAX_POSITION and -MAX_POSITION < y < MAX_POSITION


def _subscribed_row(road_user: str, values: Mapping[int, Any], place: str) -> _Row:
    return road_user, values[TYPE], values[POSITION], values[ANGLE], values[SPEED], place, values[LANE_POSITION]
