"""The driver `lane`: follows its own lane and route as SUMO's vehicles do, roughly. A baseline, and a stand-in.

Speeds are Krauss' safe speeds with regard to SUMO's leader, signals, priority, lane limits, and whatever box lies on
the way; all within the acceleration and deceleration of the vehicle's type. Persons walk along the edges of their walk.
"""

import math
import random
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.lanepoints import LanePoints
from slrl_sumo.sumo.network import MOTOR_CLASSES, Network
from slrl_sumo.sumo.obstacles import Approach, slowed
from slrl_sumo.sumo.paths import SPACING
from slrl_sumo.sumo.rightofway import STOP_LINE, RightOfWay
from slrl_sumo.sumo.stroll import Strolls
from slrl_sumo.sumo.ways import LaneGraph, Way
from slrl_sumo.world.geometry import Floats, wrap_angle
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

SIDEWAYS = 1.5
"""m/s at most across the lane, and at most `SLANT` of the speed."""
SLANT = 0.3
SIDEWAYS_ACCELERATION = 1.0
"""m/s² with which a move across the lane ends."""
NEAR_END = 15.0
"""m before its destination at which SUMO should finish a trip."""
STRAYED = 0.5
"""m from where it was driven to: somebody else moved the vehicle, and its way is looked for anew."""
IMPATIENCE = 6.0
"""s after which a vehicle that stands for another one that stands too, not ahead in its lane, goes on."""
CYCLING = 5.6
"""m/s of bicycles that we added: their type has no speed of its own."""
LANE_END = 3.0
"""m before the end of its lane at which a vehicle waits for a gap beside it."""


@dataclass
class _Drive:
    """What the driver knows of one vehicle."""

    way: Way
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
    free_until: float = -math.inf
    """Time until which it does not mind others that stand."""


