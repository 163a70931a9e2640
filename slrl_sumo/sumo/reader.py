"""Reading all road users out of SUMO, once per step."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.geometry import Floats, centre_from_front, heading_from_sumo
from slrl_sumo.world.types import RoadUserType

# Numbers of TraCI variables, the same in libsumo and traci
# (https://sumo.dlr.de/docs/TraCI/Vehicle_Value_Retrieval.html).
POSITION, ANGLE, SPEED, ROAD_ID, LANE_ID, LANE_POSITION, RIDES_IN = 0x42, 0x43, 0x40, 0x50, 0x51, 0x56, 0xC3
VEHICLE_VARIABLES = (POSITION, ANGLE, SPEED, LANE_ID, LANE_POSITION)
PERSON_VARIABLES = (POSITION, ANGLE, SPEED, ROAD_ID, LANE_POSITION, RIDES_IN)
INVALID = -1e9
"""Positions below this mean that SUMO has the vehicle on no lane (it writes -2^30)."""


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
    """Keeps subscriptions to all road users of a simulation, so that one call reads them all."""

    def __init__(self, api: Any) -> None:
        self._api = api
        self._vehicles: dict[str, tuple[str, int, float, float]] = {}
        self._persons: dict[str, tuple[str, int, float, float]] = {}

    def read(self) -> Snapshot:
        """All road users on the network now. Costs about 4 us a road user with libsumo."""
        vehicles = self._domain(self._api.vehicle, self._vehicles, VEHICLE_VARIABLES, LANE_ID)
        persons = self._domain(self._api.person, self._persons, PERSON_VARIABLES, ROAD_ID)
        rows = vehicles + persons
        ids, statics, positions, angles, speeds, lanes, lane_positions = (
            tuple(column) for column in (zip(*rows, strict=True) if rows else ((),) * 7)
        )
        person = np.arange(len(rows)) >= len(vehicles)
        types = np.array([s[1] for s in statics], np.int8)
        length = np.array([s[2] for s in statics], np.float64)
        width = np.array([s[3] for s in statics], np.float64)
        front = np.array(positions, np.float64).reshape(-1, 2)
        heading = heading_from_sumo(np.array(angles, np.float64))
        x, y = centre_from_front(front[:, 0], front[:, 1], heading, length)
        along = np.array(lane_positions, np.float64)
        return Snapshot(
            ids=ids,
            person=person,
            type=types,
            x=x,
            y=y,
            heading=heading,
            # SUMO reports tiny negative speeds after rounding.
            speed=np.maximum(np.array(speeds, np.float64), 0.0),
            length=length,
            width=width,
            sumo_type=tuple(s[0] for s in statics),
            lane=tuple("" if p < INVALID else lane for lane, p in zip(lanes, lane_positions, strict=True)),
            lane_position=np.where(along < INVALID, 0.0, np.maximum(along, 0.0)),
        )

    def forget(self) -> None:
        """Cancel all subscriptions that this reader made."""
        for domain, known in ((self._api.vehicle, self._vehicles), (self._api.person, self._persons)):
            present = set(domain.getIDList())
            for road_user in known:
                if road_user in present:
                    domain.unsubscribe(road_user)
            known.clear()

    def _domain(
        self, domain: Any, known: dict[str, tuple[str, int, float, float]], variables: tuple[int, ...], place: int
    ) -> list[tuple[str, tuple[str, int, float, float], tuple[float, float], float, float, str, float]]:
        ids = domain.getIDList()
        if len(known) > 2 * len(ids) + 1000:
            for gone in set(known) - set(ids):
                del known[gone]
        results = dict(domain.getAllSubscriptionResults())
        for road_user in ids:
            # Not by `known`: a road user that left and came again under its id has lost its subscription.
            if road_user not in known or road_user not in results:
                known[road_user] = _static(domain, road_user, place == ROAD_ID)
                domain.subscribe(road_user, variables)
                results[road_user] = domain.getSubscriptionResults(road_user)
        rows = []
        for road_user in ids:
            values = results[road_user]
            position = values[POSITION]
            # Off the network: teleporting, not yet inserted, or (persons) inside a vehicle.
            if position[0] < INVALID or values.get(RIDES_IN):
                continue
            rows.append(
                (
                    road_user,
                    known[road_user],
                    position,
                    values[ANGLE],
                    values[SPEED],
                    values[place],
                    values[LANE_POSITION],
                )
            )
        return rows


def _static(domain: Any, road_user: str, person: bool) -> tuple[str, int, float, float]:
    kind = RoadUserType.PEDESTRIAN
    if not person:
        kind = RoadUserType.BICYCLE if domain.getVehicleClass(road_user) == "bicycle" else RoadUserType.CAR
    return domain.getTypeID(road_user), int(kind), domain.getLength(road_user), domain.getWidth(road_user)
