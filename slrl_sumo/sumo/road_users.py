"""Access to single road users: routes, walks, lanes, limits and leaders of vehicles and persons, and insertion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from slrl_sumo.sumo.api import StageRecord, SumoApi

WALKING_STAGE = 2
"""Type of a walking stage (https://sumo.dlr.de/docs/TraCI/Person_Value_Retrieval.html)."""

STOP_STATES = "rRyYu"
"""States of a link at which vehicles stop, if they can (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html)."""
LEADER_WITHIN = 100.0
"""Distance (m) within which SUMO looks for the leader of a vehicle that is to be taken over."""


def loaded_ids(api: SumoApi) -> frozenset[str]:
    """Ids of all vehicles and persons in the simulation, including teleporting vehicles and riding persons."""
    return frozenset(api.vehicle.getIDList()) | frozenset(api.person.getIDList())


def loaded_count(api: SumoApi) -> int:
    """Number of vehicles and persons that SUMO has loaded, including those before their departure."""
    return api.vehicle.getIDCount() + api.person.getIDCount()


def vehicle_ids(api: SumoApi) -> frozenset[str]:
    """Ids of all vehicles in the simulation."""
    return frozenset(api.vehicle.getIDList())


def arrived_ids(api: SumoApi) -> frozenset[str]:
    """Ids of the vehicles and persons that arrived in the last step."""
    return frozenset(api.simulation.getArrivedIDList()) | frozenset(api.simulation.getArrivedPersonIDList())


def type_id(api: SumoApi, road_user: str, walks: bool) -> str:
    """The vType of a road user."""
    return api.person.getTypeID(road_user) if walks else api.vehicle.getTypeID(road_user)


def wanted_speed(api: SumoApi, road_user: str, walks: bool) -> float:
    """Desired speed (m/s): the walking speed of a person; for a vehicle the limit of its lane times its speed factor,
    at most its own top speed."""
    return api.person.getMaxSpeed(road_user) if walks else api.vehicle.getAllowedSpeed(road_user)


def departure_delay(api: SumoApi, vehicle: str) -> float:
    """Time (s) for which a vehicle waited for room on its first lane."""
    return api.vehicle.getDepartDelay(vehicle)


def emission_class(api: SumoApi, vehicle: str) -> str:
    """SUMO's emission class of a vehicle."""
    return api.vehicle.getEmissionClass(vehicle)


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """Parameters of a vehicle's type: m/s², m/s and s."""

    vehicle_class: str
    accel: float
    decel: float
    emergency_decel: float
    max_speed: float
    speed_factor: float
    tau: float
    """Headway of the car-following model, s."""


def vehicle_parameters(api: SumoApi, vehicle: str) -> VehicleParameters:
    """Read the parameters of a vehicle."""
    domain = api.vehicle
    return VehicleParameters(
        vehicle_class=domain.getVehicleClass(vehicle),
        accel=domain.getAccel(vehicle),
        decel=domain.getDecel(vehicle),
        emergency_decel=domain.getEmergencyDecel(vehicle),
        max_speed=domain.getMaxSpeed(vehicle),
        speed_factor=domain.getSpeedFactor(vehicle),
        tau=domain.getTau(vehicle),
    )


class TypeParameters(NamedTuple):
    """Parameters of a vehicle type."""

    limits: tuple[float, float, float]
    """Acceleration, deceleration and emergency deceleration, m/s²."""
    vehicle_class: str


def type_parameters(api: SumoApi, vehicle_type: str) -> TypeParameters:
    """Read the parameters of a vehicle type."""
    domain = api.vehicletype
    limits = domain.getAccel(vehicle_type), domain.getDecel(vehicle_type), domain.getEmergencyDecel(vehicle_type)
    return TypeParameters(limits, domain.getVehicleClass(vehicle_type))


class Motor(NamedTuple):
    """Top speed, emission class and vehicle class of a vehicle type."""

    max_speed: float
    """Top speed on any lane, m/s."""
    emission_class: str
    vehicle_class: str


def motors(api: SumoApi) -> dict[str, Motor]:
    """The `Motor` of each vehicle type that SUMO has loaded, by id."""
    domain = api.vehicletype
    return {
        name: Motor(domain.getMaxSpeed(name), domain.getEmissionClass(name), domain.getVehicleClass(name))
        for name in domain.getIDList()
    }


def vehicle_lane(api: SumoApi, vehicle: str) -> str:
    """The lane under a vehicle; '' if SUMO has it on no lane."""
    return api.vehicle.getLaneID(vehicle)


def vehicle_route(api: SumoApi, vehicle: str) -> tuple[tuple[str, ...], int]:
    """The edges of a vehicle's route and the index of the present one, -1 before the departure."""
    return tuple(api.vehicle.getRoute(vehicle)), api.vehicle.getRouteIndex(vehicle)


def route_id(api: SumoApi, vehicle: str) -> str:
    """Id of a vehicle's route: it changes when the vehicle is rerouted."""
    return api.vehicle.getRouteID(vehicle)


def vehicle_speed(api: SumoApi, vehicle: str) -> float:
    """Speed of a vehicle, m/s."""
    return api.vehicle.getSpeed(vehicle)


def waiting_time(api: SumoApi, vehicle: str) -> float:
    """Time (s) for which a vehicle has been slower than 0.1 m/s."""
    return api.vehicle.getWaitingTime(vehicle)


def lane_position(api: SumoApi, vehicle: str) -> float:
    """Distance (m) from the begin of a vehicle's lane to its front."""
    return api.vehicle.getLanePosition(vehicle)


def allowed_speed(api: SumoApi, vehicle: str) -> float:
    """Allowed speed (m/s): the limit of a vehicle's lane times its speed factor, at most the vehicle's desired
    speed."""
    return api.vehicle.getAllowedSpeed(vehicle)


def vehicles_on_lane(api: SumoApi, lane: str) -> tuple[str, ...]:
    """Ids of the vehicles on a lane after the last step."""
    return api.lane.getLastStepVehicleIDs(lane)


def leader_of(api: SumoApi, vehicle: str, distance: float) -> tuple[str, float] | None:
    """SUMO's leader of a vehicle within `distance` m, and the gap (m) minus the minGap of the vehicle."""
    leader = api.vehicle.getLeader(vehicle, distance)
    return leader if leader and leader[0] else None


def needed_deceleration(api: SumoApi, vehicle: str, time: float) -> float:
    """Deceleration (m/s²) that a vehicle needs to stop before its next signal, if that is red or yellow, and to adapt
    to the speed of its leader, if it begins to brake after `time` (s); inf if it is too late."""
    speed = api.vehicle.getSpeed(vehicle)
    needed = 0.0
    for _, _, distance, state in api.vehicle.getNextTLS(vehicle)[:1]:
        if state in STOP_STATES:
            needed = _deceleration(speed, distance - speed * time)
    leader = leader_of(api, vehicle, LEADER_WITHIN)
    if leader is not None:
        faster = max(speed - api.vehicle.getSpeed(leader[0]), 0.0)
        needed = max(needed, _deceleration(faster, leader[1] - faster * time))
    return needed


def _deceleration(speed: float, distance: float) -> float:
    """Deceleration (m/s²) from `speed` (m/s) to 0 within `distance` (m); inf without a distance."""
    if speed <= 0.0:
        return 0.0
    return speed * speed / (2.0 * distance) if distance > 0.0 else math.inf


def person_edge(api: SumoApi, person: str) -> str:
    """The edge, walking area or crossing under a person; '' if SUMO has it on none."""
    return api.person.getRoadID(person)


def walk_of(api: SumoApi, person: str) -> tuple[tuple[str, ...], float]:
    """The remaining edges of a person's walk, from the present edge on, and the position (m) of its end on the last."""
    return tuple(api.person.getEdges(person, 0)), api.person.getStage(person, 0).arrivalPos


def walking_speed(api: SumoApi, person: str) -> float:
    """Walking speed of a person, m/s."""
    return api.person.getMaxSpeed(person)


def find_route(api: SumoApi, start: str, end: str, vehicle_type: str) -> tuple[str, ...]:
    """The edges of SUMO's fastest route from one edge to another; () without a route."""
    return tuple(api.simulation.findRoute(start, end, vehicle_type).edges)


def find_walk(api: SumoApi, start: str, end: str) -> tuple[StageRecord, ...]:
    """The stages of a person's walk from one edge to another; () without a walk."""
    return tuple(api.simulation.findIntermodalRoute(start, end, ""))


def insert_vehicle(
    api: SumoApi, vehicle: str, route: str, edges: Sequence[str], vehicle_type: str, lane: str, position: float
) -> None:
    """Insert a vehicle that SUMO drives along `edges`, at `position` (m) on `lane`, as the new route `route`."""
    api.route.add(route, edges)
    lane_index = lane.rsplit("_", 1)[1]
    api.vehicle.add(vehicle, route, vehicle_type, departLane=lane_index, departPos=f"{position:.2f}")


def insert_pedestrian(
    api: SumoApi, person: str, person_type: str, edge: str, position: float, walk: Sequence[StageRecord]
) -> None:
    """Insert a person that walks from `position` (m) on `edge`; with an empty `walk`, to 1 m from the begin of
    `edge`."""
    api.person.add(person, edge, position, typeID=person_type)
    for stage in walk or (api.simulation.Stage(type=WALKING_STAGE, edges=[edge], arrivalPos=1.0),):
        api.person.appendStage(person, stage)
