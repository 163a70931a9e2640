"""Reading all road users out of SUMO, once per step."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, centre_from_front, heading_from_sumo
from slrl_sumo.scene.types import RoadUserType

# Numbers of TraCI variables and commands, the same in libsumo and traci
# (https://sumo.dlr.de/docs/TraCI/Vehicle_Value_Retrieval.html).
POSITION, ANGLE, SPEED, ROAD_ID, LANE_ID, LANE_POSITION, TYPE, RIDES_IN = 0x42, 0x43, 0x40, 0x50, 0x51, 0x56, 0x4F, 0xC3
VEHICLES, PERSONS = 0xA4, 0xAE
VEHICLE_VARIABLES = (POSITION, ANGLE, SPEED, LANE_ID, LANE_POSITION, TYPE)
PERSON_VARIABLES = (POSITION, ANGLE, SPEED, ROAD_ID, LANE_POSITION, TYPE, RIDES_IN)
EVERYWHERE = 1e7
"""m; wider than any network."""
INVALID = -1e9
"""Positions below this mean that SUMO has the vehicle on no lane (it writes -2^30)."""


_Row = tuple[str, str, tuple[float, float], float, float, str, float]
"""Id, vType, position, angle, speed, lane or edge, and m along that."""


@dataclass(frozen=True)
class Snapshot:
    """All road users that SUMO has on the network after a step: parallel tuples and arrays of length n.

    Vehicles come first, then persons on foot; each in SUMO's order. World frame: centres, m, rad, m/s.
    """

    ids: tuple[str, ...]
    person: NDArray[np.bool_]
    type: NDArray[np.int8]
    """RoadUserType; everything on wheels that is no bicycle counts as CAR."""
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats
    sumo_type: tuple[str, ...]
    """vType id."""
    lane: tuple[str, ...]
    """Lane id of vehicles, edge id of persons; '' where SUMO maps them nowhere."""
    lane_position: Floats
    """m from the begin of the lane or edge; 0 where `lane` is ''."""


class Reader:
    """Reads all road users of a simulation with one call.

    libsumo is asked one by one. Over a TraCI connection, where each question is a message, two subscriptions "round" an
    edge and a lane that reach everywhere bring all vehicles and all persons; for these SUMO looks at every lane of the
    network in every step, which took 26 ms in a city of 81,000 lanes, and twice the time of the step elsewhere.
    Subscribing to the road users themselves would mix with a user's own subscriptions in a script: SUMO keeps one per
    road user, adds the variables together, and cancels all of them at once.
    """

    def __init__(self, api: Any) -> None:
        self._api = api
        self._subscribes = getattr(api, "__name__", "") != "libsumo"
        self._types: dict[tuple[str, bool], tuple[int, float, float]] = {}
        # Where no edge is there is nobody to read.
        self._edge, self._lane = min(api.edge.getIDList(), default=""), min(api.lane.getIDList(), default="")
        self._subscribed = False

    def read(self) -> Snapshot:
        """All road users on the network now. Costs about 2 us a road user with libsumo."""
        of_edge = of_lane = {}
        if self._subscribes:
            self._subscribe()
            of_edge = self._api.edge.getContextSubscriptionResults(self._edge)
            of_lane = self._api.lane.getContextSubscriptionResults(self._lane)
        vehicles = _rows(self._api.vehicle, of_edge, LANE_ID)
        rows = vehicles + _rows(self._api.person, of_lane, ROAD_ID)
        ids, types, positions, angles, speeds, lanes, lane_positions = (
            tuple(column) for column in (zip(*rows, strict=True) if rows else ((),) * 7)
        )
        person = np.arange(len(rows)) >= len(vehicles)
        statics = [self._static(sumo_type, bool(person[i])) for i, sumo_type in enumerate(types)]
        length = np.array([s[1] for s in statics], np.float64)
        width = np.array([s[2] for s in statics], np.float64)
        front = np.array(positions, np.float64).reshape(-1, 2)
        heading = heading_from_sumo(np.array(angles, np.float64))
        x, y = centre_from_front(front[:, 0], front[:, 1], heading, length)
        along = np.array(lane_positions, np.float64)
        return Snapshot(
            ids=ids,
            person=person,
            type=np.array([s[0] for s in statics], np.int8),
            x=x,
            y=y,
            heading=heading,
            # SUMO reports tiny negative speeds after rounding.
            speed=np.maximum(np.array(speeds, np.float64), 0.0),
            length=length,
            width=width,
            sumo_type=types,
            lane=tuple("" if p < INVALID else lane for lane, p in zip(lanes, lane_positions, strict=True)),
            lane_position=np.where(along < INVALID, 0.0, np.maximum(along, 0.0)),
        )

    def forget(self) -> None:
        """Cancel the subscriptions that this reader made."""
        if self._subscribed:
            self._api.edge.unsubscribeContext(self._edge, VEHICLES, EVERYWHERE)
            self._api.lane.unsubscribeContext(self._lane, PERSONS, EVERYWHERE)
            self._subscribed = False

    def _subscribe(self) -> None:
        if not self._subscribed:
            self._api.edge.subscribeContext(self._edge, VEHICLES, EVERYWHERE, VEHICLE_VARIABLES)
            self._api.lane.subscribeContext(self._lane, PERSONS, EVERYWHERE, PERSON_VARIABLES)
            self._subscribed = True

    def _static(self, sumo_type: str, person: bool) -> tuple[int, float, float]:
        """RoadUserType, length and width (m) of a vType. SUMO gives a vehicle that is changed a type of its own."""
        static = self._types.get((sumo_type, person))
        if static is None:
            types = self._api.vehicletype
            kind = RoadUserType.PEDESTRIAN
            if not person:
                kind = RoadUserType.BICYCLE if types.getVehicleClass(sumo_type) == "bicycle" else RoadUserType.CAR
            static = int(kind), types.getLength(sumo_type), types.getWidth(sumo_type)
            self._types[sumo_type, person] = static
        return static


def _rows(domain: Any, results: Any, place: int) -> list[_Row]:
    found = dict(results)
    rows = []
    for road_user in domain.getIDList():
        # Who is on no lane, as somebody moved from outside may be, is in no lane's surroundings either.
        values = found.get(road_user)
        row = _asked(domain, road_user, place) if values is None else _told(road_user, values, place)
        if row is not None:
            rows.append(row)
    return rows


def _told(road_user: str, values: dict[int, Any], place: int) -> _Row | None:
    """What a subscription says of a road user; None off the network: teleporting, not yet inserted, or (persons)
    inside a vehicle."""
    position = values[POSITION]
    if position[0] < INVALID or values.get(RIDES_IN):
        return None
    return road_user, values[TYPE], position, values[ANGLE], values[SPEED], values[place], values[LANE_POSITION]


def _asked(domain: Any, road_user: str, place: int) -> _Row | None:
    """What the subscription would say of a road user, asked one by one."""
    position = domain.getPosition(road_user)
    if position[0] < INVALID or (place == ROAD_ID and domain.getVehicle(road_user)):
        return None
    return (
        road_user,
        domain.getTypeID(road_user),
        position,
        domain.getAngle(road_user),
        domain.getSpeed(road_user),
        domain.getLaneID(road_user) if place == LANE_ID else domain.getRoadID(road_user),
        domain.getLanePosition(road_user),
    )
