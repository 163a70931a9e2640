"""Routes ahead of road users: path, stop lines, signals, limits, destination.

The routes of vehicles and the walks of persons are SUMO's. Spawned road users have none: at junctions they continue at
random, in every run in the same way.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.junctions.lines_inside import stops_inside
from slrl_sumo.routing.junctions.occupants import Size, braking_distance, size_of
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_changes import LaneChange, cooperative_speeds
from slrl_sumo.routing.lane_choice import CHANGING, LaneChoice
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry, junction_of
from slrl_sumo.routing.lateral_positions import SharedPath, lateral_room, pass_persons
from slrl_sumo.routing.speed_limits import REACTION_TIME, SpeedLimits, looking_speed
from slrl_sumo.routing.vehicle_track import HALTS_BEFORE, VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.routing.walking.pedestrian_tracker import PedestrianTracker
from slrl_sumo.routing.walking.waiting_persons import WaitingPersons
from slrl_sumo.scene.route import BEHIND, SPACING, RouteAhead, SignalAspect, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN, SPAWNED_PREFIX, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals

NEAR_END = 15.0
"""Distance (m) before the destination at which SUMO should finish a trip."""
ALIGNED = 0.2
"""Angle (rad) between a vehicle and the lane at its destination below which SUMO may finish its trip."""
STUCK, ACROSS = 10.0, 0.6
"""Time (s) at a stand without a red signal, and angle (rad) to its path, beyond which a vehicle is off its route."""
DECEL_SHARE = 0.5
"""Share of a vehicle's deceleration with which it slows down for limits and junctions."""
FAR_BESIDE = 3.0
"""Distance (m) beside its path from which a vehicle on no lane of SUMO is off its route: a vehicle that had stopped 5 m
beside its path, after two sharp turns in a row, did not move again."""
# Python 3.11 takes 0.3 us to look up a member of an enumeration, for each road user.
BICYCLE = RoadUserType.BICYCLE
KEEPS_CLEAR_FOR = 300.0
"""Time (s) at a stand since its signal was green for it, after which a vehicle enters a junction that it may have to
stand in (as SUMO's jmIgnoreKeepClearTime; plain SUMO teleports it then). Before signals 6 m apart that are never green
at once, vehicles stood for ever. With 120 s, jams grew: 210 and 218 instead of 213 and 230 vehicles arrived in a part
of Helsinki."""
GREEN, YELLOW, RED = SignalAspect.GREEN, SignalAspect.YELLOW, SignalAspect.RED


