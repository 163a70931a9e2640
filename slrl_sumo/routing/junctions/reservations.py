"""Which vehicle may enter a junction next, and where those inside wait for each other.

A vehicle enters a junction only when it meets no other one in a conflict area on its way: each of the two has left the
area before the other one comes. All areas up to the exit, or to the next waiting position, are reserved at once.
Inside, a vehicle waits only for those that entered before it, so that vehicles never wait for each other in a circle.
"""

import math
from collections.abc import Callable, Iterable, Iterator

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.junctions.crossing_occupants import CrossingOccupants
from slrl_sumo.routing.junctions.occupants import (
    UNUSED,
    BackgroundOccupants,
    Occupant,
    Size,
    lanes_through,
    reserves_from,
)
from slrl_sumo.routing.junctions.right_of_way import RightOfWay, time_to_cover
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry, junction_of
from slrl_sumo.routing.vehicle_track import STOPS_OVER, VehicleTrack
from slrl_sumo.scene.route import SignalAspect
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.api import SumoApi

STANDING = 1.0
"""m/s: a slower vehicle in a conflict area is not expected to leave it in time."""
GAP = 0.5
"""s between two vehicles in a conflict area."""
SLOWEST = 0.1
"""m/s: one that stands will start."""
HARD = 3.0
"""m/s²: a vehicle that would have to brake harder to stop no longer yields."""
IN_WAY = 10.0
"""m ahead of a vehicle within which another one on its path goes first, whatever the order."""

_Shared = tuple[float, float, float, float]
"""m from the front of a vehicle to the begin of a conflict area, and until its rear has left it; the same of the other
road user."""


