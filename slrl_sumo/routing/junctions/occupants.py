"""Occupants of junctions, and the lanes of the junction that each occupant still needs."""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas, Way, half_width
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import (
    lane_position,
    vehicle_ids,
    vehicle_lane,
    vehicle_route,
    vehicle_speed,
    waiting_time,
)

BRAKING = 2.0
"""Deceleration (m/s²) above which a vehicle, instead of braking, reserves its way."""
COMMITTED = 3.0
"""Distance (m) before its line at which a vehicle reserves its way at the latest."""
ACCELERATION = 1.2
"""Acceleration (m/s²) with which vehicles are expected to leave a junction."""
STARTING = 1.0
"""Speed (m/s) at or below which a background vehicle that must yield to some lanes is not expected to enter."""
UNUSED = 3.0
"""Standing time (s) after which a vehicle's reservation of areas ahead of it no longer stops other vehicles."""


SIDE_GAP = 0.1
"""Lateral gap (m) between vehicles that pass each other straight on, or of which one waits inside a junction."""


@dataclass(frozen=True, slots=True)
class Size:
    """Length and width of a road user, and the room that it needs in a junction, m."""

    length: float
    width: float
    straight: float = field(init=False)
    """Room (m) that a road user on a straight way needs to either side of the centre line of its lane."""
    turning: float = field(init=False)
    """The same on a way that turns."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "straight", 0.5 * (self.width + SIDE_GAP))
        object.__setattr__(self, "turning", half_width(self.length, self.width))


@lru_cache(maxsize=4096)
def size_of(length: float, width: float) -> Size:
    """The size of a road user of this length and width (m); equal sizes share one object."""
    return Size(length, width)


USUAL = Size(5.0, 1.8)
"""Size of vehicles that are not in the world yet, because they have just departed."""


class Occupant(NamedTuple):
    """A vehicle in a junction, a vehicle that has reserved its way through a junction, or a pedestrian on a
    crossing."""

    way: Way
    """Lanes of the junction that the occupant still needs."""
    ahead: tuple[float, ...]
    """Distance (m) from the front to the begin of each of these lanes, negative if the front is past the begin."""
    speed: float
    size: Size
    reserved_until: float
    """Distance (m) from the front to the end of the reservation: the exit, or the stop before the next waiting
    position."""
    time: float
    """Time (s) of this state."""
    yields: bool
    """Is outside the junction, can still stop, and must give way to road users with priority."""
    idle: bool
    """Has stood longer than UNUSED although its signal is not red."""
    idle_time: float = 0.0
    """Time (s) for which a learned vehicle has stood although its signal is not red."""
    entry_time: float = math.inf
    """Time (s) at which a learned vehicle entered the junction; inf outside, and for background vehicles."""
    waits_at_red: bool = False
    """Its signal at the next waiting position is red."""
    may_be_stopped: bool = False
    """Has passed a waiting position of SUMO, which may still stop it for entering vehicles: it must leave first."""
    acceleration: float = ACCELERATION
    """Acceleration (m/s²) that is expected of the occupant."""
    needs_turning_room: bool = True
    """Needs turning room. False on the way to a waiting position of SUMO: there, a vehicle with turning room and the
    crossing vehicles would wait for each other."""

    is_pedestrian: bool = False
    """Is a pedestrian: vehicles pass pedestrians with their turning room."""
    exit_blocked: bool = False
    """Has stood longer than UNUSED with a free way: something else stops the vehicle, such as a vehicle in its exit."""
    approach_lane: str = ""
    """Lane on which a background vehicle approaches the junction, if it must yield to some lanes; else ''."""

    def half_width(self, *, turns: bool) -> float:
        """Room (m) that the occupant needs to either side of the centre line; `turns`: whether its way turns."""
        return self.size.turning if turns and self.needs_turning_room else self.size.straight


def reserves_from(speed: float) -> float:
    """Distance (m) before its line from which a vehicle at `speed` (m/s) reserves its way."""
    return max(COMMITTED, braking_distance(speed))


def braking_distance(speed: float) -> float:
    """Distance (m) in which a vehicle at `speed` (m/s) stops with BRAKING after a decision interval."""
    return speed * speed / (2.0 * BRAKING) + DECISION_INTERVAL * speed


def lanes_through(track: VehicleTrack, begin: float) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """The internal lanes of the first junction that end after `begin` (m along the path), up to its exit.

    Also returns the distance (m) from the front of the vehicle to the begin of each of these lanes.
    """
    path = track.path
    first = bisect_right(path.ends, begin + 0.1)
    while first < len(path.lanes) and not path.lanes[first].startswith(":"):
        first += 1
    last = first
    while last < len(path.lanes) and path.lanes[last].startswith(":"):
        last += 1
    return path.lanes[first:last], tuple([begin - track.s for begin in path.begins[first:last]])


class _Inside(NamedTuple):
    """An internal lane of a junction."""

    lane: str
    length: float
    goes_on: bool
    """Ends at a waiting position, after which another internal lane follows."""
    waited: bool
    """Begins at a waiting position."""


class _Lanes(NamedTuple):
    """The lanes of a junction."""

    inside: tuple[_Inside, ...]
    before: tuple[str, ...]
    all: frozenset[str]
    """Ids of the lanes inside and before the junction."""


class BackgroundOccupants:
    """The background vehicles that are in junctions or about to enter."""

    def __init__(
        self,
        api: SumoApi,
        graph: LaneGraph,
        areas: ConflictAreas,
        learned: Callable[[str], VehicleTrack | None],
        right_of_way: RightOfWay,
    ) -> None:
        """`learned`: returns the track of a learned vehicle by id, None for background vehicles."""
        self._api, self._graph, self._areas = api, graph, areas
        self._learned, self._right_of_way = learned, right_of_way
        self._lanes: dict[str, _Lanes] = {}
        self._world: WorldState | None = None
        self._rows: dict[str, int] = {}
        self._on_lane: dict[str, list[str]] | None = None
        self._found: dict[str, dict[str, Occupant]] = {}

    def renew(self, world: WorldState) -> None:
        """Drop the data of SUMO's last step; `world`: all road users now."""
        self._world = world
        self._rows.clear()
        self._on_lane = None
        self._found.clear()

    def of(self, junction: str) -> dict[str, Occupant]:
        """The occupants of a junction by id, as SUMO has them now."""
        if junction not in self._found:
            self._found[junction] = self._read(junction)
        return self._found[junction]

    def _read(self, junction: str) -> dict[str, Occupant]:
        found: dict[str, Occupant] = {}
        lanes, on_lane = self._lanes_of(junction), self._by_lane()
        if on_lane.keys().isdisjoint(lanes.all):
            return found
        for lane, length, goes_on, waited in lanes.inside:
            for vehicle in on_lane.get(lane, ()):
                if self._learned(vehicle) is not None:
                    continue  # learned since this decision
                position = lane_position(self._api, vehicle)
                until = length - position if goes_on else math.inf
                found[vehicle] = self._occupant(
                    vehicle, lane, -position, until, may_be_stopped=waited, needs_turning_room=not goes_on
                )
        for lane in lanes.before:
            end = self._graph.lanes[lane].length
            for vehicle in on_lane.get(lane, ()):
                if self._learned(vehicle) is not None:
                    continue
                distance, speed = end - lane_position(self._api, vehicle), vehicle_speed(self._api, vehicle)
                if distance > reserves_from(speed):
                    continue
                route, index = vehicle_route(self._api, vehicle)
                following = route[index + 1] if 0 <= index + 1 < len(route) else ""
                for target, via in self._graph.links(lane):
                    wanted = via and self._graph.lanes[target].edge == following
                    first = wanted and self._right_of_way.has_priority(lane, target, via)
                    # A standing vehicle may be yielding.
                    if first or (wanted and speed > STARTING and self._right_of_way.is_green(lane, target, via)):
                        until = distance + self._graph.lanes[via].length
                        goes_on = any(more for _, more in self._graph.links(via))
                        one = self._occupant(vehicle, via, distance, until, needs_turning_room=not goes_on)
                        found[vehicle] = one if first else one._replace(approach_lane=lane)
                        break
        return found

    def _by_lane(self) -> dict[str, list[str]]:
        """The background vehicles by lane: junctions have dozens of lanes, and nearly all of them are empty."""
        if self._on_lane is None:
            self._on_lane = {}
            for name in vehicle_ids(self._api):
                if self._learned(name) is None:
                    self._on_lane.setdefault(vehicle_lane(self._api, name), []).append(name)
        return self._on_lane

    def _lanes_of(self, junction: str) -> _Lanes:
        lanes = self._lanes.get(junction)
        if lanes is None:
            inside, before, links = [], [], self._graph.links
            for lane in self._graph.inside.get(junction, ()):
                origin = self._graph.origin(lane)
                goes_on = any(via for _, via in links(lane))
                waited = all(via != lane for _, via in links(origin))
                inside.append(_Inside(lane, self._graph.lanes[lane].length, goes_on, waited))
                before += [] if origin.startswith(":") else [origin]
            ids = frozenset((*before, *(one.lane for one in inside)))
            lanes = self._lanes[junction] = _Lanes(tuple(inside), tuple(dict.fromkeys(before)), ids)
        return lanes

    def _occupant(
        self,
        vehicle: str,
        lane: str,
        ahead: float,
        until: float,
        *,
        may_be_stopped: bool = False,
        needs_turning_room: bool = True,
    ) -> Occupant:
        assert self._world is not None, "call renew first"
        idle = waiting_time(self._api, vehicle) > UNUSED
        speed, time = vehicle_speed(self._api, vehicle), self._world.time
        return Occupant(
            self._areas.way((lane,)), (ahead,), speed, self._size(vehicle), until, time,
            yields=False, idle=idle, may_be_stopped=may_be_stopped, needs_turning_room=needs_turning_room,
        )  # fmt: skip

    def _size(self, vehicle: str) -> Size:
        assert self._world is not None, "call renew first"
        if not self._rows:
            self._rows = {name: row for row, name in enumerate(self._world.ids)}
        row = self._rows.get(vehicle)
        return USUAL if row is None else size_of(self._world.length.item(row), self._world.width.item(row))
