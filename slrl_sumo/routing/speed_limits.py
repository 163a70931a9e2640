"""Limits that lanes and signals set for a vehicle: speeds, the lines ahead, the end of its lane."""

import math
from typing import NamedTuple

from slrl_sumo.routing.junctions.right_of_way import LINE_OF_SIGHT, RightOfWay, Rule
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import JunctionEntry
from slrl_sumo.routing.vehicle_track import ROLLING, VehicleTrack
from slrl_sumo.scene.types import DECISION_INTERVAL

STOPS_WITH = 0.95
"""Share of its deceleration with which a vehicle must be able to stop at a line, else it goes on: 4.3 m/s² for SUMO's
default car."""
LOOKS_WITH = 0.8
"""The same where the vehicle begins to see foes with priority: 5.7 m/s there; SUMO's default car drives 6.3 m/s."""
LANE_END = 3.0
"""Distance (m) before the end of its lane at which a vehicle waits for a gap in the next lane."""
FAR_END = 120.0
"""Distance (m) to the end of a path beyond any sight."""
REACTION_TIME = 2 * DECISION_INTERVAL
"""Time (s) from a decision until its effect shows."""


class EntryAhead(NamedTuple):
    """A line that matters to a vehicle at its present speed."""

    entry: JunctionEntry
    distance: float
    """Distance (m) from the front of the vehicle."""
    rule: Rule
    too_late: bool
    """The vehicle can no longer stop before the line."""


class SpeedLimits:
    """Limits that lanes and signals set for tracked vehicles."""

    def __init__(self, graph: LaneGraph, right_of_way: RightOfWay) -> None:
        self._graph, self._right_of_way = graph, right_of_way

    def lane_limit(self, track: VehicleTrack, dt: float, decel_share: float = 1.0) -> float:
        """The speed (m/s) that the limits of the lanes under the vehicle and ahead of it allow.

        The vehicle brakes for lower limits ahead with the share `decel_share` of its deceleration.
        """
        path, own, s, limit_of = track.path, track.parameters, track.s, self._graph.limit
        decel, factor, most = decel_share * own.decel, own.speed_factor, own.max_speed
        lanes, ends, here = path.lanes, path.ends, path.lane_at(s)
        speed = min(limit_of(lanes[here]) * factor, most)
        sight = _sight(track.speed, decel, dt)
        for k in range(here + 1, len(lanes)):
            distance = ends[k - 1] - s
            if distance > sight:
                break
            limit = min(limit_of(lanes[k]) * factor, most)
            if limit < speed:
                speed = min(speed, braking_speed(limit, distance, decel, dt))
        return speed

    def entries_ahead(
        self, track: VehicleTrack, ahead: list[tuple[JunctionEntry, float]], dt: float
    ) -> list[EntryAhead]:
        """The lines that matter to the vehicle; `ahead`: those of `VehicleTrack.entries_ahead`; `dt`: time (s) until a
        decision shows its effect."""
        found, decel = [], STOPS_WITH * track.parameters.decel
        for entry, distance in within_sight(track, ahead, dt):
            if distance < 0.0 and track.speed > ROLLING:
                continue  # already over the line
            halted, stopping = track.history.halted == entry.via, track.history.stops_for_yellow == entry.via
            rule = self._right_of_way.rule(entry, distance, track.speed, decel, halted=halted, stopping=stopping)
            too_late = track.speed * track.speed / (2.0 * decel) > distance + 1.0
            found.append(EntryAhead(entry, distance, rule, too_late))
        return found

    def stop_at_lane_end(self, track: VehicleTrack) -> float:
        """Distance (m) to where the vehicle must wait for a gap in the next lane; inf if its lane continues."""
        return math.inf if self.suffices(track) else track.path.end - track.s - LANE_END

    def lane_continues(self, track: VehicleTrack) -> bool:
        """Whether the lane under a vehicle continues along its route; inside a junction it does if the path leaves the
        junction."""
        inside = track.path.lanes[track.path.lane_at(track.s)].startswith(":")
        return (inside and not track.path.lanes[-1].startswith(":")) or self.suffices(track)

    def suffices(self, track: VehicleTrack) -> bool:
        """Whether the path of the vehicle is as long as its route, or longer than any sight."""
        if track.path.end - track.s > FAR_END:
            return True
        last = self._graph.lanes[track.path.lanes[-1]]
        if not track.edges:
            ends = track.path.next_lane is not None
            return not ends and not self._graph.is_closed_after(last.id, track.parameters.vehicle_class)
        return last.edge == track.edges[-1]


def within_sight(
    track: VehicleTrack, ahead: list[tuple[JunctionEntry, float]], dt: float
) -> list[tuple[JunctionEntry, float]]:
    """The entries `ahead` of a vehicle (see `VehicleTrack.entries_ahead`) within sight at its present speed."""
    sight = _sight(track.speed, track.parameters.decel, dt) + 5.0
    return [(entry, distance) for entry, distance in ahead if distance < sight]


def looking_speed(track: VehicleTrack, distance: float, dt: float) -> float:
    """The speed (m/s) at which a vehicle `distance` m before a line can look for foes with priority.

    From this speed it can stop with LOOKS_WITH of its deceleration, after `dt` s. inf within LINE_OF_SIGHT.
    """
    seen = distance - track.speed * dt
    return math.sqrt(2.0 * LOOKS_WITH * track.parameters.decel * seen) if seen > LINE_OF_SIGHT else math.inf


def braking_speed(target: float, distance: float, decel: float, dt: float) -> float:
    """The speed (m/s) from which a vehicle reaches `target` within `distance` (m), after `dt` s at constant speed."""
    delay = decel * dt
    root = delay * delay + target * target + 2.0 * decel * max(distance, 0.0)
    return max(math.sqrt(root) - delay, target)


def _sight(speed: float, decel: float, dt: float) -> float:
    """Distance (m) ahead that matters to a vehicle at `speed` (m/s) that brakes with `decel` (m/s²)."""
    return speed * dt + speed**2 / (2.0 * decel) + 10.0