class LaneDriver:
    """Drives road users through `api` (libsumo or a TraCI connection): those taken over, and those that we added.

    Road users that we added (ids `learned_…`) have no route: they go on at random at junctions, the same in every run.
    """

    def __init__(self, api: Any, network: Network) -> None:
        self._api = api
        self._graph = LaneGraph(api, network)
        self._right = RightOfWay(api, self._graph)
        self._strolls = Strolls(api, network)
        self._drives: dict[str, _Drive] = {}
        self._carriageway = LanePoints(
            [lane for lane in network.lanes if lane.allowed & (MOTOR_CLASSES | {"bicycle"})], spacing=2.0
        )

    def drive(self, learned: WorldState, dt: float, others: WorldState | None = None) -> WorldState:
        """The state of n road users `dt` s later.

        `others`: the rest of the world, which SUMO's leader does not tell of (persons, vehicles across the way). Speeds
        are the distance that centres cover, over time.
        """
        self._right.renew()
        x, y, heading = learned.x.copy(), learned.y.copy(), learned.heading.copy()
        walking = learned.type == RoadUserType.PEDESTRIAN
        for i in np.flatnonzero(walking).tolist():
            x[i], y[i], heading[i] = self._strolls.step(learned.ids[i], x[i], y[i], heading[i], dt)
        rows = np.flatnonzero(~walking)
        world = learned if others is None else learned.join(others)
        drives = [self._known(learned, i) for i in rows.tolist()]
        for i, drive in zip(rows.tolist(), drives, strict=True):
            self._choose_lane(learned.ids[i], drive, world, i, dt)
        held = self._obstacles(world, rows, drives, dt)
        for i, drive, (safe, standing) in zip(rows.tolist(), drives, held, strict=True):
            x[i], y[i], heading[i] = self._advance(learned, i, drive, safe, standing, dt)
        speed = np.hypot(x - learned.x, y - learned.y) / dt
        return replace(
            learned,
            time=learned.time + dt,
            x=x,
            y=y,
            heading=wrap_angle(heading),
            speed=speed,
            acceleration=(speed - learned.speed) / dt,
            yaw_rate=wrap_angle(heading - learned.heading) / dt,
        )

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n driven road users has so little way left that SUMO should finish the trip, (n,)."""
        return np.array([self._ends_soon(road_user) for road_user in ids], np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of road users that are no longer driven."""
        for road_user in ids:
            self._drives.pop(road_user, None)
        self._strolls.forget(ids)

    def _ends_soon(self, road_user: str) -> bool:
        drive = self._drives.get(road_user)
        if drive is None:
            return self._strolls.left(road_user) < NEAR_END
        if road_user.startswith("learned_"):
            return False
        last = self._graph.lanes[drive.way.lanes[-1]].edge
        ends = last == drive.edges[-1] if drive.edges else last == self._graph.lanes[drive.way.lanes[0]].edge
        return ends and drive.way.end - drive.s < NEAR_END

    def _known(self, state: WorldState, i: int) -> _Drive:
        road_user = state.ids[i]
        drive = self._drives.get(road_user)
        if drive is None or math.hypot(state.x[i] - drive.x, state.y[i] - drive.y) > STRAYED:
            drive = self._drives[road_user] = self._adopt(state, i)
        else:
            self._roll_on(road_user, drive, float(state.length[i]))
        return drive

    def _adopt(self, state: WorldState, i: int) -> _Drive:
        """Find out about a vehicle: its type, and where on its way it is."""
        vehicle, road_user = self._api.vehicle, state.ids[i]
        length, heading = float(state.length[i]), float(state.heading[i])
        front = (
            float(state.x[i]) + 0.5 * length * math.cos(heading),
            float(state.y[i]) + 0.5 * length * math.sin(heading),
        )
        if road_user.startswith("learned_"):
            # What we added has no class and no lane that SUMO could be asked for.
            vehicle_class = "bicycle" if state.type[i] == RoadUserType.BICYCLE else "passenger"
            lane, edges = self._lane_under(front, heading, vehicle_class), ()
        else:
            vehicle_class = vehicle.getVehicleClass(road_user)
            lane = vehicle.getLaneID(road_user) or self._lane_under(front, heading, vehicle_class)
            edges = tuple(vehicle.getRoute(road_user)[vehicle.getRouteIndex(road_user) + 1 :])
        way = self._graph.way(lane, edges, vehicle_class, self._tail(lane, length), _dice(road_user))
        s, beside = way.line.nearest(*front, end=way.ends[0])
        drive = _Drive(
            way=way,
            s=s,
            beside=beside,
            slide=0.0,
            speed=float(state.speed[i]),
            edges=edges,
            vehicle_class=vehicle_class,
            accel=max(vehicle.getAccel(road_user), 0.1),
            decel=max(vehicle.getDecel(road_user), 0.1),
            emergency=max(vehicle.getEmergencyDecel(road_user), vehicle.getDecel(road_user), 0.1),
            top_speed=CYCLING if road_user.startswith("learned_bicycle") else vehicle.getMaxSpeed(road_user),
            factor=vehicle.getSpeedFactor(road_user),
            tau=vehicle.getTau(road_user),
            x=float(state.x[i]),
            y=float(state.y[i]),
        )
        self._learn_top_speed(road_user, drive, lane)
        return drive

    def _learn_top_speed(self, road_user: str, drive: _Drive, lane: str) -> None:
        """What the vehicle itself wants at most (desiredMaxSpeed) can only be seen where its lane allows more."""
        if road_user.startswith("learned_") or self._api.vehicle.getLaneID(road_user) != lane:
            return
        allowed = self._api.vehicle.getAllowedSpeed(road_user)
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

    def _roll_on(self, road_user: str, drive: _Drive, length: float) -> None:
        """On a new edge the way is drawn anew from there: SUMO may have changed the route, and it goes on further."""
        here = drive.way.lane_at(drive.s)
        lane = drive.way.lanes[here]
        if here == 0 or lane.startswith(":"):
            return
        edge = self._graph.lanes[lane].edge
        if not road_user.startswith("learned_"):
            route = tuple(self._api.vehicle.getRoute(road_user))
            begin = max(self._api.vehicle.getRouteIndex(road_user), 0)
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

    def _choose_lane(self, road_user: str, drive: _Drive, world: WorldState, i: int, dt: float) -> None:
        """Begin to change to the lane that the route needs, where there is a gap."""
        lane = drive.way.lanes[0]
        if lane.startswith(":") or drive.way.lane_at(drive.s) > 0 or abs(drive.beside) > 0.8 or not drive.edges:
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

    def _obstacles(
        self, world: WorldState, rows: NDArray[np.intp], drives: list[_Drive], dt: float
    ) -> list[tuple[float, bool]]:
        """For each drive the speed that what lies on its way allows, and whether that is something that stands."""
        if not drives:
            return []
        look = max(d.speed * (dt + 0.5) + d.speed**2 / (2.0 * d.decel) + 8.0 for d in drives)
        ahead = SPACING * np.arange(int(look / SPACING) + 2)
        approach = Approach(
            rows=rows,
            path_x=np.array([np.interp(d.s + ahead, d.way.line.s, d.way.line.x) for d in drives]),
            path_y=np.array([np.interp(d.s + ahead, d.way.line.s, d.way.line.y) for d in drives]),
            room=np.array([d.way.line.end - d.s for d in drives]),
            speed=np.array([d.speed for d in drives]),
            limits=np.array([[d.accel, d.decel, d.emergency] for d in drives]),
            heedless=np.array([world.time < d.free_until for d in drives]),
        )
        safe, standing = slowed(approach, world, dt)
        return list(zip(safe.tolist(), standing.tolist(), strict=True))

    def _advance(
        self, state: WorldState, i: int, drive: _Drive, safe: float, standing: bool, dt: float
    ) -> tuple[float, float, float]:
        """Drive on for `dt` s; the new centre and heading."""
        road_user, length = state.ids[i], float(state.length[i])
        calm = self._calm_speed(drive, dt)
        hard = min(safe, self._leader_speed(road_user, drive, dt))
        low = drive.speed - drive.decel * dt
        speed = min(drive.speed + drive.accel * dt, max(calm, low))
        speed = max(min(speed, max(hard, drive.speed - drive.emergency * dt)), 0.0)
        drive.stood = drive.stood + dt if speed < 0.1 else 0.0
        if standing and safe < 0.5 and drive.stood > IMPATIENCE + 4.0 * random.Random(road_user).random():
            drive.free_until, drive.stood = state.time + 5.0, 0.0
        drive.speed = speed = min(speed, max(drive.way.end - drive.s, 0.0) / dt)
        drive.s += speed * dt
        self._blend(drive, dt)
        line = drive.way.line
        front_x, front_y, direction = line.at(drive.s)
        rear_x, rear_y, _ = line.at(drive.s - length)
        front_x, front_y = (
            front_x - drive.beside * math.sin(direction),
            front_y + drive.beside * math.cos(direction),
        )
        heading = math.atan2(line.at(drive.s)[1] - rear_y, line.at(drive.s)[0] - rear_x)
        heading += math.atan2(drive.slide, max(speed, 0.5))
        drive.x, drive.y = front_x - 0.5 * length * math.cos(heading), front_y - 0.5 * length * math.sin(heading)
        return drive.x, drive.y, heading

    def _blend(self, drive: _Drive, dt: float) -> None:
        """Move towards the middle of the lane, slowly enough not to slide."""
        most = min(SIDEWAYS, SLANT * drive.speed, math.sqrt(2.0 * SIDEWAYS_ACCELERATION * abs(drive.beside)))
        most = min(most, abs(drive.beside) / dt, abs(drive.slide) + 2.0 * SIDEWAYS_ACCELERATION * dt)
        drive.slide = -math.copysign(most, drive.beside)
        drive.beside += drive.slide * dt

    def _calm_speed(self, drive: _Drive, dt: float) -> float:
        """The speed (m/s) that limits, signals, priority and the end of the lane allow."""
        way, decel = drive.way, drive.decel
        here = way.lane_at(drive.s)
        speed = min(way.limits[here] * drive.factor, drive.top_speed)
        look = drive.speed * dt + drive.speed**2 / (2.0 * decel) + 10.0
        for k in range(here + 1, len(way.lanes)):
            distance = way.ends[k - 1] - drive.s
            if distance > look:
                break
            limit = min(way.limits[k] * drive.factor, drive.top_speed)
            speed = min(speed, _slowing(limit, distance, decel, dt))
        for gate in way.gates:
            distance = gate.line - drive.s
            if -0.5 < distance < look + 5.0:
                limits = (drive.accel, decel)
                allowed = self._right.speed(gate, distance, drive.speed, limits, drive.stood)
                speed = min(speed, _discrete(allowed, decel, dt))
        if way.lanes[here].startswith(":") or not drive.edges or self._reaches_on(drive):
            return speed
        # The lane does not lead on: wait at its end for a gap in the next one.
        return min(speed, _slowing(0.0, way.end - drive.s - LANE_END, decel, dt))

    def _reaches_on(self, drive: _Drive) -> bool:
        """Whether the way goes on as far as the route does, or further than anybody looks."""
        last = self._graph.lanes[drive.way.lanes[-1]]
        return drive.way.end - drive.s > 120.0 or last.edge == drive.edges[-1]

    def _leader_speed(self, road_user: str, drive: _Drive, dt: float) -> float:
        """Krauss' safe speed behind SUMO's leader (https://sumo.dlr.de/docs/Car-Following-Models.html)."""
        if road_user.startswith("learned_"):
            return math.inf
        leader = self._api.vehicle.getLeader(road_user, 50.0)
        if not leader or not leader[0]:
            return math.inf
        other = self._drives.get(leader[0])
        pace = other.speed if other is not None else max(self._api.vehicle.getSpeed(leader[0]), 0.0)
        gap = max(float(leader[1]), 0.0)
        delay = drive.decel * max(drive.tau, dt)
        safe = math.sqrt(delay * delay + pace * pace + 2.0 * drive.decel * gap) - delay
        return min(safe, self._keeps_clear(drive, gap, pace, dt))

    def _keeps_clear(self, drive: _Drive, gap: float, pace: float, dt: float) -> float:
        """Do not stop inside a junction: wait before it while its exit is taken."""
        for gate in drive.way.gates[:1]:
            distance = gate.line - drive.s
            if distance > 0.0 and pace < 1.0 and -2.0 < gap - (gate.out - drive.s) < 5.0:
                return _slowing(0.0, distance - STOP_LINE, drive.decel, dt)
        return math.inf


def _dice(road_user: str) -> str:
    return road_user if road_user.startswith("learned_") else ""


def _slowing(target: float, distance: float, decel: float, dt: float) -> float:
    """The speed (m/s) from which `target` is reached after `distance` (m), after one more interval at that speed."""
    delay = decel * dt
    root = delay * delay + target * target + 2.0 * decel * max(distance, 0.0)
    return max(math.sqrt(root) - delay, target)


def _discrete(speed: float, decel: float, dt: float) -> float:
    """A speed that could be kept up in continuous time, for one that is held over the next interval."""
    if not math.isfinite(speed):
        return speed
    return math.sqrt(decel * decel * dt * dt + speed * speed) - decel * dt


def _gap(world: WorldState, i: int, drive: _Drive, beside: float, hurried: bool) -> bool:
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
