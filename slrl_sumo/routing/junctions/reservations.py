"""Permission to enter a junction, and the order in which vehicles inside a junction wait for each other.

A vehicle enters a junction only if each conflict area on its way is free of foes while the vehicle uses it: either the
vehicle leaves the area before the foe arrives, or the foe leaves it before the vehicle arrives. A vehicle reserves all
conflict areas up to the exit, or up to its next waiting position, at once. Inside the junction, a vehicle waits only
for vehicles that entered before it, so that no circle of waiting vehicles can form.
"""

import math
from collections.abc import Callable, Iterable, Iterator

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.junctions.crossing_occupants import CrossingOccupants
from slrl_sumo.routing.junctions.lines_inside import next_line, stops_inside
from slrl_sumo.routing.junctions.meeting import SharedDistances, meets, stand_off
from slrl_sumo.routing.junctions.occupants import (
    UNUSED,
    BackgroundOccupants,
    Occupant,
    Size,
    lanes_through,
    reserves_from,
)
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry, junction_of
from slrl_sumo.routing.vehicle_track import STOPS_OVER, JunctionBehind, VehicleTrack
from slrl_sumo.scene.route import SignalAspect
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.api import SumoApi

HARD = 3.0
"""Deceleration (m/s²) above which a vehicle no longer yields, because it would have to brake too hard to stop."""
IN_WAY = 10.0
"""Distance (m) ahead of the other vehicle within which an ego vehicle on its path goes first, whatever the order."""