class JunctionReservations:
    """Reservations of the learned vehicles, and the places of all others, pedestrians on crossings among them.

    Call `renew` after each SUMO step.
    """

    def __init__(
        self,
        api: SumoApi,
        graph: LaneGraph,
        learned: Callable[[str], VehicleTrack | None],
        right_of_way: RightOfWay,
    ) -> None:
        """`learned` gives the track of a learned vehicle by id, None for all others."""
        self._learned, self._right_of_way = learned, right_of_way
        self._areas = ConflictAreas(graph)
        self._background = BackgroundOccupants(api, graph, self._areas, learned, right_of_way)
        self._on_foot = CrossingOccupants(api, graph, self._areas)
        self._held: dict[str, dict[str, Occupant]] = {}
        self._holds: dict[str, set[str]] = {}
        """The junctions in which each vehicle holds something."""
        self._free_since: dict[str, float] = {}
        """See `free_since`."""
        self._time = 0.0

    def renew(self, world: WorldState) -> None:
        """Forget what was read of SUMO's last step, and reservations that were not renewed since; `world`: all road
        users now."""
        self._background.renew(world)
        self._on_foot.renew(world)
        for holders in self._held.values():
            for vehicle in [name for name, one in holders.items() if one.time < self._time - 1e-6]:
                del holders[vehicle]
                self._holds.pop(vehicle, None)
        self._time = world.time

    def forget(self, ids: Iterable[str]) -> None:
        """Drop what is known of vehicles that are no longer learned."""
        for vehicle in ids:
            self._free_since.pop(vehicle, None)

    def occupy(self, vehicle: str, track: VehicleTrack, size: Size) -> float:
        """Renew what a learned vehicle of this size occupies; reservations for entries end here.

        Returns m from its front to where it has to wait inside the junction, inf where it does not.
        """
        # Not a look at every junction: a city has thousands, for each of its vehicles.
        for junction in self._holds.pop(vehicle, ()):
            self._held[junction].pop(vehicle, None)
        lanes, ahead = lanes_through(track, track.s - size.length) if track.history.entry else ((), ())
        if not lanes:
            return math.inf
        line, until = _next_line(track)
        idle, closed = (
            track.history.idle_time > UNUSED,
            line is not None and self._right_of_way.signal(line) == SignalAspect.RED,
        )
        mine = Occupant(
            self._areas.way(lanes), ahead, track.speed, size, until, self._time,
            yields=False, idle=idle, idle_time=track.history.idle_time, entry_time=track.history.entered,
            waits_at_red=closed, needs_turning_room=line is None or until < -STOPS_OVER,
            exit_blocked=self._is_stuck(vehicle),
        )  # fmt: skip
        junction = junction_of(track.history.entry)
        if junction_of(lanes[0]) != junction:
            # Its rear is still in the junction before, which it leaves.
            self._hold(
                vehicle,
                junction_of(lanes[0]),
                mine._replace(reserved_until=math.inf, waits_at_red=False, needs_turning_room=True),
            )
            passed = (
                e.stop_line
                for e in track.path.entries
                if e.via == track.history.entry and e.stop_line < track.s + STOPS_OVER
            )
            lanes, ahead = lanes_through(track, max(passed))
            mine = mine._replace(way=self._areas.way(lanes), ahead=ahead)
        waits = math.inf
        for name, other in self._occupants(junction, vehicle, mine):
            theirs = self._learned(name)
            if theirs is not None and (theirs.history.entered, name) >= (track.history.entered, vehicle):
                continue
            areas = self._shared(mine, other)
            if areas and not self._in_way(track, size, theirs):
                # An area in which it is already has to be cleared, whatever the order.
                met = _meets(mine, other, areas, until, priority=False, pauses=False)
                waits = min(waits, min((enter for enter in met if enter > 0.0), default=math.inf))
        self._hold(vehicle, junction, mine)
        # What it cannot stop for any more is left to the collisions of its modes.
        return waits if waits > track.speed * track.speed / (2.0 * HARD) else math.inf

    def request_entry(
        self,
        vehicle: str,
        track: VehicleTrack,
        entry: JunctionEntry,
        *,
        priority: bool,
        size: Size,
        too_late: bool = False,
    ) -> bool:
        """Whether a learned vehicle may pass the line of an `entry` on its path; if it is about to, reserve its way.

        With `priority` reservations of vehicles that have to yield, and still can, do not count. A vehicle for which it
        is `too_late` to stop passes in any case, and the others have to know."""
        free = self._reserve(vehicle, track, entry, priority=priority, size=size, too_late=too_late)
        if entry is next(line for line in track.path.entries if line.stop_line > track.s - STOPS_OVER):
            if free and track.history.standing_time > 0.0:
                self._free_since.setdefault(vehicle, self._time)
            else:
                self._free_since.pop(vehicle, None)
        return free

    def is_crossed(self, entry: JunctionEntry) -> bool:
        """Whether others cross the way that begins at an entry, so that a vehicle must not stand on it."""
        return self._areas.is_crossed(entry.via)

    def free_since(self, vehicle: str) -> float:
        """Time (s) since which a vehicle has stood before a line although nothing reserved is in its way, else inf."""
        return self._free_since.get(vehicle, math.inf)

    def _is_stuck(self, vehicle: str) -> bool:
        return self._time - self.free_since(vehicle) > UNUSED

    def _reserve(
        self, vehicle: str, track: VehicleTrack, entry: JunctionEntry, *, priority: bool, size: Size, too_late: bool
    ) -> bool:
        distance = entry.stop_line - track.s
        lanes, ahead = lanes_through(track, entry.stop_line)
        if not lanes:
            return True
        junction, way = junction_of(lanes[0]), self._areas.way(lanes)
        pause, exits = stops_inside(track, entry)
        # Where it would stop, not at the line: over that it stands in the way of vehicles that go first.
        yields = not priority and distance - STOP_LINE > track.speed * track.speed / (2.0 * HARD)
        idle = track.history.idle_time > UNUSED
        # One may still be in the junction before.
        entered = (
            track.history.entered if track.history.entry and junction_of(track.history.entry) == junction else math.inf
        )
        stuck = self._is_stuck(vehicle)
        mine = Occupant(
            way, ahead, track.speed, size, exits, self._time, yields,
            idle=idle, idle_time=track.history.idle_time, entry_time=entered, exit_blocked=stuck,
        )  # fmt: skip
        # To the exit where all of the way is free, else to the next waiting position.
        # One that cannot stop at this line goes on at least to the waiting position, which it may still stop at.
        for until in sorted({exits, pause}, reverse=True):
            mine = mine._replace(reserved_until=until, needs_turning_room=until == exits)
            free = (too_late and until == pause) or not any(
                next(_meets(mine, other, areas, until, priority=priority, pauses=until < exits), None) is not None
                for name, other in self._occupants(junction, vehicle, mine, entry)
                if (areas := self._shared(mine, other)) and not self._in_way(track, size, self._learned(name))
            )
            if free:
                if too_late or distance <= reserves_from(track.speed):
                    # With the lanes that it is on, where it waits inside the junction.
                    if entered < math.inf:
                        lanes, ahead = lanes_through(track, track.s - size.length)
                    self._hold(vehicle, junction, mine._replace(way=self._areas.way(lanes), ahead=ahead))
                return True
        return False

    def _occupants(
        self, junction: str, vehicle: str, mine: Occupant | None = None, entry: JunctionEntry | None = None
    ) -> Iterator[tuple[str, Occupant]]:
        """All occupants of a junction that count for this vehicle at an `entry`, or inside, by id; `mine`: what it
        occupies itself."""
        held, on_foot = self._held.get(junction, {}), self._on_foot.of(junction)
        for name, one in self._background.of(junction).items():
            if one.approach_lane and (entry is None or not self._right_of_way.goes_first(one.approach_lane, entry)):
                continue
            if mine is not None and _stand_off(mine, one):
                continue
            if name != vehicle and name not in held and name not in on_foot:
                yield name, one
        yield from on_foot.items()
        for name, one in held.items():
            if name != vehicle:
                yield name, one

    def _hold(self, vehicle: str, junction: str, occupant: Occupant) -> None:
        self._held.setdefault(junction, {})[vehicle] = occupant
        self._holds.setdefault(vehicle, set()).add(junction)

    def _in_way(self, track: VehicleTrack, size: Size, other: VehicleTrack | None) -> bool:
        """Whether a vehicle is on the path of another one, just ahead of it, so that the other one waits for it."""
        if other is None:
            return False
        middle, rear = (track.path.line.at(track.s - share * size.length)[:2] for share in (0.5, 1.0))
        for x, y in ((track.x, track.y), middle, rear):
            s, _, distance = other.path.line.place(x, y, other.s, other.s + IN_WAY)
            if other.s < s and distance < size.width:
                return True
        return False

    def _shared(self, mine: Occupant, other: Occupant) -> list[_Shared]:
        """The conflict areas that a vehicle shares with another occupant, and that neither of the two has left; none
        with a leader or follower, such as one that is wholly in an area through which both lead together."""
        # Two that have stood for long pass close to each other: in the room for each other's turn they stand for ever.
        narrow, wide = mine.idle and other.idle, other.is_pedestrian
        apart = mine.half_width(turns=wide or (not narrow and mine.way.turns))
        apart += other.half_width(turns=wide or (not narrow and other.way.turns))
        # Neither of two that turn side by side needs room for its turn.
        abreast = mine.half_width(turns=False) + other.half_width(turns=False)
        shared = []
        for i, j, area in self._areas.of_ways(mine.way, other.way, apart, abreast):
            ahead, their_ahead = mine.ahead[i], other.ahead[j]
            leave = ahead + area.end + mine.size.length
            their_leave = their_ahead + area.other_end + other.size.length
            passed = max(-ahead - area.begin - mine.size.length, -their_ahead - area.other_begin - other.size.length)
            if area.together and passed > 0.0:
                continue
            if leave > 0.0 and their_leave > 0.0:
                shared.append((ahead + area.begin, leave, their_ahead + area.other_begin, their_leave))
        return shared


