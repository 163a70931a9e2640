"""Which vehicles are in junctions, and which one may enter next.

A vehicle enters a junction only when no other one is in a conflict area on its way, or will have left it in time. All
areas up to the exit, or to the next waiting position, are reserved at once, so that vehicles inside never wait for each
other in a circle.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from slrl_sumo.routing.conflict_areas import ConflictAreas
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.right_of_way import time_to_cover
from slrl_sumo.routing.vehicle_tracker import VehicleTrack
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import lane_position, vehicle_speed, vehicles_on_lane

STANDING = 1.0
"""m/s: a slower vehicle in a conflict area is not expected to leave it in time."""
GAP = 0.5
"""s between two vehicles in a conflict area."""
ACCELERATION = 1.2
"""m/s² with which vehicles are expected to leave a junction."""
COMMITTED = 3.0
"""m before its line at which a vehicle reserves its way at the latest."""
HARD = 3.0
"""m/s²: a vehicle that would have to brake harder to stop no longer yields."""
BRAKING = 2.0
"""m/s²: a vehicle that would have to brake harder to stop reserves its way."""
UNUSED = 3.0
"""s of standing after which a vehicle's reservation of areas ahead of it no longer stops others."""
USUAL_LENGTH = 5.0
"""m, of vehicles that SUMO drives."""


@dataclass(frozen=True)
class _Piece:
    """A lane on a vehicle's way: m from the vehicle's front to its begin, negative where the front is on it."""

    lane: str
    ahead: float


@dataclass(frozen=True)
class _Occupant:
    """A vehicle that is in a junction, or has reserved its way through it."""

    pieces: tuple[_Piece, ...]
    speed: float
    length: float
    until: float
    """m from the front to where the reservation ends: the exit, or the next waiting position."""
    time: float
    """s: when this was true."""
    yields: bool
    """It is not in the junction, can still stop, and others have the right of way."""
    idle: bool
    """It has stood for UNUSED, although it may go: something else stops it."""