class JunctionReservations:
    """Reservations of the learned vehicles, and the occupants of junctions: background vehicles and pedestrians.

    Call `renew` after each SUMO step.
    """

    def __init__(
        self,
        api: SumoApi,
        graph: LaneGraph,
        learned: Callable[[str], VehicleTrack | None],
        right_of_way: RightOfWay,
    ) -> None:
        """`learned`: returns the track of a learned vehicle by id, None for all other road users."""
        self._learned, self._right_of_way = learned, right_of_way
        self._areas = ConflictAreas(graph)
        self._background = BackgroundOccupants(api, graph, self._areas, learned, right_of_way)
        self._on_foot = CrossingOccupants(api, graph, self._areas)
        self._held: dict[str, dict[str, Occupant]] = {}
        self._holds: dict[str, set[str]] = {}
        """Junctions in which each vehicle holds a reservation."""
        self._free_since: dict[str, float] = {}
        """Times (s) that `free_since` returns."""
        self._met: dict[str, str] = {}
        """The occupant that each vehicle met last on its way through a junction."""
        self._time = 0.0

    def renew(self, world: WorldState) -> None:
        """Drop the data of SUMO's last step, and each reservation that was not renewed since the last call.

        `world`: all road users now.
        """
        self._background.renew(world)
        self._on_foot.renew(world)
        for holders in self._held.values():
            for vehicle in [name for name, one in holders.items() if one.time < self._time - 1e-6]:
                del holders[vehicle]
                self._holds.pop(vehicle, None)
        self._time = world.time

    def forget(self, ids: Iterable[str]) -> None:
        """Drop the waiting times of vehicles that are no longer learned."""
        for vehicle in ids:
            self._free_since.pop(vehicle, None)
            self._met.pop(vehicle, None)

    def occupy(self, vehicle: str, track: VehicleTrack, size: Size) -> float:
        """Replace all reservations of a learned vehicle by the part of the junction that it occupies now.

        Returns the distance (m) from its front to the place inside the junction where it has to wait; inf if it need
        not wait.
        """
        # Search only the junctions in which the vehicle holds a reservation: a city has thousands of junctions.
        for junction in self._holds.pop(vehicle, ()):
            self._held[junction].pop(vehicle, None)
        if track.behind is not None:
            self._hold_behind(vehicle, track, track.behind, size)
        lanes, ahead = lanes_through(track, track.s - size.length) if track.history.entry else ((), ())
        if not lanes:
            return math.inf
        line, until = next_line(track, self._is_red)
        idle, closed = track.history.idle_time > UNUSED, line is not None and self._is_red(line)
        mine = Occupant(
            self._areas.way(lanes), ahead, track.speed, size, until, self._time,
            yields=False, idle=idle, idle_time=track.history.idle_time, entry_time=track.history.entered,
            waits_at_red=closed, needs_turning_room=line is None or until < -STOPS_OVER,
            exit_blocked=self._is_stuck(vehicle),
        )  # fmt: skip
        junction = junction_of(track.history.entry)
        if junction_of(lanes[0]) != junction:
            # The rear of the vehicle is still in the previous junction.
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
            if not areas:
                continue
            # The vehicle must leave an area that it is already in, whatever the order.
            met = [enter for enter in meets(mine, other, areas, until, priority=False, pauses=False) if enter > 0.0]
            if met and not self._in_way(track, size, theirs):
                waits = min(waits, *met)
        self._hold(vehicle, junction, mine)
        # Where the vehicle can no longer stop, the collision scores of its modes decide.
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
        """Whether a learned vehicle may pass the line of an `entry` on its path; reserves its way if it is close.

        With `priority`, reservations of vehicles that must yield and can still stop do not count. A vehicle for which
        it is `too_late` to stop passes in any case; its reservation tells the other vehicles."""
        free = self._reserve(vehicle, track, entry, priority=priority, size=size, too_late=too_late)
        waits = free and track.history.standing_time > 0.0
        if (waits or vehicle in self._free_since) and entry is next(
            line for line in track.path.entries if line.stop_line > track.s - STOPS_OVER
        ):
            if waits:
                self._free_since.setdefault(vehicle, self._time)
            else:
                self._free_since.pop(vehicle)
        return free

    def is_free(self, vehicle: str, track: VehicleTrack, entry: JunctionEntry, *, priority: bool, size: Size) -> bool:
        """Whether a learned vehicle could pass the line of an `entry` on the path of `track`; reserves nothing."""
        through = lanes_through(track, entry.stop_line)
        if not through[0]:
            return True
        passing = self._passing(vehicle, track, entry, through, priority=priority, size=size, too_late=False)
        return passing is not None

    def crossed_until(self, entry: JunctionEntry) -> float:
        """Position (m along the path) from which no other way crosses that of an entry any more; that of the line if
        none does. A vehicle must not stand before it."""
        return min(entry.stop_line + self._areas.crossed_until(entry.via), entry.exit)

    def free_since(self, vehicle: str) -> float:
        """Time (s) since which a vehicle has stood before a line although its way is free of reservations; else inf."""
        return self._free_since.get(vehicle, math.inf)

    def _is_red(self, line: JunctionEntry) -> bool:
        return self._right_of_way.signal(line) == SignalAspect.RED

    def _is_stuck(self, vehicle: str) -> bool:
        return self._time - self.free_since(vehicle) > UNUSED

    def _reserve(
        self, vehicle: str, track: VehicleTrack, entry: JunctionEntry, *, priority: bool, size: Size, too_late: bool
    ) -> bool:
        through = lanes_through(track, entry.stop_line)
        if not through[0]:
            return True
        mine = self._passing(vehicle, track, entry, through, priority=priority, size=size, too_late=too_late)
        if mine is None:
            return False
        if too_late or entry.stop_line - track.s <= reserves_from(track.speed):
            # A vehicle that waits inside the junction also holds the lanes under it.
            if mine.entry_time < math.inf:
                lanes, ahead = lanes_through(track, track.s - size.length)
                mine = mine._replace(way=self._areas.way(lanes), ahead=ahead)
            self._hold(vehicle, junction_of(through[0][0]), mine)
        return True

    def _passing(
        self,
        vehicle: str,
        track: VehicleTrack,
        entry: JunctionEntry,
        through: tuple[tuple[str, ...], tuple[float, ...]],
        *,
        priority: bool,
        size: Size,
        too_late: bool,
    ) -> Occupant | None:
        """The vehicle as an occupant that passes the line of an `entry`; None if its way is not free.

        `through`: see `lanes_through`.
        """
        (lanes, ahead), distance = through, entry.stop_line - track.s
        junction, way = junction_of(lanes[0]), self._areas.way(lanes)
        pause, exits = stops_inside(track, entry)
        # The vehicle stops STOP_LINE before the line; past the line it would block vehicles with priority.
        yields = not priority and distance - STOP_LINE > track.speed * track.speed / (2.0 * HARD)
        idle = track.history.idle_time > UNUSED
        # The vehicle may still be in the previous junction.
        entered = (
            track.history.entered if track.history.entry and junction_of(track.history.entry) == junction else math.inf
        )
        stuck = self._is_stuck(vehicle)
        # Reserve up to the exit if the whole way is free, else up to the next waiting position.
        # A vehicle that cannot stop at this line drives at least to the waiting position, where it may still stop.
        for until in (exits, pause) if pause < exits else (exits,):
            mine = Occupant(
                way, ahead, track.speed, size, until, self._time, yields,
                idle=idle, idle_time=track.history.idle_time, entry_time=entered, exit_blocked=stuck,
                needs_turning_room=until == exits,
            )  # fmt: skip
            if (too_late and until == pause) or self._is_free(vehicle, track, mine, entry, priority, until < exits):
                return mine
        return None

    def _is_free(
        self, vehicle: str, track: VehicleTrack, mine: Occupant, entry: JunctionEntry, priority: bool, pauses: bool
    ) -> bool:
        """Whether a vehicle before an `entry` meets no occupant on its way, as far as `mine` reserves the way.

        `pauses`: whether the reservation ends at a waiting position.
        """

        def met(name: str, other: Occupant) -> bool:
            areas = self._shared(mine, other)
            if not areas:
                return False
            found = meets(mine, other, areas, mine.reserved_until, priority=priority, pauses=pauses)
            return next(found, None) is not None and not self._in_way(track, mine.size, self._learned(name))

        # A standing vehicle meets the same occupant again and again: look at that one first.
        junction, last = junction_of(mine.way.lanes[0]), self._met.get(vehicle, "")
        known = self._on_foot.of(junction).get(last) or self._held.get(junction, {}).get(last)
        if known is not None and met(last, known):
            return False
        for name, other in self._occupants(junction, vehicle, mine, entry):
            if met(name, other):
                self._met[vehicle] = name
                return False
        return True

    def _occupants(
        self, junction: str, vehicle: str, mine: Occupant | None = None, entry: JunctionEntry | None = None
    ) -> Iterator[tuple[str, Occupant]]:
        """The occupants of a junction that count for this vehicle, with their ids.

        `mine`: the vehicle itself as an occupant. `entry`: the entry before which it is; None inside the junction.
        """
        held, on_foot = self._held.get(junction, {}), self._on_foot.of(junction)
        for name, one in self._background.of(junction).items():
            if one.approach_lane and (entry is None or not self._right_of_way.goes_first(one.approach_lane, entry)):
                continue
            if mine is not None and stand_off(mine, one):
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

    def _hold_behind(self, vehicle: str, track: VehicleTrack, behind: JunctionBehind, size: Size) -> None:
        """Reserve the part of the junction in which the rear of a vehicle still is.

        Without it, cars passed rears that stood in the junction at 15 m/s.
        """
        ahead = tuple([begin - track.s for begin in behind.begins])
        rear = Occupant(
            self._areas.way(behind.lanes), ahead, track.speed, size, math.inf, self._time,
            yields=False, idle=False, needs_turning_room=False,
        )  # fmt: skip
        self._hold(vehicle, junction_of(behind.lanes[0]), rear)

    def _in_way(self, track: VehicleTrack, size: Size, other: VehicleTrack | None) -> bool:
        """Whether the ego vehicle is on the path of the `other` vehicle, within IN_WAY ahead: the other one waits."""
        if other is None:
            return False
        line, begin, end = other.path.line, other.s, other.s + IN_WAY
        middle, rear = track.path.line.at(track.s - 0.5 * size.length), track.path.line.at(track.s - size.length)
        for x, y in ((track.x, track.y), middle[:2], rear[:2]):
            s, _, distance = line.place(x, y, begin, end)
            if begin < s and distance < size.width:
                return True
        return False

    def _shared(self, mine: Occupant, other: Occupant) -> list[SharedDistances]:
        """The conflict areas that the ego vehicle shares with another occupant, and that neither of the two has left.

        Leaves out an area into which both ways lead in the same direction, if one of the two road users is wholly past
        its begin and the other one follows.
        """
        way, size, their_way, their_size = mine.way, mine.size, other.way, other.size
        if way.origin == their_way.origin:
            return []  # see ConflictAreas.of_ways
        turns, they_turn = way.turns, their_way.turns
        if other.is_pedestrian:
            turns = they_turn = True
        elif mine.idle and other.idle:
            # Two vehicles that have been idle for long may pass close to each other: if each kept clear of the other
            # one's turning room, both would stand for ever.
            turns = they_turn = False
        apart = mine.half_width(turns=turns) + other.half_width(turns=they_turn)
        # Vehicles that turn side by side need no turning room.
        abreast = size.straight + their_size.straight
        shared: list[SharedDistances] = []
        for i, j, area in self._areas.of_ways(way, their_way, apart, abreast):
            begin, end, their_begin, their_end, together, _ = area
            ahead, their_ahead = mine.ahead[i], other.ahead[j]
            leave, their_leave = ahead + end + size.length, their_ahead + their_end + their_size.length
            if leave <= 0.0 or their_leave <= 0.0:
                continue
            passed, they_passed = -ahead - begin - size.length, -their_ahead - their_begin - their_size.length
            if not (together and (passed > 0.0 or they_passed > 0.0)):
                shared.append((ahead + begin, leave, their_ahead + their_begin, their_leave))
        return shared
