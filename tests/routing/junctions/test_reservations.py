"""Conflict areas, and permission to enter a junction, in the shipped scenario `intersection`."""

import math
from collections.abc import Iterator
from dataclasses import replace

import libsumo
import numpy as np
import pytest

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas, half_width
from slrl_sumo.routing.junctions.meeting import is_idle, meets
from slrl_sumo.routing.junctions.occupants import SIDE_GAP, UNUSED, Occupant, Size
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.vehicle_track import JunctionBehind, VehicleTrack
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_track, make_world, with_history

SIZE = Size(5.0, 1.8)
BICYCLE = Size(1.6, 0.65)


@pytest.fixture(scope="module")
def graph() -> Iterator[LaneGraph]:
    with SumoSession(find_scenario("intersection"), seed=1) as session:
        yield LaneGraph(libsumo, session.network)


def track(graph: LaneGraph, start: str, end: str, before: float, speed: float) -> VehicleTrack:
    """A car so many m before the line of the way from one edge to another."""
    lane = next(
        lane.id
        for lane in graph.lanes.values()
        if lane.edge == start
        and any(graph.lanes[target].edge == end for target, _ in graph.links(lane.id))
        and lane.admits("passenger")
    )
    path = graph.path(lane, (end,), "passenger", [])
    return make_track(path, path.entries[0].stop_line - before, speed, (end,))


def inside(graph: LaneGraph, start: str, end: str, beyond: float, speed: float) -> VehicleTrack:
    """A car so many m beyond the line."""
    one = track(graph, start, end, -beyond, speed)
    return with_history(one, entry=one.path.entries[0].via, entered=0.0)


def reserved(graph: LaneGraph, **tracks: VehicleTrack) -> JunctionReservations:
    result = JunctionReservations(libsumo, graph, tracks.get, RightOfWay(libsumo, graph))
    result.renew(world(1.0))
    for name, one in tracks.items():
        result.occupy(name, one, SIZE)
    return result


def world(time: float) -> WorldState:
    return make_world(time=time)


def may(
    reservations: JunctionReservations, name: str, one: VehicleTrack, priority: bool = False, size: Size = SIZE
) -> bool:
    line = next(entry for entry in one.path.entries if entry.stop_line >= one.s)
    return reservations.request_entry(name, one, line, priority=priority, size=size)


def test_areas_are_where_lanes_cross_seen_from_both(graph: LaneGraph) -> None:
    areas = ConflictAreas(graph)
    across, along = (track(graph, a, b, 1.0, 0.0).path.entries[0].via for a, b in (("in0", "out2"), ("in1", "out3")))
    apart = 2.0 * SIZE.turning
    area = areas.between(across, along, apart)
    assert area is not None
    other = areas.between(along, across, apart)
    assert other == (area.other_begin, area.other_end, area.begin, area.end, False, False)
    # They cross at a right angle: the area is as long as both are wide.
    assert 0.0 < area.begin < area.end < graph.lanes[across].length
    assert area.end - area.begin == pytest.approx(2.0 * apart, abs=1.5)
    opposite = track(graph, "in2", "out0", 1.0, 0.0).path.entries[0].via
    assert areas.between(across, opposite, apart) is None


def test_ways_turn_or_lead_straight_on(graph: LaneGraph) -> None:
    areas = ConflictAreas(graph)
    ways = [track(graph, "in0", end, 1.0, 0.0).path.entries[0].via for end in ("out1", "out2", "out3")]
    assert [areas.way((lane,)).turns for lane in ways] == [True, False, True]


def test_one_that_leads_through_the_same_area_is_followed(graph: LaneGraph) -> None:
    reservations = reserved(graph)
    lines = {
        ":centre_a": np.array([[0.0, 0.0], [40.0, 0.0]]),
        ":centre_b": np.array([[0.0, 8.0], [20.0, 1.0], [40.0, 1.0]]),
        ":centre_c": np.array([[20.0, 20.0], [20.0, -20.0]]),
        ":centre_d": np.array([[0.0, 3.0], [40.0, 3.0]]),
        ":centre_e": np.array([[0.0, 1.0], [20.0, 1.0], [24.0, 12.0]]),
    }
    for name, line in lines.items():
        reservations._areas.add_line(name, line)

    def on(lane: str, front: float) -> Occupant:
        way = reservations._areas.way((lane,))
        return Occupant(way, (-front,), 1.0, SIZE, math.inf, 1.0, yields=False, idle=False)

    def meets(other: Occupant) -> bool:
        mine = on(":centre_a", 0.0)
        return bool(reservations._shared(mine, other))

    # b comes nearer than 1.9 m after 18 m: from then on it is a leader when it is past that with its whole length.
    assert meets(on(":centre_b", 20.0))
    assert not meets(on(":centre_b", 26.0))
    # c crosses.
    assert meets(on(":centre_c", 20.0))
    assert meets(on(":centre_c", 22.0))
    # d leads beside it, with more room than two widths.
    assert not meets(on(":centre_d", 10.0))
    # e turns off: until then it is a leader.
    assert not meets(on(":centre_e", 10.0))


