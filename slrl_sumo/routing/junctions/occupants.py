"""Vehicles in junctions, and the parts of junctions that they still need."""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas, Way, half_width
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.scene.state import WorldState
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
"""m/s²: a vehicle that would have to brake harder to stop reserves its way."""
COMMITTED = 3.0
"""m before its line at which a vehicle reserves its way at the latest."""
ACCELERATION = 1.2
"""m/s² with which vehicles are expected to leave a junction."""
STARTING = 1.0
"""m/s: a slower vehicle of SUMO's that does not go first of all is not expected to enter."""
UNUSED = 3.0
"""s of standing after which a vehicle's reservation of areas ahead of it no longer stops others."""


SIDE_GAP = 0.1
"""m between vehicles that pass each other straight on, or where one waits inside a junction."""


@dataclass(frozen=True, slots=True)
class Size:
    """Of a road user, m."""

    length: float
    width: float
    straight: float = field(init=False)
    """m to either side of its lane's centre line that it needs straight on."""
    turning: float = field(init=False)
    """The same where its way turns."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "straight", 0.5 * (self.width + SIDE_GAP))
        object.__setattr__(self, "turning", half_width(self.length, self.width))


USUAL = Size(5.0, 1.8)
"""Of vehicles that are not in the world: those that have just departed."""


class Occupant(NamedTuple):
    """A vehicle that is in a junction, or has reserved its way through it, or a pedestrian on a crossing."""

    way: Way
    """The lanes that it still needs."""
    ahead: tuple[float, ...]
    """m from the front to the begin of each of them, negative where the front is on it."""
    speed: float
    size: Size
    reserved_until: float
    """m from the front to where the reservation ends: the exit, or where it stops before the next waiting position."""
    time: float
    """s: when this was true."""
    yields: bool
    """It is not in the junction, can still stop, and others have the right of way."""
    idle: bool
    """It has stood for UNUSED, although its signal is not red."""
    idle_time: float = 0.0
    """s that it has done so, of learned vehicles."""
    entry_time: float = math.inf
    """s: when it entered the junction; inf of those that have not, and of those that SUMO drives."""
    waits_at_red: bool = False
    """Its signal at the next waiting position is red."""
    may_be_stopped: bool = False
    """It has passed a waiting position, and SUMO may still stop it for those that enter: it has to be gone first."""
    acceleration: float = ACCELERATION
    """m/s² that is expected of it."""
    needs_turning_room: bool = True
    """It needs room where it turns. Not so on the way to a waiting position of SUMO's: those that cross would wait for
    it there, and it for them."""

    is_pedestrian: bool = False
    """Vehicles pass it with the room that they need for a turn."""
    exit_blocked: bool = False
    """It has stood for UNUSED with its way reserved: something else stops it, as a vehicle in its exit."""
    approach_lane: str = ""
    """The lane on which it comes to the junction, if it goes first of some of the others only."""

    def half_width(self, *, turns: bool) -> float:
        """m to either side of its lanes' centre line that it needs; `turns`: where its way turns."""
        return self.size.turning if turns and self.needs_turning_room else self.size.straight


def reserves_from(speed: float) -> float:
    """m before its line from which a vehicle at `speed` (m/s) reserves its way."""
    return max(COMMITTED, speed * speed / (2.0 * BRAKING) + 0.4 * speed)


def lanes_through(track: VehicleTrack, begin: float) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """The internal lanes of the junction on a path that end after `begin` (m along it), up to its exit, and m from the
    front of the vehicle to the begin of each of them."""
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
    """At a waiting position, to another internal lane."""
    waited: bool
    """It begins at a waiting position."""


class _Lanes(NamedTuple):
    """The lanes of a junction."""

    inside: tuple[_Inside, ...]
    before: tuple[str, ...]
    all: frozenset[str]
    """Ids of both."""


class BackgroundOccupants:
    """The vehicles in junctions that SUMO drives, and those that are about to enter."""

    def __init__(
        self,
        api: SumoApi,
        graph: LaneGraph,
        areas: ConflictAreas,
        learned: Callable[[str], VehicleTrack | None],
        right_of_way: RightOfWay,
    ) -> None:
        """`learned`: None for vehicles that SUMO drives."""
        self._api, self._graph, self._areas = api, graph, areas
        self._learned, self._right_of_way = learned, right_of_way
        self._lanes: dict[str, _Lanes] = {}
        self._world: WorldState | None = None
        self._rows: dict[str, int] = {}
        self._on_lane: dict[str, list[str]] | None = None
        self._found: dict[str, dict[str, Occupant]] = {}

    def renew(self, world: WorldState) -> None:
        """Forget what was read of SUMO's last step; `world`: all road users now."""
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
                    continue  # since this decision
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
                    # One that stands may stand for others.
                    if first or (wanted and speed > STARTING and self._right_of_way.is_green(lane, target, via)):
                        until = distance + self._graph.lanes[via].length
                        goes_on = any(more for _, more in self._graph.links(via))
                        one = self._occupant(vehicle, via, distance, until, needs_turning_room=not goes_on)
                        found[vehicle] = one if first else one._replace(approach_lane=lane)
                        break
        return found

    def _by_lane(self) -> dict[str, list[str]]:
        """The vehicles that SUMO drives, by lane: junctions have dozens of lanes, and nearly all of them are empty."""
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
        return USUAL if row is None else Size(self._world.length.item(row), self._world.width.item(row))