def _meets(
    mine: Occupant, other: Occupant, areas: list[_Shared], until: float, *, priority: bool, pauses: bool
) -> Iterator[float]:
    """m from the front of a vehicle to each of the shared `areas` in which it meets an occupant, if its reservation
    ends after `until` (m)."""
    for enter, leave, their_enter, their_leave in areas:
        if enter > until:
            continue  # beyond the waiting position
        if their_enter > other.reserved_until:
            # It will come there later. Then the way must be free; and with equal rights one outside the junction
            # does not go before one that waits inside, else it would wait for ever.
            first = not priority and not other.waits_at_red and other.entry_time < mine.entry_time == math.inf
            if first or (pauses and leave > until):
                yield enter
        elif (their_enter > 0.0 or (other.is_pedestrian and enter < 0.0)) and (
            _is_idle(other, mine) or (priority and other.yields)
        ):
            continue  # it goes on after this one, which may be what stops it; also a person beside it on a crossing
        elif not (
            _before(mine, leave, other, their_enter)
            or (_goes_on(other, their_leave) and _before(other, their_leave, mine, enter))
        ):
            yield enter


def _stand_off(inside: Occupant, background: Occupant) -> bool:
    """Whether a vehicle inside a junction and one of SUMO's have stood so long that they wait for each other: SUMO's
    stays 0.1 m before its leader in the junction, so that only the other one can go, where it does not touch it."""
    return inside.idle and inside.entry_time < math.inf and background.idle and not background.is_pedestrian