@pytest.mark.parametrize(("swings", "until", "waits"), [(True, 2.0, False), (False, 2.0, True), (False, 30.0, False)])
def test_one_that_may_wait_in_an_area_is_not_expected_to_leave_it(
    graph: LaneGraph, swings: bool, until: float, waits: bool
) -> None:
    areas = ConflictAreas(graph)
    areas.add_line(":centre_a", np.array([[0.0, 0.0], [90.0, 0.0]]))
    areas.add_line(":centre_c", np.array([[70.0, 20.0], [70.0, -20.0]]))
    mine = Occupant(areas.way((":centre_a",)), (0.0,), 5.0, SIZE, math.inf, 1.0, yields=False, idle=False)
    # Its front is in the area, and it is past it long before the other one comes, unless it stops at its line.
    other = Occupant(areas.way((":centre_c",)), (-19.0,), 5.0, SIZE, until, 1.0, yields=False, idle=False)
    reservations = reserved(graph)
    reservations._areas = areas
    other = other._replace(needs_turning_room=swings)
    shared = reservations._shared(mine, other)
    assert shared
    assert bool(list(meets(mine, other, shared, math.inf, priority=False, pauses=False))) == waits


def test_areas_are_as_wide_as_the_vehicles(graph: LaneGraph) -> None:
    areas = ConflictAreas(graph)
    across, along = (track(graph, a, b, 1.0, 0.0).path.entries[0].via for a, b in (("in0", "out2"), ("in1", "out3")))
    car, bicycle = SIZE.turning, BICYCLE.turning
    lengths = [
        area.end - area.begin
        for apart in (2.0 * car, car + bicycle, 2.0 * bicycle)
        if (area := areas.between(across, along, apart)) is not None
    ]
    assert len(lengths) == 3
    assert lengths[0] > lengths[1] + 1.0 > lengths[2] + 2.0
    # A bicycle's lane of 1.5 m beside a lane of 3.2 m does not conflict with it all along; a car beside a car just not.
    assert car + bicycle < 0.5 * (1.5 + 3.2)
    assert car + half_width(16.0, 2.6) < 3.21


def test_a_vehicle_waits_for_those_inside_that_are_on_its_way(graph: LaneGraph) -> None:
    waiting = track(graph, "in0", "out2", 2.0, 0.0)
    standing = inside(graph, "in1", "out3", 3.0, 0.0)
    assert not may(reserved(graph, other=standing), "ego", waiting)
    # One that leaves before it arrives does not matter, and neither does one that goes the opposite way.
    leaving = inside(graph, "in1", "out3", 14.0, 9.0)
    assert may(reserved(graph, other=leaving), "ego", waiting)
    assert may(reserved(graph, other=inside(graph, "in2", "out0", 3.0, 0.0)), "ego", waiting)
    # One that has stood outside the area for long does not keep others waiting.
    idle = with_history(inside(graph, "in1", "out3", 0.6, 0.0), idle_time=UNUSED + 1.0)
    assert may(reserved(graph, other=idle), "ego", waiting)


def test_of_two_at_their_lines_one_enters_and_the_other_waits(graph: LaneGraph) -> None:
    first, second = track(graph, "in0", "out2", 2.0, 0.0), track(graph, "in1", "out3", 2.0, 0.0)
    reservations = reserved(graph)
    assert may(reservations, "first", first)
    assert not may(reservations, "second", second)
    # The right of way counts more than a reservation of one that has not entered; then that one waits.
    assert may(reservations, "second", second, priority=True)
    reservations.occupy("first", first, SIZE)
    assert not may(reservations, "first", first)
    # Reservations that are not renewed end.
    reservations.renew(world(1.4))
    reservations.renew(world(1.8))
    assert may(reservations, "first", first)