class Routes:
    """Tracks road users on their routes.

    `refusals`: road users for which SUMO refused a call; their routes are unknown.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self._graph, self._levels = LaneGraph(api, network), network.levels
        self._vehicles = VehicleTracker(api, network, self._graph)
        self._right_of_way = RightOfWay(api, self._graph)
        self._speed_limits = SpeedLimits(self._graph, self._right_of_way)
        self._reservations = JunctionReservations(api, self._graph, self._vehicles.get, self._right_of_way)
        self._lane_choice = LaneChoice(self._graph, self._vehicles, network.levels, self._passes_junctions)
        self._pedestrians = PedestrianTracker(api, network)
        self._waiting = WaitingPersons(api, network)
        self._off_route: set[str] = set()
        self._near_end: set[str] = set()

    def ahead(self, world: WorldState, n: int) -> RouteAhead:
        """The present routes of the first `n` road users of `world`.

        Call it at each decision. A second call at the same time, such as after a road user was moved, is allowed:
        standing times count once.
        """
        self._graph.renew()
        self._right_of_way.renew()
        self._pedestrians.renew()
        self._reservations.renew(world)
        self._near_end.clear()
        route = RouteAhead.unknown(n)
        lane_changes: list[LaneChange] = []
        shared_paths: list[SharedPath] = []
        for i, kind in enumerate(world.type[:n].tolist()):
            try:
                if kind == PEDESTRIAN:
                    self._add_pedestrian(route, world, i)
                else:
                    track = self._add_vehicle(route, world, i, lane_changes)
                    if kind == BICYCLE:
                        shared_paths += self._shared_path(track, world, i)
            except Exception as error:
                self.refusals.catch(world.ids[i], error)
        pass_persons(route, world, shared_paths)
        route.desired_speed[:] = np.minimum(
            route.desired_speed, cooperative_speeds(world, n, lane_changes, self._levels)
        )
        return route

    def at_kerb(self, world: WorldState, n: int) -> WorldState:
        """`world` as vehicles expect it: with SUMO's waiting persons moved to the kerb.

        The first `n` road users are the learned road users.
        """
        return self._waiting.at_kerb(world, n)

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users are so near their destination that SUMO should finish the trip, (n,); from `ahead`."""
        return np.array([road_user in self._near_end for road_user in ids], np.bool_)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users are off their route, (n,).

        These have passed their destination, stand across their path, or SUMO has them on no lane and they are
        FAR_BESIDE their path or on a lane that does not continue along their route.
        """
        return np.array([road_user in self._off_route for road_user in ids], np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the tracks of road users that are no longer learned."""
        self._off_route.difference_update(ids)
        self._near_end.difference_update(ids)
        self._vehicles.forget(ids)
        self._reservations.forget(ids)
        self._pedestrians.forget(ids)

    def _add_vehicle(
        self, route: RouteAhead, world: WorldState, i: int, lane_changes: list[LaneChange]
    ) -> VehicleTrack:
        """Write row `i` of the routes, a vehicle, and add its lane change, if any, to `lane_changes`; return its
        track."""
        road_user, size = world.ids[i], size_of(world.length.item(i), world.width.item(i))
        track = self._vehicles.observed(world, i)
        if (change := self._lane_choice.choose(track, world, i)) is not None:
            lane_changes.append(change)
        track.observe_junction(size.length)
        route.known[i] = True
        route.junction_entry_time[i] = track.history.entered
        waits = self._reservations.occupy(road_user, track, size)
        entries = track.entries_ahead()
        stop, look = self._stop_and_look(road_user, track, entries, size)
        route.desired_speed[i] = min(self._speed_limits.lane_limit(track, REACTION_TIME, DECEL_SHARE), look)
        route.stop[i] = stop = min(stop, waits)
        if entries:
            self._add_signal(route, i, *entries[0], stop)
        track.history.observe_signal(red=route.stop_at_signal.item(i))
        self._add_junction_to_keep_clear(route, i, track, entries, size.length)
        route.remaining_distance[i] = left = self._vehicles.remaining_distance(road_user)
        heading = world.heading.item(i)
        # Handed back across its lane, such as after a turnaround, a vehicle would stand in the way of others.
        if is_near_end(left, track.speed) and _turned(track, heading, track.s + left) < ALIGNED:
            self._near_end.add(road_user)
        # No rule guides a vehicle past its destination, such as on a last edge of a few metres, or on a foreign lane.
        passes = left < 0.0 or _passes_destination(track, left)
        if passes or self._is_stuck(track, heading, size) or self._has_left_lanes(road_user, track):
            self._off_route.add(road_user)
        route.spacing[i] = spacing = spacing_at(track.speed)
        behind = BEHIND * spacing / SPACING
        track.path.line.draw(track.s - 0.5 * size.length - behind, spacing, route.x, route.y, i)
        return track

    def _is_stuck(self, track: VehicleTrack, heading: float, size: Size) -> bool:
        """Whether a vehicle has stood for STUCK s where it and others can block each other for ever.

        That is across its path, as where lanes meet at 145 degrees, and at the end of its lane where it cannot move to
        another one: inside a junction, or still beside the lane.
        """
        if track.history.idle_time <= STUCK:
            return False
        fixed = track.history.entry != "" or abs(track.lateral_offset) > CHANGING
        if fixed and self._speed_limits.stop_at_lane_end(track) < HALTS_BEFORE:
            return True
        return _turned(track, heading, track.s - 0.5 * size.length) > ACROSS

    def _has_left_lanes(self, road_user: str, track: VehicleTrack) -> bool:
        """Whether SUMO has a vehicle of the scenario on no lane, and it is far beside its path or where the path does
        not continue along its route."""
        if road_user.startswith(SPAWNED_PREFIX):
            return False  # SUMO knows no lane of spawned vehicles
        off_lane = abs(track.lateral_offset) > FAR_BESIDE or not self._speed_limits.lane_continues(track)
        return off_lane and self._vehicles.on_no_lane(road_user)

    def _shared_path(self, track: VehicleTrack, world: WorldState, i: int) -> list[SharedPath]:
        """The path that the bicycle in row `i` shares with pedestrians, or has just left; [] if there is none."""
        lane = self._graph.lanes[track.path.lanes[track.path.lane_at(track.s)]]
        if lane.surface == Surface.SIDEWALK:
            return [SharedPath(i, track, lateral_room(lane.width, world.width.item(i)))]
        return [SharedPath(i, track, 0.0)] if track.lateral_position else []

    def _passes_junctions(self, world: WorldState, i: int, track: VehicleTrack) -> bool:
        """Whether the vehicle in row `i` could pass the lines ahead before which it cannot stop without haste, on the
        path of `track`, which begins on its next lane.

        Another vehicle may have entered the junction because the first one was not on the way to its next lane.
        """
        size = size_of(world.length.item(i), world.width.item(i))
        near = braking_distance(track.speed)
        return all(
            rule == "stop"
            or distance > near
            or self._reservations.is_free(world.ids[i], track, entry, priority=rule == "go", size=size)
            for entry, distance, rule, _ in self._speed_limits.entries_ahead(
                track, track.entries_ahead(), REACTION_TIME
            )
        )

    def _stop_and_look(
        self, road_user: str, track: VehicleTrack, entries: list[tuple[JunctionEntry, float]], size: Size
    ) -> tuple[float, float]:
        """Distance (m, inf: none) at which a vehicle must stop, and the speed (m/s) at which it can look for foes with
        priority (inf: none). `entries`: those ahead of the vehicle."""
        stop, look = self._speed_limits.stop_at_lane_end(track), math.inf
        ahead = self._speed_limits.entries_ahead(track, entries, REACTION_TIME)
        track.history.stops_for_yellow = ""
        for entry, distance, rule, too_late in ahead:
            if rule == "stop" and not track.history.stops_for_yellow and self._right_of_way.signal(entry) == YELLOW:
                track.history.stops_for_yellow = entry.via
            if rule == "stop" or not self._reservations.request_entry(
                road_user, track, entry, priority=rule == "go", size=size, too_late=too_late
            ):
                stop = min(stop, distance - STOP_LINE)
            elif rule == "look":
                look = min(look, looking_speed(track, distance, REACTION_TIME))
        return stop, look

    def _add_signal(self, route: RouteAhead, i: int, entry: JunctionEntry, line: float, stop: float) -> None:
        """Write the signal of the next `entry`, `line` m ahead, to row `i` of the routes.

        `stop`: m to where the vehicle must stop.
        """
        signal = self._right_of_way.signal(entry)
        route.line[i], route.signal[i] = line, signal
        route.stop_at_signal[i] = signal >= YELLOW and stop <= line

    def _add_junction_to_keep_clear(
        self, route: RouteAhead, i: int, track: VehicleTrack, entries: list[tuple[JunctionEntry, float]], length: float
    ) -> None:
        """Write the next junction in which a vehicle of this `length` (m) must not stand to row `i` of the routes.

        `entries`: those ahead of the vehicle.
        """
        history = track.history
        if entries and history.held_time > KEEPS_CLEAR_FOR and not route.stop_at_signal[i]:
            history.blocks = entries[0][0].via
        # The junction that the vehicle is in does not count: it may already block others, so it drives on.
        here = junction_of(history.entry) if history.entry else ""
        until, blocks = self._reservations.crossed_until, history.blocks
        ends = ((e, until(e)) for e, _ in entries if e.junction != here and e.via != blocks)
        crossed = ((e, end) for e, end in ends if end > e.stop_line)
        entry, end = next(crossed, (None, math.inf))
        if entry is not None:
            route.keep_clear_line[i] = entry.stop_line - track.s
            route.keep_clear_exit[i] = end_with_room(end, crossed, length) - track.s
            pause, exits = stops_inside(track, entry)
            route.waiting_position[i] = pause if pause < exits else -math.inf

    def _add_pedestrian(self, route: RouteAhead, world: WorldState, i: int) -> None:
        """Write row `i` of the routes, a person; without a path the row stays unknown."""
        road_user = world.ids[i]
        track = self._pedestrians.observed(road_user, world.x.item(i), world.y.item(i), world.heading.item(i))
        route.desired_speed[i] = track.speed
        left = self._pedestrians.remaining_distance(road_user)
        if is_near_end(left, 0.0):
            self._near_end.add(road_user)
        if track.path is None:
            return
        stop, crossing, red = self._pedestrians.next_signal(track)
        route.known[i] = True
        route.stop[i], route.line[i] = stop, crossing
        if math.isfinite(crossing):
            route.signal[i], route.stop_at_signal[i] = RED if red else GREEN, red
        route.remaining_distance[i] = left
        track.path.line.draw(track.s - BEHIND, SPACING, route.x, route.y, i)