def _goes_on(one: Occupant, leave: float) -> bool:
    """Whether a road user is expected to leave a conflict area, `leave` m on: it does not stop in it, or wait there."""
    pauses = not one.needs_turning_room and leave > one.reserved_until
    return not (one.may_be_stopped or pauses or one.speed < STANDING)


def _is_idle(one: Occupant, other: Occupant) -> bool:
    """Whether a vehicle has stood for so long that another one need not wait for it. Of two that wait for each other,
    only one goes: the one that is not stuck, else the one that entered the junction first, or has stood for longer."""
    if one.exit_blocked != other.exit_blocked:
        return one.exit_blocked
    return one.idle and not (other.idle and (one.entry_time, -one.idle_time) < (other.entry_time, -other.idle_time))


def _before(one: Occupant, leave: float, other: Occupant, enter: float) -> bool:
    """Whether a road user leaves a conflict area before another one enters it; distances in m."""
    comes = time_to_cover(enter, max(other.speed, SLOWEST), other.acceleration)
    return enter > 0.0 and _time_to_leave(one, leave) + GAP < comes


def _time_to_leave(one: Occupant, leave: float) -> float:
    """s until a road user has covered `leave` m, on its way through the junction at no more than the pace of that: cars
    that turned around came at 6.9 m/s, and seemed to be gone in 2.3 s, but needed 5 s."""
    pace = max(one.way.pace, STANDING)
    if one.speed > pace:
        before = min(max(one.ahead[0], 0.0), leave) if one.ahead else 0.0
        return before / (0.5 * (one.speed + pace)) + (leave - before) / pace
    faster = (pace * pace - one.speed * one.speed) / (2.0 * one.acceleration)
    if leave <= faster:
        return time_to_cover(leave, one.speed, one.acceleration)
    return (pace - one.speed) / one.acceleration + (leave - faster) / pace


def stops_inside(track: VehicleTrack, entry: JunctionEntry) -> tuple[float, float]:
    """m from the front to the next waiting position after a line (the exit where there is none), and to the exit of its
    junction."""
    return min(entry.waits - STOP_LINE, entry.exit) - track.s, entry.exit - track.s


def _next_line(track: VehicleTrack) -> tuple[JunctionEntry | None, float]:
    """The next waiting position in the junction where the vehicle is, and m from its front to it, or to the exit."""
    entries = track.path.entries
    here = next(k for k, entry in enumerate(entries) if entry.via == track.history.entry)
    for entry in entries[here + 1 :]:
        if entry.stop_line < entries[here].exit:
            return entry, entry.stop_line - STOP_LINE - track.s
    return None, entries[here].exit - track.s
