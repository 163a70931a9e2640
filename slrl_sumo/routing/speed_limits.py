"""Speeds that a vehicle's surroundings allow: limits, signals, priority, leaders, the end of its lane."""

import math
from collections.abc import Callable

from slrl_sumo.routing.junctions.right_of_way import LINE_OF_SIGHT, RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry
from slrl_sumo.routing.vehicle_track import ROLLING, STOPS_OVER, VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.scene.types import SPAWNED_PREFIX
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import leader_of, vehicle_speed

STOPS_WITH = 0.95
"""Share of its deceleration with which a vehicle must be able to stop at a line, else it goes on: 4.3 m/s² of SUMO's
usual car."""
LOOKS_WITH = 0.8
"""The same where it begins to see those that go first: 5.7 m/s, SUMO's usual car is at 6.3 m/s there."""
LANE_END = 3.0
"""m before the end of its lane at which a vehicle waits for a gap in the next lane."""


class SpeedLimits:
    """Speeds that SUMO's lanes, signals and leaders allow tracked vehicles."""

    def __init__(self, api: SumoApi, graph: LaneGraph, vehicles: VehicleTracker, right_of_way: RightOfWay) -> None:
        self._api, self._graph, self._vehicles, self._right_of_way = api, graph, vehicles, right_of_way

    def renew(self) -> None:
        """Forget what was read of SUMO's last step."""
        self._graph.renew()
        self._right_of_way.renew()

    def allowed_speed(self, track: VehicleTrack, dt: float) -> float:
        """The speed (m/s) that limits, signals, priority and the end of the lane allow."""
        speed = self.lane_limit(track, dt)
        for entry, distance in self._entries_near(track, dt):
            limits = (track.accel, track.decel)
            allowed = self._right_of_way.speed(entry, distance, track.speed, limits, track.standing_time)
            speed = min(speed, _discrete(allowed, track.decel, dt))
        if self._path_suffices(track):
            return speed
        # Wait at the end of the lane for a gap in the next one.
        return min(speed, _braking_speed(0.0, track.path.end - track.s - LANE_END, track.decel, dt))

    def lane_limit(self, track: VehicleTrack, dt: float, decel_share: float = 1.0) -> float:
        """The speed (m/s) that the limits of the lanes under the vehicle and ahead of it allow.

        Lower limits ahead are reached with the share `decel_share` of the vehicle's deceleration.
        """
        path, decel = track.path, decel_share * track.decel
        here = path.lane_at(track.s)
        speed = min(self._graph.limit(path.lanes[here]) * track.speed_factor, track.max_speed)
        sight = _sight(track.speed, decel, dt)
        for k in range(here + 1, len(path.lanes)):
            distance = path.ends[k - 1] - track.s
            if distance > sight:
                break
            limit = min(self._graph.limit(path.lanes[k]) * track.speed_factor, track.max_speed)
            speed = min(speed, _braking_speed(limit, distance, decel, dt))
        return speed

    def stop_and_look(
        self,
        track: VehicleTrack,
        dt: float,
        accel_share: float,
        may_enter: Callable[..., bool],
    ) -> tuple[float, float]:
        """How far ahead (m, inf: nowhere) the vehicle must stop, and the speed (m/s) at which it can look for foes.

        That speed is reached with LOOKS_WITH of its deceleration, and `dt` seconds early. The vehicle is expected to
        cross junctions with the share `accel_share` of its acceleration; `may_enter` says whether the junction after an
        entry can be crossed, with `priority` or without.
        """
        stop, look = math.inf, math.inf
        for entry, distance in self._entries_near(track, dt):
            if distance < 0.0 and track.speed > ROLLING:
                continue  # already over the line
            limits = (accel_share * track.accel, STOPS_WITH * track.decel)
            rule = self._right_of_way.rule(entry, distance, track.speed, limits, track.standing_time)
            too_late = track.speed * track.speed / (2.0 * limits[1]) > distance + 1.0
            # A stop sign: a stand before the line comes first, also where nothing comes.
            rule = "stop" if self._right_of_way.halts(entry) and track.halted != entry.via else rule
            if rule == "stop" or not may_enter(entry, priority=rule == "go", too_late=too_late):
                stop = min(stop, distance - STOP_LINE)
            elif rule == "look" and (seen := distance - track.speed * dt) > LINE_OF_SIGHT:
                # Nearer than that it sees them, and may enter.
                look = min(look, math.sqrt(2.0 * LOOKS_WITH * track.decel * seen))
        if not self._path_suffices(track):
            stop = min(stop, track.path.end - track.s - LANE_END)
        return stop, look

    def signal(self, entry: JunctionEntry) -> int:
        """The signal at an entry: 0 none, 1 green, 2 yellow, 3 red."""
        return self._right_of_way.signal(entry)

    def _entries_near(self, track: VehicleTrack, dt: float) -> list[tuple[JunctionEntry, float]]:
        """The entries that matter at the present speed, with the distances to them in m."""
        sight = _sight(track.speed, track.decel, dt) + 5.0
        return [
            (entry, near) for entry in track.path.entries if -STOPS_OVER < (near := entry.stop_line - track.s) < sight
        ]

    def lane_continues(self, track: VehicleTrack) -> bool:
        """Whether the lane under a vehicle continues along its route; inside a junction it always does."""
        here = track.path.lane_at(track.s)
        return track.path.lanes[here].startswith(":") or self._path_suffices(track)

    def _path_suffices(self, track: VehicleTrack) -> bool:
        """Whether the path is as long as the route, or longer than any sight."""
        last = self._graph.lanes[track.path.lanes[-1]]
        if track.path.end - track.s > 120.0:
            return True
        if not track.edges:
            return not self._graph.is_closed_after(last.id, track.vehicle_class)
        return last.edge == track.edges[-1]

    def following_speed(self, road_user: str, track: VehicleTrack, dt: float) -> float:
        """Krauss' safe speed behind SUMO's leader (https://sumo.dlr.de/docs/Car-Following-Models.html)."""
        if road_user.startswith(SPAWNED_PREFIX):
            return math.inf
        leader = leader_of(self._api, road_user, 50.0)
        if leader is None:
            return math.inf
        other = self._vehicles.get(leader[0])
        leader_speed = other.speed if other is not None else max(vehicle_speed(self._api, leader[0]), 0.0)
        gap = max(leader[1], 0.0)
        delay = track.decel * max(track.tau, dt)
        safe = math.sqrt(delay * delay + leader_speed * leader_speed + 2.0 * track.decel * gap) - delay
        return min(safe, self._keep_clear_speed(track, gap, leader_speed, dt))

    def _keep_clear_speed(self, track: VehicleTrack, gap: float, leader_speed: float, dt: float) -> float:
        """Wait before a junction while its exit is occupied, instead of stopping inside of it."""
        for entry in track.path.entries[:1]:
            distance = entry.stop_line - track.s
            if distance > 0.0 and leader_speed < 1.0 and -2.0 < gap - (entry.exit - track.s) < 5.0:
                return _braking_speed(0.0, distance - STOP_LINE, track.decel, dt)
        return math.inf


def _sight(speed: float, decel: float, dt: float) -> float:
    """m ahead of a vehicle that matter at `speed` (m/s), if it brakes with `decel` (m/s²)."""
    return speed * dt + speed**2 / (2.0 * decel) + 10.0


def _braking_speed(target: float, distance: float, decel: float, dt: float) -> float:
    """The speed (m/s) from which `target` is reached after `distance` (m), after one more interval at that speed."""
    delay = decel * dt
    root = delay * delay + target * target + 2.0 * decel * max(distance, 0.0)
    return max(math.sqrt(root) - delay, target)


def _discrete(speed: float, decel: float, dt: float) -> float:
    """For a speed that is allowed in continuous time, the one that may be held over the next interval."""
    if not math.isfinite(speed):
        return speed
    return math.sqrt(decel * decel * dt * dt + speed * speed) - decel * dt