def _passes_destination(track: VehicleTrack, left: float) -> bool:
    """Whether a vehicle in a junction has no decision after it and before its destination, `left` m ahead: past that,
    SUMO would put it on another place of its route."""
    if not track.history.entry or not is_near_end(left, track.speed):
        return False
    inside = next((e.exit for e in track.path.entries if e.via == track.history.entry), track.s)
    return inside > track.s and left - (inside - track.s) < track.speed * DECISION_INTERVAL


def _turned(track: VehicleTrack, heading: float, s: float) -> float:
    """Angle (rad, not negative) between a `heading` (rad) and the path of a track at `s` m along it."""
    return abs(math.remainder(heading - track.path.line.at(s)[2], math.tau))


def end_with_room(first: float, following: Iterable[tuple[JunctionEntry, float]], length: float) -> float:
    """Position (m along the path), from the `first` one on, after which a vehicle has room to stand.

    In a row of junctions, a vehicle of this `length` (m) must not stop between two junctions without room for it.
    Only the part of a junction that others cross counts: vehicles that waited for room behind the whole junction
    entered one of 18 m, of which others cross 10 m, one per cycle of its signal.
    `first`, and `following` with each of the next entries: `JunctionReservations.crossed_until` (m along the path).
    """
    room = first
    for entry, end in following:
        if entry.stop_line - room >= length + STOP_LINE:
            break
        room = max(room, end)
    return room


def is_near_end(left: float, speed: float) -> bool:
    """Whether the remaining distance is below NEAR_END, or below the way covered in REACTION_TIME at `speed` (m/s)."""
    return left < NEAR_END or left < REACTION_TIME * speed
