"""Vehicles under way: what the driver `lane` knows of each, and which lanes they take."""

import math
from dataclasses import dataclass

import numpy as np

from slrl_sumo.routing.lane_graph import LaneGraph, LanePath
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.lanes import MOTOR_CLASSES, LanePoints
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.road_users import allowed_speed, vehicle_lane, vehicle_parameters, vehicle_route

STRAYED = 0.5
"""m from where it was driven to: somebody else moved the vehicle, and its way is looked for anew."""
ASTRAY = 6.0
"""m beside its way beyond which a vehicle that goes where it wants is on another one."""
CYCLING = 5.6
"""m/s of bicycles that we added: their type has no speed of its own."""


@dataclass(slots=True)
class VehicleTrack:
    """What the driver knows of one vehicle."""

    way: LanePath
    s: float
    """m along the way, of the front."""
    beside: float
    """m to the left of the way, and how fast that changes in m/s."""
    slide: float
    speed: float
    edges: tuple[str, ...]
    """The route after the edge that the way begins on."""
    vehicle_class: str
    accel: float
    decel: float
    emergency: float
    top_speed: float
    factor: float
    tau: float
    x: float
    """Where the centre was driven to."""
    y: float
    stood: float = 0.0
    """s that it has stood."""
    held: bool = False
    """Somebody on its way makes it drive slower than it would."""
    free_until: float = -math.inf
    """Time until which it does not mind others that stand."""


