"""Speeds that limits, signals, priority and leaders allow vehicles of the baseline `lane`."""

import math

from slrl_sumo.agent.lane_baseline.link_rules import LinkRules
from slrl_sumo.routing.junctions.right_of_way import LINE_OF_SIGHT, RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE
from slrl_sumo.routing.speed_limits import SpeedLimits, braking_speed, within_sight
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.scene.types import SPAWNED_PREFIX
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import leader_of, vehicle_speed

LEADER_WITHIN = 50.0
"""Distance (m) ahead within which SUMO searches a leader."""


class LaneSpeeds:
    """Allowed speeds of tracked vehicles, m/s. Call `renew` after each SUMO step."""

    def __init__(self, api: SumoApi, graph: LaneGraph, vehicles: VehicleTracker) -> None:
        self._api, self._vehicles = api, vehicles
        self._limits, self._rules = SpeedLimits(graph, RightOfWay(api, graph)), LinkRules(api, graph)

    def renew(self) -> None:
        """Drop the data of SUMO's last step."""
        self._rules.renew()

    def allowed(self, track: VehicleTrack, standing_time: float, dt: float) -> float:
        """The speed (m/s) that limits, signals, priority and the end of the lane allow for the next `dt` s.

        `standing_time`: standing time of the vehicle, s.
        """
        speed, own = self._limits.lane_limit(track, dt), track.parameters
        for entry, distance in within_sight(track, track.entries_ahead(), dt):
            rule = self._rules.rule(entry, distance, track.speed, (own.accel, own.decel), standing_time)
            if rule == "go":
                continue
            to_stop = max(distance - STOP_LINE, 0.0) if rule == "stop" else max(distance, LINE_OF_SIGHT)
            speed = min(speed, _discrete(math.sqrt(2.0 * own.decel * to_stop), own.decel, dt))
        # At the end of its lane, the vehicle waits for a gap in the next lane.
        return min(speed, braking_speed(0.0, self._limits.stop_at_lane_end(track), own.decel, dt))

    def following(self, road_user: str, track: VehicleTrack, dt: float) -> float:
        """Krauss' safe speed behind SUMO's leader (https://sumo.dlr.de/docs/Car-Following-Models.html)."""
        if road_user.startswith(SPAWNED_PREFIX):
            return math.inf
        leader = leader_of(self._api, road_user, LEADER_WITHIN)
        if leader is None:
            return math.inf
        other, own = self._vehicles.get(leader[0]), track.parameters
        leader_speed = other.speed if other is not None else max(vehicle_speed(self._api, leader[0]), 0.0)
        gap = max(leader[1], 0.0)
        delay = own.decel * max(own.tau, dt)
        safe = math.sqrt(delay * delay + leader_speed * leader_speed + 2.0 * own.decel * gap) - delay
        return min(safe, _keep_clear_speed(track, gap, leader_speed, dt))


def _keep_clear_speed(track: VehicleTrack, gap: float, leader_speed: float, dt: float) -> float:
    """The speed (m/s) with which a vehicle waits before a junction whose exit is occupied; inf otherwise."""
    for entry in track.path.entries[:1]:
        distance = entry.stop_line - track.s
        if distance > 0.0 and leader_speed < 1.0 and -2.0 < gap - (entry.exit - track.s) < 5.0:
            return braking_speed(0.0, distance - STOP_LINE, track.parameters.decel, dt)
    return math.inf


def _discrete(speed: float, decel: float, dt: float) -> float:
    """The speed (m/s) that a vehicle may hold over the next interval, from the allowed speed in continuous time."""
    return math.sqrt(decel * decel * dt * dt + speed * speed) - decel * dt