class JunctionReservations:
    """Reservations of the learned vehicles, and the places of all others. Call `renew` after each SUMO step."""

    def __init__(self, api: SumoApi, graph: LaneGraph, learned: Callable[[str], VehicleTrack | None]) -> None:
        """`learned` gives the track of a learned vehicle by id, None for all others."""
        self._api, self._graph, self._learned = api, graph, learned
        self._areas = ConflictAreas(graph)
        self._lanes: dict[str, list[str]] = {}
        for lane in graph.lanes.values():
            if lane.internal:
                self._lanes.setdefault(_junction(lane.id), []).append(lane.id)
        self._held: dict[str, dict[str, _Occupant]] = {}
        self._holds: dict[str, set[str]] = {}
        """The junctions in which each vehicle holds something."""
        self._others: dict[str, dict[str, _Occupant]] = {}
        self._time = 0.0

    def renew(self, time: float) -> None:
        """Forget what was read of SUMO's last step, and reservations that were not renewed since; `time` in s."""
        self._others.clear()
        for holders in self._held.values():
            for vehicle in [name for name, one in holders.items() if one.time < self._time - 1e-6]:
                del holders[vehicle]
                self._holds.pop(vehicle, None)
        self._time = time

    def update(self, vehicle: str, track: VehicleTrack, length: float) -> None:
        """Renew what a learned vehicle of this length (m) occupies; reservations for entries end here."""
        # Not a look at every junction: a city has thousands, for each of its vehicles.
        for junction in self._holds.pop(vehicle, ()):
            self._held[junction].pop(vehicle, None)
        if not track.entry:
            return
        pieces = tuple(_pieces(track, track.s - length))
        if pieces:
            until = _until(track)
            occupant = _Occupant(pieces, track.speed, length, until, self._time, False, track.standing_time > UNUSED)
            self._hold(vehicle, _junction(pieces[0].lane), occupant)

    def may_enter(self, vehicle: str, track: VehicleTrack, stop_line: float, *, priority: bool, length: float) -> bool:
        """Whether a learned vehicle may pass the line at `stop_line` (m along its path); if it is about to, its way is
        reserved. With `priority` reservations of vehicles that have to yield, and still can, do not count."""
        distance = stop_line - track.s
        pieces = tuple(_pieces(track, stop_line))
        if not pieces:
            return True
        junction = _junction(pieces[0].lane)
        stops, exits = _stops(track, stop_line)
        yields = not priority and distance > track.speed * track.speed / (2.0 * HARD)
        mine = _Occupant(pieces, track.speed, length, stops, self._time, yields, track.standing_time > UNUSED)
        others = {**self._elsewhere(junction), **self._held.get(junction, {})}
        free = all(
            self._passes(mine, other, priority=priority, pauses=stops < exits)
            for name, other in others.items()
            if name != vehicle
        )
        braking = track.speed * track.speed / (2.0 * BRAKING)
        if free and distance <= max(COMMITTED, braking + 0.4 * track.speed):
            # With the lanes that it is on, where it waits inside the junction.
            held = tuple(_pieces(track, track.s - length)) if track.entry else pieces
            self._hold(vehicle, junction, replace(mine, pieces=held))
        return free

    def _hold(self, vehicle: str, junction: str, occupant: _Occupant) -> None:
        self._held.setdefault(junction, {})[vehicle] = occupant
        self._holds.setdefault(vehicle, set()).add(junction)

    def _passes(self, mine: _Occupant, other: _Occupant, *, priority: bool, pauses: bool) -> bool:
        """Whether a vehicle can go to the end of its reservation without meeting an occupant."""
        if self._graph.origin(mine.pieces[0].lane) == self._graph.origin(other.pieces[0].lane):
            return True  # a leader or follower
        for piece in mine.pieces:
            for theirs in other.pieces:
                area = self._areas.between(piece.lane, theirs.lane)
                if area is None:
                    continue
                enter, leave = piece.ahead + area.begin, piece.ahead + area.end
                their_enter, their_leave = theirs.ahead + area.other_begin, theirs.ahead + area.other_end
                if their_leave + other.length <= 0.0 or enter > mine.until:
                    continue  # it has passed, or the area is beyond the waiting position
                if their_enter > other.until:
                    # It will come there later: then the way must be free.
                    if pauses and leave > mine.until - mine.length:
                        return False
                    continue
                if their_enter > 0.0 and (other.idle or (priority and other.yields)):
                    continue  # it goes on after this one, which may be what stops it
                if other.speed < STANDING:
                    return False
                gone = time_to_cover(their_leave + other.length, other.speed, ACCELERATION)
                if gone + GAP > time_to_cover(enter, max(mine.speed, 0.1), ACCELERATION):
                    return False
        return True

    def _elsewhere(self, junction: str) -> dict[str, _Occupant]:
        """The vehicles in a junction that SUMO drives."""
        found = self._others.get(junction)
        if found is None:
            found = self._others[junction] = {}
            for lane in self._lanes.get(junction, ()):
                for vehicle in vehicles_on_lane(self._api, lane):
                    if self._learned(vehicle) is None:
                        speed, position = vehicle_speed(self._api, vehicle), lane_position(self._api, vehicle)
                        piece = _Piece(lane, -position)
                        found[vehicle] = _Occupant(
                            (piece,), speed, USUAL_LENGTH, math.inf, self._time, False, idle=False
                        )
        return found


def _pieces(track: VehicleTrack, begin: float) -> Iterator[_Piece]:
    """The internal lanes of the junction on a path that end after `begin` (m along it), up to its exit."""
    path, start, found = track.path, 0.0, False
    for lane, end in zip(path.lanes, path.ends, strict=True):
        internal = lane.startswith(":")
        if internal and end > begin + 0.1:
            found = True
            yield _Piece(lane, start - track.s)
        elif found and not internal:
            return
        start = end


def _stops(track: VehicleTrack, stop_line: float) -> tuple[float, float]:
    """m from the front to the next waiting position after a line, and to the exit of its junction."""
    exits = next(entry.exit for entry in track.path.entries if entry.stop_line >= stop_line - 1e-6)
    later = [entry.stop_line for entry in track.path.entries if stop_line + 1e-6 < entry.stop_line < exits]
    return min(later, default=exits) - track.s, exits - track.s


def _until(track: VehicleTrack) -> float:
    """m from the front to the next waiting position in the junction where the vehicle is, or to its exit."""
    entries = track.path.entries
    here = next(k for k, entry in enumerate(entries) if entry.via == track.entry)
    later = [entry.stop_line for entry in entries[here + 1 :] if entry.stop_line < entries[here].exit]
    return min(later, default=entries[here].exit) - track.s


def _junction(lane: str) -> str:
    """What the ids of all internal lanes of a junction begin with."""
    return lane.rsplit("_", 2)[0]