class VehicleTracker:
    """The vehicles that are driven in a simulation, by id, each with its way."""

    def __init__(self, api: SumoApi, network: Network, graph: LaneGraph) -> None:
        self._api, self._graph = api, graph
        self._vehicles: dict[str, VehicleTrack] = {}
        self._carriageway = LanePoints(
            [lane for lane in network.lanes if lane.allowed & (MOTOR_CLASSES | {"bicycle"})], spacing=2.0
        )

    def get(self, road_user: str) -> VehicleTrack | None:
        """What is known of a vehicle."""
        return self._vehicles.get(road_user)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of vehicles."""
        for road_user in ids:
            self._vehicles.pop(road_user, None)

    def left(self, road_user: str) -> float:
        """m to the end of a vehicle's route; inf where that is out of sight, or it has none, or is not known.

        inf too while somebody is in the way: SUMO would brake harder for them, or not at all.
        """
        drive = self._vehicles.get(road_user)
        if drive is None or drive.held or road_user.startswith("learned_"):
            return math.inf
        way, lanes = drive.way, self._graph.lanes
        last = lanes[way.lanes[-1]].edge
        ends = last == (drive.edges[-1] if drive.edges else lanes[way.lanes[0]].edge)
        return way.end - drive.s if ends else math.inf

    def known(self, state: WorldState, i: int) -> VehicleTrack:
        """What is known of the vehicle in row `i` of `state`, brought up to date; asked of SUMO where it is new."""
        road_user = state.ids[i]
        drive = self._vehicles.get(road_user)
        if drive is None or math.hypot(state.x[i] - drive.x, state.y[i] - drive.y) > STRAYED:
            drive = self._vehicles[road_user] = self._adopt(state, i)
        else:
            self._roll_on(road_user, drive, float(state.length[i]))
        return drive

    def followed(self, state: WorldState, i: int, dt: float) -> VehicleTrack:
        """What is known of the vehicle in row `i` of `state`, which went where it wanted: `s` is that of its front,
        and `beside` that of its centre. `dt`: s since it was looked at last."""
        road_user, half = state.ids[i], 0.5 * state.length.item(i)
        x, y, speed = state.x.item(i), state.y.item(i), state.speed.item(i)
        drive = self._vehicles.get(road_user)
        if drive is not None:
            begin = drive.s - half - 2.0
            place, drive.beside, distance = drive.way.line.place(x, y, begin, begin + 6.0 + 1.5 * speed * dt)
            if distance < ASTRAY:
                drive.s = max(place + half, 0.0)
                if drive.s >= drive.way.ends[0]:
                    self._roll_on(road_user, drive, 2.0 * half)
            else:
                drive = None
        if drive is None:
            stood = self._vehicles[road_user].stood if road_user in self._vehicles else 0.0
            drive = self._vehicles[road_user] = self._adopt(state, i)
            drive.stood = stood
            place, drive.beside = drive.way.line.nearest(x, y, drive.s - 2.0 * half - 2.0, drive.s + half)
            drive.s = max(place + half, 0.0)
        drive.x, drive.y, drive.speed, drive.slide = x, y, speed, 0.0
        drive.stood = drive.stood + dt if speed < 0.1 else 0.0
        return drive

    def _adopt(self, state: WorldState, i: int) -> VehicleTrack:
        """Find out about a vehicle: its type, and where on its way it is."""
        road_user, edges = state.ids[i], tuple[str, ...]()
        parameters = vehicle_parameters(self._api, road_user)
        length, heading = float(state.length[i]), float(state.heading[i])
        front = (
            float(state.x[i]) + 0.5 * length * math.cos(heading),
            float(state.y[i]) + 0.5 * length * math.sin(heading),
        )
        if road_user.startswith("learned_"):
            # What we added has no class and no lane that SUMO could be asked for.
            vehicle_class = "bicycle" if state.type[i] == RoadUserType.BICYCLE else "passenger"
            lane = self._lane_under(front, heading, vehicle_class)
        else:
            vehicle_class = parameters.vehicle_class
            lane = vehicle_lane(self._api, road_user) or self._lane_under(front, heading, vehicle_class)
            route, index = vehicle_route(self._api, road_user)
            edges = route[index + 1 :]
        way = self._graph.way(lane, edges, vehicle_class, self._tail(lane, length), _dice(road_user))
        s, beside = way.line.nearest(*front, end=way.ends[0])
        drive = VehicleTrack(
            way=way,
            s=s,
            beside=beside,
            slide=0.0,
            speed=float(state.speed[i]),
            edges=edges,
            vehicle_class=vehicle_class,
            accel=max(parameters.accel, 0.1),
            decel=max(parameters.decel, 0.1),
            emergency=max(parameters.emergency_decel, parameters.decel, 0.1),
            top_speed=CYCLING if road_user.startswith("learned_bicycle") else parameters.max_speed,
            factor=parameters.speed_factor,
            tau=parameters.tau,
            x=float(state.x[i]),
            y=float(state.y[i]),
        )
        self._learn_top_speed(road_user, drive, lane)
        return drive

    def _learn_top_speed(self, road_user: str, drive: VehicleTrack, lane: str) -> None:
        """What the vehicle itself wants at most (desiredMaxSpeed) can only be seen where its lane allows more."""
        if road_user.startswith("learned_") or vehicle_lane(self._api, road_user) != lane:
            return
        allowed = allowed_speed(self._api, road_user)
        if allowed < self._graph.lanes[lane].max_speed * drive.factor - 0.01:
            drive.top_speed = min(drive.top_speed, allowed)

    def _lane_under(self, front: tuple[float, float], heading: float, vehicle_class: str) -> str:
        """The lane near a position that goes its way, if any does."""
        near = self._carriageway.nearest(np.array([front[0]]), np.array([front[1]]), 24)[0]
        lanes = [self._carriageway.lanes[k].id for k in self._carriageway.lane[near]]
        turns = np.abs(wrap_angle(self._carriageway.heading[near] - heading))
        fitting = [
            lane for lane, t in zip(lanes, turns, strict=True) if t < 1.0 and self._graph.admits(lane, vehicle_class)
        ]
        chosen: str = (fitting or lanes)[0]
        return chosen

    def _tail(self, lane: str, length: float) -> list[tuple[float, float]]:
        """A point straight before the begin of a lane, for the rear of a vehicle that has just entered it."""
        (x0, y0), (x1, y1) = self._graph.lanes[lane].shape[:2].tolist()
        step = max(math.hypot(x1 - x0, y1 - y0), 1e-6)
        return [(x0 - (x1 - x0) / step * (length + 2.0), y0 - (y1 - y0) / step * (length + 2.0))]

    def _roll_on(self, road_user: str, drive: VehicleTrack, length: float) -> None:
        """On a new edge the way is drawn anew from there: SUMO may have changed the route, and it goes on further."""
        here = drive.way.lane_at(drive.s)
        lane = drive.way.lanes[here]
        if here == 0 or lane.startswith(":"):
            return
        edge = self._graph.lanes[lane].edge
        if not road_user.startswith("learned_"):
            route, index = vehicle_route(self._api, road_user)
            begin = max(index, 0)
            if edge in route[begin:]:
                drive.edges = route[route.index(edge, begin) + 1 :]
            elif edge in drive.edges:
                drive.edges = drive.edges[drive.edges.index(edge) + 1 :]
        start = drive.way.ends[here - 1]
        before = drive.way.line.between(min(drive.s, start) - length - 2.0, start)
        way = self._graph.way(lane, drive.edges, drive.vehicle_class, before, _dice(road_user))
        x, y, _ = drive.way.line.at(drive.s)
        drive.s, _ = way.line.nearest(x, y, end=way.ends[0])
        drive.way = way
        self._learn_top_speed(road_user, drive, lane)

    def choose_lane(self, road_user: str, drive: VehicleTrack, world: WorldState, i: int) -> None:
        """Begin to change to the lane that the route needs, where there is a gap."""
        lane = drive.way.lanes[0]
        if not drive.edges or lane.startswith(":") or drive.way.lane_at(drive.s) > 0 or abs(drive.beside) > 0.8:
            return
        edges = (self._graph.lanes[lane].edge, *drive.edges)
        target = self._graph.beside(lane, drive.vehicle_class, edges)
        if target is None:
            return
        length = float(world.length[i])
        way = self._graph.way(target, drive.edges, drive.vehicle_class, self._tail(target, length), _dice(road_user))
        x, y, direction = drive.way.line.at(drive.s)
        x, y = x - drive.beside * math.sin(direction), y + drive.beside * math.cos(direction)
        s, beside = way.line.nearest(x, y, end=way.ends[0])
        left = drive.way.ends[0] - drive.s
        if abs(beside) < 8.0 and _gap(world, i, drive, beside, hurried=left < 50.0):
            drive.way, drive.s, drive.beside = way, s, beside


def _dice(road_user: str) -> str:
    return road_user if road_user.startswith("learned_") else ""


def _gap(world: WorldState, i: int, drive: VehicleTrack, beside: float, hurried: bool) -> bool:
    """Whether there is room for vehicle `i` of the world in the lane that is `-beside` m to its left."""
    c, s = math.cos(float(world.heading[i])), math.sin(float(world.heading[i]))
    dx, dy = world.x - world.x[i], world.y - world.y[i]
    along, across = c * dx + s * dy, c * dy - s * dx
    same_way = np.cos(world.heading - world.heading[i]) > 0.5
    # From just beside us to the far edge of the lane that we want.
    low, high = sorted((-math.copysign(0.6, beside), -beside - math.copysign(1.2, beside)))
    there = (across > low) & (across < high) & same_way & (np.arange(len(world)) != i)
    clear: Floats = np.abs(along) - 0.5 * (world.length + world.length[i])
    faster = np.where(along > 0, drive.speed - world.speed, world.speed - drive.speed)
    needed = (1.0 if hurried else 2.5) + np.maximum(faster, 0.0) * (0.6 if hurried else 1.5)
    return bool(np.all(clear[there] > needed[there]))