def test_a_left_turner_that_passes_its_line_too_late_still_waits_inside(graph: LaneGraph) -> None:
    """With its whole way reserved, oncoming traffic braked for it, then both went: five collisions in two runs."""
    left, oncoming = track(graph, "in1", "out0", 1.0, 6.0), track(graph, "in3", "out1", 20.0, 10.0)
    first, second = left.path.entries[:2]
    reservations = reserved(graph)
    assert may(reservations, "oncoming", oncoming, priority=True)
    assert reservations.request_entry("left", left, first, priority=True, size=SIZE, too_late=True)
    assert not reservations.request_entry("left", left, second, priority=False, size=SIZE)
    assert may(reservations, "oncoming", oncoming, priority=True)


def test_a_vehicle_passes_before_one_that_comes_later(graph: LaneGraph) -> None:
    quick = track(graph, "in0", "out2", 2.0, 8.0)
    # It leaves the area after 1.7 s; the others come to it after 1 and after 4 s.
    for before, free in ((8.0, False), (48.0, True)):
        coming = track(graph, "in1", "out3", before, 13.0)
        reservations = reserved(graph)
        assert may(reservations, "coming", coming, priority=True)
        assert may(reservations, "quick", quick) == free


def test_a_vehicle_that_cannot_stop_any_more_reserves_its_way(graph: LaneGraph) -> None:
    fast, waiting = track(graph, "in0", "out2", 24.0, 12.0), track(graph, "in1", "out3", 1.0, 0.0)
    reservations = reserved(graph, other=inside(graph, "in1", "out3", 3.0, 0.0))
    line = fast.path.entries[0]
    assert not reservations.request_entry("fast", fast, line, priority=False, size=SIZE)
    assert may(reservations, "waiting", waiting)
    # It drives on all the same: the next one has to wait for it.
    assert reservations.request_entry("fast", fast, line, priority=False, size=SIZE, too_late=True)
    assert not may(reservations, "waiting", waiting)


def test_one_that_waits_inside_does_not_reserve_what_lies_behind_its_stop(graph: LaneGraph) -> None:
    left = track(graph, "in1", "out0", 0.0, 0.0)
    line = left.path.entries[1].stop_line
    waiting = with_history(replace(left, s=line - 1.2), entry=left.path.entries[0].via, entered=0.0)
    reservations = reserved(graph, waiting=waiting)
    oncoming = track(graph, "in3", "out1", 10.0, 5.0)
    area = ConflictAreas(graph).between(
        oncoming.path.entries[0].via, waiting.history.entry, SIZE.turning + BICYCLE.turning
    )
    assert area is not None
    assert abs(graph.lanes[waiting.history.entry].length - area.other_begin) < 0.9, "it begins near the line"
    assert may(reservations, "oncoming", oncoming, priority=True, size=BICYCLE)
    # Over the line it is in the way of what comes.
    over = with_history(replace(waiting, s=line + 1.0), entry=left.path.entries[1].via)
    assert not may(reserved(graph, waiting=over), "oncoming", oncoming, priority=True, size=BICYCLE)


def test_of_two_that_wait_for_each_other_the_first_goes(graph: LaneGraph) -> None:
    first, second = inside(graph, "in0", "out2", 0.6, 0.0), inside(graph, "in1", "out3", 0.6, 0.0)
    first, second = (
        with_history(first, entered=0.2, idle_time=UNUSED + 1.0),
        with_history(second, entered=0.6, idle_time=UNUSED + 1.0),
    )
    reservations = reserved(graph, first=first, second=second)
    assert reservations.occupy("first", first, SIZE) == math.inf
    assert reservations.occupy("second", second, SIZE) < math.inf
    # One that stands for another reason does not keep those waiting that may go.
    assert reservations.occupy("second", with_history(second, idle_time=0.0), SIZE) == math.inf


def test_of_two_that_stand_never_both_disregard_the_other(graph: LaneGraph) -> None:
    way = ConflictAreas(graph).way((track(graph, "in0", "out2", 2.0, 0.0).path.entries[0].via,))
    one = Occupant(way, (0.0,), 0.0, SIZE, math.inf, 1.0, yields=False, idle=True)
    every = [
        one._replace(idle=stood > UNUSED, idle_time=stood, entry_time=entered, exit_blocked=stuck)
        for stood in (0.0, 4.0, 9.0)
        for entered in (0.5, 0.7, math.inf)
        for stuck in (False, True)
    ]
    for first in every:
        for second in every:
            same = (first.idle_time, first.entry_time, first.exit_blocked) == (
                second.idle_time,
                second.entry_time,
                second.exit_blocked,
            )
            assert same or not (is_idle(first, second) and is_idle(second, first))


