"""Lane choice of vehicles: for their route, past a queue, or to overtake."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slrl_sumo.routing.lane_approaches import LaneApproaches
from slrl_sumo.routing.lane_changes import (
    CHANGES_WITHIN,
    PAUSE,
    QUEUED,
    SETTLES,
    SIGHT,
    LaneChange,
    faster_there,
    has_gap,
    is_far,
    is_soon,
    shorter_queue,
)
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import LanePath
from slrl_sumo.routing.next_lane import NextLane
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker, point_before, seed_of
from slrl_sumo.scene.levels import Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network.lanes import lane_index

CHANGING, MOST_ASIDE = 0.8, 8.0
"""Lateral offset (m) beyond which a vehicle is changing lanes, and greatest distance (m) of the next lane."""


class LaneChoice:
    """Chooses lanes for tracked vehicles: a track that changes lanes gets the path that begins on its new lane."""

    def __init__(
        self,
        graph: LaneGraph,
        tracks: VehicleTracker,
        levels: Levels,
        passes: Callable[[WorldState, int, VehicleTrack], bool] = lambda world, i, track: True,
    ) -> None:
        """`passes`: whether the vehicle in a row of a world could pass the junctions just ahead on the path of a track;
        its lane change waits until then."""
        self._graph, self._tracks, self._levels, self._passes = graph, tracks, levels, passes
        self._approaches = LaneApproaches(graph)

    def choose(self, track: VehicleTrack, world: WorldState, i: int) -> LaneChange | None:
        """Begin the lane change of the vehicle in row `i` of `world`, if the gap suffices.

        Returns the lane change that is under way or waits for a gap, else None.
        """
        path = track.path
        if not (track.edges or path.route) or path.lanes[0].startswith(":") or path.lane_at(track.s) > 0:
            return None
        if abs(track.lateral_offset) > CHANGING:
            near, direction = self._near(track, world), path.line.at(track.s)[2]
            return self._change_to(path, near, i, track.lateral_offset, direction, 0.0)
        # SUMO inserts vehicles beside a vehicle that is changing to their lane, because it is not on that lane yet.
        settles = world.time < track.history.begun + SETTLES
        left = path.ends[0] - track.s
        if path.next_lane is not None and not is_far(left, track.speed):
            if settles and not is_soon(left, track.speed):
                return None
            return self._begin_change(track, world, i, path.next_lane, path.end - track.s, always=True)
        return self._overtake(track, world, i, left) if path.route and not settles else None

    def _overtake(self, track: VehicleTrack, world: WorldState, i: int, left: float) -> LaneChange | None:
        """Change to a lane that serves the route equally well and is faster."""
        if track.speed < QUEUED or world.time < track.history.changed + PAUSE:
            return None
        lane, vehicle_class = track.path.lanes[0], track.parameters.vehicle_class
        if is_far(left, track.speed):
            lanes = self._graph.neighbours(lane, vehicle_class)
        else:
            lanes = self._graph.equal_lanes(lane, vehicle_class, track.path.route)
        for target in lanes:
            change = self._begin_change(track, world, i, target, math.inf, always=False)
            if change is not None:
                return change
        return None

    def _begin_change(
        self, track: VehicleTrack, world: WorldState, i: int, target: str, left: float, *, always: bool
    ) -> LaneChange | None:
        """Begin to change to the lane `target` if the gap suffices; unless `always`, only to a better lane."""
        length = float(world.length[i])
        before = point_before(self._graph, target, length)
        path = self._graph.path(target, track.edges, track.parameters.vehicle_class, before, seed_of(world.ids[i]))
        x, y, direction = track.path.line.at(track.s)
        x, y = x - track.lateral_offset * math.sin(direction), y + track.lateral_offset * math.cos(direction)
        s, lateral_offset = path.line.nearest(x, y, end=path.ends[0])
        if abs(lateral_offset) > MOST_ASIDE:
            return None
        near = self._near(track, world)
        change = self._change_to(path, near, i, lateral_offset, path.line.at(s)[2], left)
        if not always and not self._gets_on_better(track, world, change, target):
            return None
        changed = replace(track, path=path, s=s, lateral_offset=lateral_offset)
        entering = [row for row, other in near if _enters(other, target)]
        gap = has_gap(world, change, entering, self._levels)
        if gap and self._passes(world, i, changed):
            track.path, track.s, track.lateral_offset, track.history.changed = path, s, lateral_offset, world.time
        return change

    def _change_to(
        self,
        path: LanePath,
        near: list[tuple[int, VehicleTrack]],
        i: int,
        lateral_offset: float,
        direction: float,
        left: float,
    ) -> LaneChange:
        """The lane change of the vehicle in row `i` to the first lane of `path`; `near`: see `_near`."""
        target = path.lanes[0]
        begin, _ = path.line.nearest(*self._graph.lanes[target].points[0], end=path.ends[0])
        lane = NextLane(path.line, begin, self._approaches(target))
        after = ((row, _after_junction(other)) for row, other in near)
        beside = [name for name in self._graph.lanes_of(target) if name != target]
        elsewhere = tuple(row for row, name in after if name in beside)
        return LaneChange(i, lateral_offset, direction, left, lane, elsewhere)

    def _gets_on_better(self, track: VehicleTrack, world: WorldState, change: LaneChange, target: str) -> bool:
        """Whether the next lane, `target`, is better: a shorter queue, or a higher speed."""
        left = track.path.ends[0] - track.s
        if shorter_queue(world, change, left, self._levels):
            return True
        if left < min(CHANGES_WITHIN[0] * track.speed, CHANGES_WITHIN[1]):
            return False
        lane = track.path.lanes[0]
        desired = min(self._graph.limit(lane) * track.parameters.speed_factor, track.parameters.max_speed)
        return faster_there(world, change, desired, self._levels, back=lane_index(target) < lane_index(lane))

    def _near(self, track: VehicleTrack, world: WorldState) -> list[tuple[int, VehicleTrack]]:
        """Rows and tracks of the other learned vehicles within SIGHT of a track."""
        near = np.flatnonzero(np.hypot(world.x - track.x, world.y - track.y) < SIGHT)
        others = [(row, self._tracks.get(world.ids[row])) for row in near.tolist()]
        return [(row, other) for row, other in others if other is not None and other is not track]


def _enters(track: VehicleTrack, lane: str) -> bool:
    """Whether a vehicle is changing to a lane, or is in a junction from which its path leads to the lane."""
    after = _after_junction(track)
    return after == lane if after else track.path.lanes[0] == lane and abs(track.lateral_offset) > CHANGING


def _after_junction(track: VehicleTrack) -> str:
    """The lane to which the path of a vehicle in a junction leads; '' outside junctions and if the path ends there."""
    lanes, here = track.path.lanes, track.path.lane_at(track.s)
    return next((name for name in lanes[here:] if not name.startswith(":")), "") if lanes[here].startswith(":") else ""
