"""Tracks of vehicles: their paths along lanes and routes, and the lanes that they choose."""

import math

import numpy as np

from slrl_sumo.routing.lane_changes import (
    CHANGES_WITHIN,
    PAUSE,
    QUEUED,
    SETTLES,
    SIGHT,
    Wish,
    faster_there,
    has_gap,
    is_far,
    is_soon,
    shorter_queue,
)
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import LanePath
from slrl_sumo.routing.vehicle_track import HALTS_BEFORE, STOPS_OVER, VehicleTrack
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.route import AHEAD, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import SPAWNED_PREFIX, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.arrivals import Arrivals
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, LanePoints, lane_index
from slrl_sumo.sumo.road_users import allowed_speed, route_id, vehicle_lane, vehicle_parameters, vehicle_route

DISPLACED = 0.5
"""m from the planned position: the vehicle was moved by SUMO or a user's script, and its path is found anew."""
OFF_PATH = 6.0
"""m beside its path beyond which an observed vehicle is on another one."""
CHANGING, MOST_ASIDE = 0.8, 8.0
"""m beside its path beyond which a vehicle is changing lanes, and up to which the next lane may be away."""
CYCLING_SPEED = 5.6
"""m/s of spawned bicycles: their type has no speed of its own."""


class VehicleTracker:
    """The tracks of the learned vehicles of a simulation, by id."""

    def __init__(self, api: SumoApi, network: Network, graph: LaneGraph) -> None:
        self._api, self._graph, self._levels = api, graph, network.levels
        self._arrivals = Arrivals(api)
        self._vehicles: dict[str, VehicleTrack] = {}
        self._carriageway = LanePoints(
            [lane for lane in network.lanes if lane.allowed & (MOTOR_CLASSES | {"bicycle"})], spacing=2.0
        )

    def get(self, road_user: str) -> VehicleTrack | None:
        """The track of a vehicle, if there is one."""
        return self._vehicles.get(road_user)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the tracks of vehicles."""
        for road_user in ids:
            self._vehicles.pop(road_user, None)

    def on_no_lane(self, road_user: str) -> bool:
        """Whether SUMO has a vehicle of the scenario on no lane: too far beside those of its route."""
        return not road_user.startswith(SPAWNED_PREFIX) and vehicle_lane(self._api, road_user) == ""

    def remaining_distance(self, road_user: str) -> float:
        """m to where a vehicle's trip ends; inf where the path ends before, and without a route or track.

        Also inf while the vehicle is obstructed: SUMO would brake harder for the obstacle, or not at all.
        """
        track = self._vehicles.get(road_user)
        if track is None or track.obstructed or road_user.startswith(SPAWNED_PREFIX):
            return math.inf
        path, lanes = track.path, self._graph.lanes
        last = lanes[path.lanes[-1]].edge
        ends = last == (track.edges[-1] if track.edges else lanes[path.lanes[0]].edge)
        if not ends:
            return math.inf
        arrival, length = track.arrival, lanes[path.lanes[-1]].length
        before = 0.0 if arrival is None else -arrival if arrival < 0.0 else length - arrival
        return path.end - min(max(before, 0.0), length) - track.s

    def planned(self, state: WorldState, i: int) -> VehicleTrack:
        """The track of the vehicle in row `i` of `state`, which its driver moves along the path."""
        road_user = state.ids[i]
        track = self._vehicles.get(road_user)
        if track is None or math.hypot(state.x[i] - track.x, state.y[i] - track.y) > DISPLACED:
            track = self._vehicles[road_user] = self._begin(state, i)
        else:
            self._renew_path(road_user, track, float(state.length[i]))
        return track

    def observed(self, state: WorldState, i: int, dt: float) -> VehicleTrack:
        """The track of the vehicle in row `i` of `state`, which moves freely, `dt` s after its last update.

        `s` is that of its front, `lateral_offset` that of its centre.
        """
        road_user, half = state.ids[i], 0.5 * state.length.item(i)
        x, y, speed = state.x.item(i), state.y.item(i), state.speed.item(i)
        track = self._vehicles.get(road_user)
        if track is not None:
            begin = track.s - half - 2.0
            place, track.lateral_offset, distance = track.path.line.place(x, y, begin, begin + 6.0 + 1.5 * speed * dt)
            if distance < OFF_PATH:
                track.s = max(place + half, 0.0)
                self._renew_path(road_user, track, 2.0 * half)
            else:
                track = None
        if track is None:
            before = self._vehicles.get(road_user)
            track = self._vehicles[road_user] = self._begin(state, i)
            if before is not None:
                track.begun = before.begun
                track.standing_time, track.idle_time = before.standing_time, before.idle_time
                track.free_since = before.free_since
                track.entry, track.entered, track.halted = before.entry, before.entered, before.halted
            place, track.lateral_offset = track.path.line.nearest(x, y, track.s - 2.0 * half - 2.0, track.s + half)
            track.s = max(place + half, 0.0)
        track.x, track.y, track.speed, track.lateral_speed = x, y, speed, 0.0
        track.standing_time = track.standing_time + dt if speed < 0.1 else 0.0
        if track.standing_time > 0.0:
            near = (e.via for e in track.path.entries if -STOPS_OVER < e.stop_line - track.s < HALTS_BEFORE)
            track.halted = next(near, track.halted)
        return track

    def _begin(self, state: WorldState, i: int) -> VehicleTrack:
        """A new track: the vehicle's parameters, and its place on its path."""
        road_user, edges = state.ids[i], tuple[str, ...]()
        parameters = vehicle_parameters(self._api, road_user)
        max_speed = parameters.max_speed
        length, heading = float(state.length[i]), float(state.heading[i])
        front = (
            float(state.x[i]) + 0.5 * length * math.cos(heading),
            float(state.y[i]) + 0.5 * length * math.sin(heading),
        )
        if road_user.startswith(SPAWNED_PREFIX):
            # Of spawned vehicles, SUMO knows neither class nor lane.
            cycles = state.type[i] == RoadUserType.BICYCLE
            vehicle_class = "bicycle" if cycles else "passenger"
            max_speed = CYCLING_SPEED if cycles else max_speed
            lane = self._lane_under(front, heading, vehicle_class)
        else:
            vehicle_class = parameters.vehicle_class
            lane = vehicle_lane(self._api, road_user) or self._lane_under(front, heading, vehicle_class)
            route, index = vehicle_route(self._api, road_user)
            edges = route[index + 1 :]
        path, here = self._path_on(lane, edges, vehicle_class, length, _seed(road_user))
        begin = path.ends[here - 1] if here else -math.inf
        s, lateral_offset = path.line.nearest(*front, begin, path.ends[here])
        track = VehicleTrack(
            path=path,
            s=s,
            lateral_offset=lateral_offset,
            lateral_speed=0.0,
            speed=float(state.speed[i]),
            edges=edges,
            vehicle_class=vehicle_class,
            accel=max(parameters.accel, 0.1),
            decel=max(parameters.decel, 0.1),
            emergency=max(parameters.emergency_decel, parameters.decel, 0.1),
            max_speed=max_speed,
            speed_factor=parameters.speed_factor,
            tau=parameters.tau,
            x=float(state.x[i]),
            y=float(state.y[i]),
            route_id=self._route_id(road_user),
            arrival=None if road_user.startswith(SPAWNED_PREFIX) else self._arrivals.of(road_user),
            version=self._graph.version,
            begun=state.time,
        )
        self._update_max_speed(road_user, track, lane)
        return track

    def _path_on(
        self, lane: str, edges: tuple[str, ...], vehicle_class: str, length: float, seed: str
    ) -> tuple[LanePath, int]:
        """The path along `edges` of a vehicle on a lane, and the lane's index on it: inside a junction it begins before
        that, so that the vehicle has entered it."""
        for first in dict.fromkeys((self._graph.origin(lane), lane)):
            path = self._graph.path(first, edges, vehicle_class, self._point_before(first, length), seed)
            if lane in path.lanes:
                break
        return path, path.lanes.index(lane)

    def _update_max_speed(self, road_user: str, track: VehicleTrack, lane: str) -> None:
        """The vehicle's desiredMaxSpeed shows only where its lane allows more."""
        if road_user.startswith(SPAWNED_PREFIX) or vehicle_lane(self._api, road_user) != lane:
            return
        allowed = allowed_speed(self._api, road_user)
        if allowed < self._graph.limit(lane) * track.speed_factor - 0.01:
            track.max_speed = min(track.max_speed, allowed)

    def _lane_under(self, front: tuple[float, float], heading: float, vehicle_class: str) -> str:
        """The lane near a position that has the vehicle's direction, else the nearest lane."""
        near = self._carriageway.nearest(np.array([front[0]]), np.array([front[1]]), 24)[0]
        lanes = [self._carriageway.lanes[k].id for k in self._carriageway.lane[near]]
        angles = np.abs(wrap_angle(self._carriageway.heading[near] - heading))
        fitting = [
            lane
            for lane, angle in zip(lanes, angles, strict=True)
            if angle < 1.0 and self._graph.lanes[lane].admits(vehicle_class)
        ]
        chosen: str = (fitting or lanes)[0]
        return chosen

    def _point_before(self, lane: str, length: float) -> list[tuple[float, float]]:
        """A point straight before the begin of a lane, for the rear of a vehicle that has just entered it."""
        (x0, y0), (x1, y1) = self._graph.lanes[lane].points[:2]
        step = max(math.hypot(x1 - x0, y1 - y0), 1e-6)
        return [(x0 - (x1 - x0) / step * (length + 2.0), y0 - (y1 - y0) / step * (length + 2.0))]

    def _renew_path(self, road_user: str, track: VehicleTrack, length: float) -> None:
        """Begin the path on the present lane: on a new edge, from where it reaches further, and where SUMO, a script or
        a closed lane has changed the way."""
        here = track.path.lane_at(track.s)
        lane = track.path.lanes[here]
        if lane.startswith(":"):
            return
        self._look_ahead(track, here)
        found_with = self._route_id(road_user), self._graph.version
        if here == 0 and (track.route_id, track.version) == found_with:
            return
        track.route_id, track.version = found_with
        edge = self._graph.lanes[lane].edge
        if not road_user.startswith(SPAWNED_PREFIX):
            route, index = vehicle_route(self._api, road_user)
            begin = max(index, 0)
            if edge in route[begin:]:
                track.edges = route[route.index(edge, begin) + 1 :]
            elif edge in track.edges:
                track.edges = track.edges[track.edges.index(edge) + 1 :]
        if here == 0:
            before = self._point_before(lane, length)
        else:
            start = track.path.ends[here - 1]
            before = track.path.line.between(min(track.s, start) - length - 2.0, start)
        path = self._graph.path(lane, track.edges, track.vehicle_class, before, _seed(road_user))
        x, y, _ = track.path.line.at(track.s)
        track.s, _ = path.line.nearest(x, y, end=path.ends[0])
        track.path = path
        self._update_max_speed(road_user, track, lane)

    def _route_id(self, road_user: str) -> str:
        return "" if road_user.startswith(SPAWNED_PREFIX) else route_id(self._api, road_user)

    def _look_ahead(self, track: VehicleTrack, here: int) -> None:
        """Look at the edges within sight, from the lane of that index on: whether their lanes are still, or again, open
        to the vehicle."""
        path, graph, seen = track.path, self._graph, track.s + AHEAD * spacing_at(track.speed)
        for begin, lane in zip(path.begins[here:], path.lanes[here:], strict=True):
            if begin > seen:
                return
            if not lane.startswith(":"):
                graph.look_at(graph.lanes[lane].edge)
        if path.end > seen:
            return
        # Beyond its end, which may be before a closed edge.
        last = graph.lanes[path.lanes[-1]]
        after = track.edges[track.edges.index(last.edge) + 1 :] if last.edge in track.edges else track.edges
        for edge in after[:1] or [graph.lanes[target].edge for target, _ in graph.links(last.id)]:
            graph.look_at(edge)

    def choose_lane(self, road_user: str, track: VehicleTrack, world: WorldState, i: int) -> Wish | None:
        """Begin the lane change that the route needs, where there is a gap. Returns a change that is under way, or for
        which there is no gap."""
        path = track.path
        if not (track.edges or path.route) or path.lanes[0].startswith(":") or path.lane_at(track.s) > 0:
            return None
        if abs(track.lateral_offset) > CHANGING:
            return Wish(i, track.lateral_offset, path.line.at(track.s)[2], 0.0)
        # SUMO inserts vehicles beside one that is on its way to their lane, because it is not on it yet.
        settles = world.time < track.begun + SETTLES
        left = path.ends[0] - track.s
        if path.next_lane is not None and not is_far(left, track.speed):
            if settles and not is_soon(left, track.speed):
                return None
            return self._change(road_user, track, world, i, path.next_lane, left, always=True)
        return self._overtake(road_user, track, world, i, left) if path.route and not settles else None

    def _overtake(self, road_user: str, track: VehicleTrack, world: WorldState, i: int, left: float) -> Wish | None:
        """Change to a lane that serves the route as well, where the vehicle gets on better there."""
        if track.speed < QUEUED or world.time < track.changed + PAUSE:
            return None
        lane, vehicle_class = track.path.lanes[0], track.vehicle_class
        if is_far(left, track.speed):
            lanes = self._graph.neighbours(lane, vehicle_class)
        else:
            lanes = self._graph.equal_lanes(lane, vehicle_class, track.path.route)
        for target in lanes:
            wish = self._change(road_user, track, world, i, target, math.inf, always=False)
            if wish is not None:
                return wish
        return None

    def _change(
        self, road_user: str, track: VehicleTrack, world: WorldState, i: int, target: str, left: float, *, always: bool
    ) -> Wish | None:
        """Begin to change to the lane `target` where there is a gap; unless `always`, only where it is faster."""
        length = float(world.length[i])
        before = self._point_before(target, length)
        path = self._graph.path(target, track.edges, track.vehicle_class, before, _seed(road_user))
        x, y, direction = track.path.line.at(track.s)
        x, y = x - track.lateral_offset * math.sin(direction), y + track.lateral_offset * math.cos(direction)
        s, lateral_offset = path.line.nearest(x, y, end=path.ends[0])
        if abs(lateral_offset) > MOST_ASIDE:
            return None
        wish = Wish(i, lateral_offset, path.line.at(s)[2], left)
        if not always and not self._gets_on_better(track, world, wish, target):
            return None
        if has_gap(world, wish, self._entering(target, track, world), self._levels):
            track.path, track.s, track.lateral_offset, track.changed = path, s, lateral_offset, world.time
        return wish

    def _gets_on_better(self, track: VehicleTrack, world: WorldState, wish: Wish, target: str) -> bool:
        """Whether a vehicle gets on better in the next lane, `target`: by the queue, or by the speed there."""
        left = track.path.ends[0] - track.s
        if shorter_queue(world, wish, left, self._levels):
            return True
        if left < min(CHANGES_WITHIN[0] * track.speed, CHANGES_WITHIN[1]):
            return False
        lane = track.path.lanes[0]
        desired = min(self._graph.limit(lane) * track.speed_factor, track.max_speed)
        return faster_there(world, wish, desired, self._levels, back=lane_index(target) < lane_index(lane))

    def _entering(self, lane: str, track: VehicleTrack, world: WorldState) -> list[int]:
        """Rows of the other vehicles near a track that are changing to a lane, or come to it out of a junction."""
        near = np.flatnonzero(np.hypot(world.x - track.x, world.y - track.y) < SIGHT)
        others = [(row, self._vehicles.get(world.ids[row])) for row in near.tolist()]
        return [row for row, other in others if other is not None and other is not track and _enters(other, lane)]


def _enters(track: VehicleTrack, lane: str) -> bool:
    """Whether a vehicle is changing to a lane, or is in the junction from which its path leads there."""
    lanes, here = track.path.lanes, track.path.lane_at(track.s)
    if not lanes[here].startswith(":"):
        return lanes[0] == lane and abs(track.lateral_offset) > CHANGING
    return next((name for name in lanes[here:] if not name.startswith(":")), None) == lane


def _seed(road_user: str) -> str:
    return road_user if road_user.startswith(SPAWNED_PREFIX) else ""