@pytest.mark.parametrize(("on_foot", "stood", "enter", "waits"), [
    (True, 4.0, -1.0, False), (True, 0.0, -1.0, True), (True, 4.0, 1.0, True), (False, 4.0, -1.0, True),
])  # fmt: skip
def test_a_person_that_stands_beside_a_car_on_a_crossing_does_not_keep_it_there(
    graph: LaneGraph, on_foot: bool, stood: float, enter: float, waits: bool
) -> None:
    way = ConflictAreas(graph).way((track(graph, "in0", "out2", 2.0, 0.0).path.entries[0].via,))
    mine = Occupant(way, (0.0,), 0.0, SIZE, math.inf, 1.0, yields=False, idle=True, entry_time=0.5, idle_time=9.0)
    other = mine._replace(is_pedestrian=on_foot, idle=stood > UNUSED, idle_time=stood, entry_time=math.inf)
    shared = [(enter, enter + 5.0, -0.5, 3.0)]
    assert bool(list(meets(mine, other, shared, math.inf, priority=False, pauses=False))) is waits


def test_one_that_could_have_gone_does_not_keep_others_waiting(graph: LaneGraph) -> None:
    first, second = (inside(graph, *way, 0.6, 0.0) for way in (("in0", "out2"), ("in1", "out3")))
    first, second = (
        with_history(one, entered=entered, idle_time=UNUSED + 1.0) for one, entered in ((first, 0.2), (second, 0.6))
    )
    for known, waits in (((), True), (("first",), False), (("first", "second"), True)):  # not that both go at once
        tracks = {"first": first, "second": second}
        reservations = JunctionReservations(libsumo, graph, tracks.get, RightOfWay(libsumo, graph))
        for ago, name in zip((0.9, 0.5), known, strict=False):
            stand_before_the_line(reservations, name, graph, 1.0 - UNUSED - ago)
        reservations.renew(world(1.0))
        reservations.occupy("first", first, SIZE)
        assert (reservations.occupy("second", second, SIZE) < math.inf) is waits


def stand_before_the_line(reservations: JunctionReservations, name: str, graph: LaneGraph, time: float) -> None:
    """Let a vehicle stand before an open line at a time, when nothing else is reserved."""
    ways = {"first": ("in0", "out2"), "second": ("in1", "out3")}
    stands = with_history(track(graph, *ways[name], 1.0, 0.0), standing_time=5.0)
    for _ in range(2):
        reservations.renew(world(time))
        time += 0.1
    assert may(reservations, name, stands)


def test_since_when_a_vehicle_could_go_is_noted(graph: LaneGraph) -> None:
    stands = with_history(track(graph, "in0", "out2", 1.0, 0.0), standing_time=5.0)
    reservations = reserved(graph)
    for time in (1.0, 2.0):
        reservations.renew(world(time))
        assert may(reservations, "ego", stands)
        assert reservations.free_since("ego") == 1.0
    assert may(reservations, "ego", with_history(stands, standing_time=0.0))
    assert reservations.free_since("ego") == math.inf
    assert may(reservations, "ego", stands)
    reservations.forget(["ego"])
    assert reservations.free_since("ego") == math.inf
    crossed = reserved(graph, other=inside(graph, "in1", "out3", 3.0, 0.0))
    assert not may(crossed, "ego", stands)
    assert crossed.free_since("ego") == math.inf


def test_one_outside_does_not_keep_one_waiting_inside_with_equal_rights(graph: LaneGraph) -> None:
    left = track(graph, "in1", "out0", 0.0, 0.0)
    assert len(left.path.entries) == 2
    waiting = with_history(
        replace(left, s=left.path.entries[1].stop_line - 1.0), entry=left.path.entries[0].via, entered=0.0
    )
    minor = track(graph, "in0", "out2", 1.0, 0.0)
    assert not may(reserved(graph, waiting=waiting), "minor", minor)
    # When it entered the junction before does not count.
    assert not may(reserved(graph, waiting=waiting), "minor", with_history(minor, entry=":before_0_0", entered=-1.0))
    assert may(reserved(graph), "minor", minor)


def test_inside_a_vehicle_stops_before_the_way_of_one_that_entered_earlier(graph: LaneGraph) -> None:
    first, second = inside(graph, "in0", "out2", 0.6, 0.0), inside(graph, "in1", "out3", 0.6, 2.0)
    first, second = with_history(first, entered=0.2), with_history(second, entered=0.6)
    reservations = reserved(graph, first=first, second=second)
    area = ConflictAreas(graph).between(second.history.entry, first.history.entry, SIZE.width + SIDE_GAP)
    assert area is not None
    assert reservations.occupy("second", second, SIZE) == pytest.approx(area.begin - 0.6)
    assert reservations.occupy("first", first, SIZE) == math.inf
    # Too fast to stop, it goes on, and so does one that stands in the area already.
    assert reservations.occupy("second", replace(second, speed=9.0), SIZE) == math.inf
    assert reservations.occupy("second", replace(second, s=second.s + area.begin), SIZE) == math.inf


