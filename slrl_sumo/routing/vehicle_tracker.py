"""Tracks of vehicles: their paths along lanes and routes."""

import math
from dataclasses import replace

import numpy as np

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import LanePath
from slrl_sumo.routing.short_lanes import is_short
from slrl_sumo.routing.vehicle_track import JunctionBehind, VehicleHistory, VehicleTrack
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.route import AHEAD, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, SPAWNED_PREFIX, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.arrivals import Arrivals
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, LanePoints
from slrl_sumo.sumo.road_users import allowed_speed, route_id, vehicle_lane, vehicle_parameters, vehicle_route

DISPLACED = 0.5
"""Distance (m) from the planned position beyond which SUMO or a user's script has moved the vehicle: a new path is
needed."""
OFF_PATH = 6.0
"""Distance (m) beside its path beyond which an observed vehicle is on another path."""
LEAST_ACCELERATION = 0.1
"""Least acceleration and deceleration (m/s²) of a track: vehicle types may have 0."""
CYCLING_SPEED = 5.6
"""Speed (m/s) of spawned bicycles: their type has no speed of its own."""


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
        """Whether SUMO places a vehicle of the scenario on no lane, because it is too far from the lanes of its
        route."""
        return vehicle_lane(self._api, road_user) == ""

    def remaining_distance(self, road_user: str) -> float:
        """Distance (m) to the end of a vehicle's trip; inf if the path ends earlier, and without a route or track."""
        if road_user.startswith(SPAWNED_PREFIX) or (track := self._vehicles.get(road_user)) is None:
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
        """The track of the vehicle in row `i` of `state`, which a driver moves along the path."""
        road_user = state.ids[i]
        track = self._vehicles.get(road_user)
        if track is None or math.hypot(state.x[i] - track.x, state.y[i] - track.y) > DISPLACED:
            track = self._vehicles[road_user] = self._begin(state, i)
        else:
            self._renew_path(road_user, track, float(state.length[i]))
        return track

    def observed(self, state: WorldState, i: int) -> VehicleTrack:
        """The track of the vehicle in row `i` of `state`, which moves freely.

        The track's `s` refers to the front of the vehicle, `lateral_offset` to its centre.
        """
        road_user, half = state.ids[i], 0.5 * state.length.item(i)
        x, y, speed = state.x.item(i), state.y.item(i), state.speed.item(i)
        track = known = self._vehicles.get(road_user)
        if track is not None:
            begin = track.s - half - 2.0
            end = begin + 6.0 + 1.5 * speed * DECISION_INTERVAL
            place, track.lateral_offset, distance = track.path.line.place(x, y, begin, end)
            if distance < OFF_PATH:
                track.s = max(place + half, 0.0)
                self._renew_path(road_user, track, 2.0 * half)
            else:
                track = None
        if track is None:
            track = self._vehicles[road_user] = self._begin(state, i, None if known is None else known.history)
            place, track.lateral_offset = track.path.line.nearest(x, y, track.s - 2.0 * half - 2.0, track.s + half)
            track.s = max(place + half, 0.0)
        track.x, track.y, track.speed = x, y, speed
        if track.behind is not None and track.s - 2.0 * half > track.behind.exit:
            track.behind = None
        track.history.observe(state.time, speed)
        track.observe_lines()
        return track

    def _begin(self, state: WorldState, i: int, history: VehicleHistory | None = None) -> VehicleTrack:
        """A new track with the vehicle's parameters and its position on its path; `history`: of its previous track."""
        road_user, edges = state.ids[i], tuple[str, ...]()
        parameters = vehicle_parameters(self._api, road_user)
        max_speed = parameters.max_speed
        length, heading = float(state.length[i]), float(state.heading[i])
        front = (
            float(state.x[i]) + 0.5 * length * math.cos(heading),
            float(state.y[i]) + 0.5 * length * math.sin(heading),
        )
        if road_user.startswith(SPAWNED_PREFIX):
            # SUMO knows neither class nor lane of spawned vehicles.
            cycles = state.type[i] == RoadUserType.BICYCLE
            vehicle_class = "bicycle" if cycles else "passenger"
            max_speed = CYCLING_SPEED if cycles else max_speed
            lane = self._lane_under(front, heading, vehicle_class)
        else:
            vehicle_class = parameters.vehicle_class
            route, index = vehicle_route(self._api, road_user)
            index = max(index, 0)
            near = route[max(index - 1, 0) : index + 2]
            lane = vehicle_lane(self._api, road_user) or self._lane_under(front, heading, vehicle_class, near)
            edges = self._edges_after(lane, route, index)
        path, here = self._path_on(lane, edges, vehicle_class, length, seed_of(road_user))
        begin = path.ends[here - 1] if here else -math.inf
        s, lateral_offset = path.line.nearest(*front, begin, path.ends[here])
        track = VehicleTrack(
            path=path,
            s=s,
            lateral_offset=lateral_offset,
            speed=float(state.speed[i]),
            x=float(state.x[i]),
            y=float(state.y[i]),
            edges=edges,
            parameters=replace(
                parameters,
                vehicle_class=vehicle_class,
                accel=max(parameters.accel, LEAST_ACCELERATION),
                decel=max(parameters.decel, LEAST_ACCELERATION),
                emergency_decel=max(parameters.emergency_decel, parameters.decel, LEAST_ACCELERATION),
                max_speed=max_speed,
            ),
            history=history or VehicleHistory(begun=state.time),
            arrival=None if road_user.startswith(SPAWNED_PREFIX) else self._arrivals.of(road_user),
            route_id=self._route_id(road_user),
            version=self._graph.version,
        )
        self._update_max_speed(road_user, track, lane)
        return track

    def _edges_after(self, lane: str, route: tuple[str, ...], index: int) -> tuple[str, ...]:
        """The edges of a `route` that follow a lane's edge, or the edge before the junction of an internal lane.

        `index`: SUMO's position on the route. A vehicle that SUMO has on no lane may be one edge behind or ahead of it.
        """
        edge = self._graph.lanes[self._graph.origin(lane)].edge
        places = [k for k in (index, index - 1, index + 1) if 0 <= k < len(route) and route[k] == edge]
        return route[(places or [index])[0] + 1 :]

    def _path_on(
        self, lane: str, edges: tuple[str, ...], vehicle_class: str, length: float, seed: str
    ) -> tuple[LanePath, int]:
        """The path along `edges` of a vehicle on a lane, and the index of the lane on the path.

        Inside a junction the path begins on the lane before the junction, so that the vehicle counts as having entered.
        """
        for first in dict.fromkeys((self._graph.origin(lane), lane)):
            path = self._graph.path(first, edges, vehicle_class, point_before(self._graph, first, length), seed)
            lanes = [self._graph.in_network(one) for one in path.lanes]
            if lane in lanes:
                break
        return path, lanes.index(lane)

    def _update_max_speed(self, road_user: str, track: VehicleTrack, lane: str) -> None:
        """Lower the maximum speed of a track to the vehicle's desiredMaxSpeed, which shows only on faster lanes."""
        if road_user.startswith(SPAWNED_PREFIX) or vehicle_lane(self._api, road_user) != lane:
            return
        allowed, own = allowed_speed(self._api, road_user), track.parameters
        if allowed < self._graph.limit(lane) * own.speed_factor - 0.01:
            track.parameters = replace(own, max_speed=min(own.max_speed, allowed))

    def _lane_under(
        self, front: tuple[float, float], heading: float, vehicle_class: str, route: tuple[str, ...] = ()
    ) -> str:
        """The nearest lane in the vehicle's direction of travel, of the edges of its `route` if one is near.

        Without a lane in this direction, the nearest lane.
        """
        near = self._carriageway.nearest(np.array([front[0]]), np.array([front[1]]), 24)[0]
        lanes = [self._carriageway.lanes[k].id for k in self._carriageway.lane[near]]
        angles = np.abs(wrap_angle(self._carriageway.heading[near] - heading))
        fitting = [
            lane
            for lane, angle in zip(lanes, angles, strict=True)
            if angle < 1.0 and self._graph.lanes[lane].admits(vehicle_class)
        ]
        nearest: str = (fitting or lanes)[0]
        return next((lane for lane in fitting if self._is_on(lane, route)), nearest)

    def _is_on(self, lane: str, route: tuple[str, ...]) -> bool:
        """Whether a lane is of an edge of a route, or leads through a junction from one such edge to another."""
        graph = self._graph
        return graph.lanes[graph.origin(lane)].edge in route and (
            not graph.lanes[lane].internal or any(graph.lanes[after].edge in route for after, _ in graph.links(lane))
        )

    def _renew_path(self, road_user: str, track: VehicleTrack, length: float) -> None:
        """Find a new path from the present lane on, if it is on a new edge, or if the route or the permissions changed.

        From a new edge the path reaches farther. SUMO or a script may have changed the route; lanes may be closed.
        """
        here = track.path.lane_at(track.s)
        lane = track.path.lanes[here]
        if lane[0] == ":":
            return
        self._look_ahead(track, here)
        route, version = self._route_id(road_user), self._graph.version
        unchanged = track.version == version and track.route_id == route
        # Over a short lane the path may be a curve, which a path from that lane on would not continue.
        if unchanged and (here == 0 or is_short(self._graph.lanes[lane])):
            return
        track.route_id, track.version = route, version
        edge = self._graph.lanes[lane].edge
        if not road_user.startswith(SPAWNED_PREFIX):
            edges, index = vehicle_route(self._api, road_user)
            begin = max(index, 0)
            if edge in edges[begin:]:
                track.edges = edges[edges.index(edge, begin) + 1 :]
            elif edge in track.edges:
                track.edges = track.edges[track.edges.index(edge) + 1 :]
        if here == 0:
            before = point_before(self._graph, lane, length)
        else:
            start = track.path.ends[here - 1]
            before = track.path.line.between(min(track.s, start) - length - 2.0, start)
        path = self._graph.path(lane, track.edges, track.parameters.vehicle_class, before, seed_of(road_user))
        (x, y, _), s = track.path.line.at(track.s), track.s
        track.s, _ = path.line.nearest(x, y, end=path.ends[0])
        if here > 0:
            track.behind = _junction_behind(track.path, here, track.s - s)
        track.path = path
        self._update_max_speed(road_user, track, lane)

    def _route_id(self, road_user: str) -> str:
        return "" if road_user.startswith(SPAWNED_PREFIX) else route_id(self._api, road_user)

    def _look_ahead(self, track: VehicleTrack, here: int) -> None:
        """Read the permissions of the edges within sight, from the lane with index `here` on: lanes may be closed or
        opened. In one round of readings, an edge is read once."""
        path, graph, seen = track.path, self._graph, track.s + AHEAD * spacing_at(track.speed)
        if seen < track.seen_until and track.seen_path is path and track.seen_in == graph.round:
            return
        track.seen_path, track.seen_in = path, graph.round
        begins, lanes = path.begins, path.lanes
        for k in range(here, len(lanes)):
            if begins[k] > seen:
                track.seen_until = begins[k]
                return
            if lanes[k][0] != ":":
                graph.look_at(graph.lanes[lanes[k]].edge)
        track.seen_until = math.inf
        if path.end > seen:
            track.seen_until = path.end
            return
        # Also read the edges after the end of the path: the path may end before a closed edge.
        last = graph.lanes[path.lanes[-1]]
        after = track.edges[track.edges.index(last.edge) + 1 :] if last.edge in track.edges else track.edges
        for edge in after[:1] or [graph.lanes[target].edge for target, _ in graph.links(last.id)]:
            graph.look_at(edge)


def _junction_behind(path: LanePath, here: int, shift: float) -> JunctionBehind | None:
    """The junction before the lane with the index `here` of a path, with positions moved by `shift` (m)."""
    first = here
    while first > 0 and path.lanes[first - 1].startswith(":"):
        first -= 1
    if first == here:
        return None
    begins = tuple([begin + shift for begin in path.begins[first:here]])
    return JunctionBehind(path.lanes[first:here], begins, path.ends[here - 1] + shift)


def seed_of(road_user: str) -> str:
    return road_user if road_user.startswith(SPAWNED_PREFIX) else ""


def point_before(graph: LaneGraph, lane: str, length: float) -> list[tuple[float, float]]:
    """A point straight before the begin of a lane, `length` + 2 m away, for the rear of a vehicle that just entered."""
    (x0, y0), (x1, y1) = graph.lanes[lane].points[:2]
    step = max(math.hypot(x1 - x0, y1 - y0), 1e-6)
    return [(x0 - (x1 - x0) / step * (length + 2.0), y0 - (y1 - y0) / step * (length + 2.0))]