def test_one_that_stands_on_the_path_of_another_one_goes_first(graph: LaneGraph) -> None:
    ahead, behind = track(graph, "in0", "out2", 1.0, 0.0), inside(graph, "in1", "out3", 1.0, 0.0)
    reservations = reserved(graph, behind=behind)
    assert not may(reservations, "ahead", ahead)
    x, y, _ = behind.path.line.at(behind.s + 3.0)
    assert may(reservations, "ahead", replace(ahead, x=x, y=y))
    # Also with its rear alone.
    area = ConflictAreas(graph).between(ahead.path.entries[0].via, behind.path.entries[0].via, SIZE.width)
    assert area is not None
    for beyond, in_way in ((-3.0, False), (area.end + 1.0, True), (area.end + SIZE.length + 1.0, False)):
        front = inside(graph, "in0", "out2", beyond, 0.0)
        x, y, _ = front.path.line.at(front.s)
        assert reservations._in_way(replace(front, x=x, y=y), SIZE, behind) == in_way


def test_far_away_nothing_is_reserved(graph: LaneGraph) -> None:
    reservations = reserved(graph)
    assert may(reservations, "far", track(graph, "in0", "out2", 40.0, 5.0))
    assert may(reservations, "second", track(graph, "in1", "out3", 2.0, 0.0))
    # Too fast to stop comfortably, it needs its way from farther off.
    reservations = reserved(graph)
    assert may(reservations, "fast", track(graph, "in0", "out2", 40.0, 13.0))
    assert not may(reservations, "second", track(graph, "in1", "out3", 2.0, 0.0))


def test_vehicles_one_behind_the_other_do_not_wait_for_each_other(graph: LaneGraph) -> None:
    leader, follower = inside(graph, "in0", "out2", 3.0, 0.0), track(graph, "in0", "out2", 2.0, 0.0)
    assert may(reserved(graph, leader=leader), "follower", follower)
    assert math.isinf(follower.history.entered)


def test_two_that_have_stood_for_long_pass_each_other_with_less_room(graph: LaneGraph) -> None:
    left, other = track(graph, "in1", "out0", 0.0, 0.0), track(graph, "in3", "out1", 0.0, 0.0)
    waiting = with_history(
        replace(left, s=left.path.entries[1].stop_line - 1.0), entry=left.path.entries[0].via, entered=0.0
    )
    ways = left.path.entries[1].via, other.path.entries[0].via
    wide, close = (
        area.other_begin
        for apart in (SIZE.turning + 0.5 * (SIZE.width + SIDE_GAP), SIZE.width + SIDE_GAP)
        if (area := ConflictAreas(graph).between(*ways, apart))
    )
    assert close - wide > 0.3
    goes_on = inside(graph, "in3", "out1", 0.5 * (wide + close), 0.0)
    assert not may(reserved(graph, waiting=waiting, other=goes_on), "waiting", waiting)
    stands, waited = (with_history(one, idle_time=UNUSED + 1.0) for one in (goes_on, waiting))
    assert not may(reserved(graph, waiting=waiting, other=stands), "waiting", waiting)
    assert may(reserved(graph, waiting=waited, other=stands), "waiting", waited)


def test_the_rear_of_a_vehicle_keeps_its_place_in_the_junction_that_its_front_has_left(graph: LaneGraph) -> None:
    """The path of a vehicle begins anew on each edge; others passed its rear at 15 m/s."""
    before = track(graph, "in0", "out2", 0.0, 0.0).path
    entry, here = before.entries[0], before.lanes.index(before.entries[0].target)
    follows = graph.path(entry.target, (), "passenger", [before.line.at(before.ends[here - 1] - 7.0)[:2]])
    begin, _ = follows.line.nearest(*graph.lanes[entry.target].points[0])
    one, cross = make_track(follows, begin + 0.5, 0.0, ()), track(graph, "in1", "out3", 1.0, 8.0)
    inside = before.lanes[1:here]
    starts = tuple(start + begin - before.ends[here - 1] for start in before.begins[1:here])
    for behind, s, free in (
        (None, 0.5, True),
        (JunctionBehind(inside, starts, begin), 0.5, False),
        (JunctionBehind(inside, starts, begin), 5.0, True),
    ):
        reservations = reserved(graph)
        reservations.occupy("one", replace(one, behind=behind, s=begin + s), Size(8.0, 1.8))
        assert may(reservations, "cross", cross) is free
