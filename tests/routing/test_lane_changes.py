"""Gaps in the next lane, and speeds that make room for lane changes."""

import math

import numpy as np
import pytest
from builders import make_levels, make_world

from slrl_sumo.routing.lane_changes import LaneChange, cooperative_speeds, faster_there, has_gap, shorter_queue
from slrl_sumo.routing.next_lane import NextLane
from slrl_sumo.routing.polyline import Polyline

DEFAULT_LENGTH = make_world().length.item(0)
STRAIGHT = Polyline([-200.0, 300.0], [3.2, 3.2], [0.0, 500.0])
LEFT = LaneChange(0, -3.2, 0.0, 40.0, NextLane(STRAIGHT, 0.0))
"""The first vehicle of a world, which drives eastwards at y = 0, wants to change to the lane at y = 3.2."""


@pytest.mark.parametrize(("x", "speed", "fits"), [
    (4.0, 10.0, False),  # beside it
    (-7.0, 10.0, True), (-7.0, 16.0, False),  # behind it: as fast, and faster
    (7.0, 10.0, True), (7.0, 4.0, False),  # ahead of it: as fast, and slower
    (-60.0, 30.0, False), (-80.0, 30.0, True),  # 20 m/s faster: 12 m until it brakes, 50 m while it brakes
])  # fmt: skip
def test_a_gap_is_long_enough_for_the_faster_one_to_brake(x: float, speed: float, fits: bool) -> None:
    world = make_world([0.0, x], [0.0, 3.2], speed=[10.0, speed])
    assert has_gap(world, LEFT) is fits


def test_vehicles_behind_are_seen_from_a_ramp_that_is_not_parallel_yet() -> None:
    # 0.3 rad: what is 50 m behind in the next lane is 15 m beside the line of the vehicle's own heading.
    world = make_world([0.0, -50.0], [0.0, 3.2], heading=[0.3, 0.0], speed=[12.0, 33.0])
    assert not has_gap(world, LEFT)


def test_only_vehicles_of_the_next_lane_in_the_same_direction_count() -> None:
    beside = {"other lane": (0.0, -3.2, 0.0), "beyond": (0.0, 6.4, 0.0), "oncoming": (0.0, 3.2, math.pi)}
    for name, (x, y, heading) in beside.items():
        assert has_gap(make_world([0.0, x], [0.0, y], heading=[0.0, heading], speed=10.0), LEFT), name


def test_the_one_behind_the_gap_lets_in_and_the_changing_one_falls_in_behind_the_one_before() -> None:
    world = make_world([0.0, 6.0, -8.0, -30.0], [0.0, 3.2, 3.2, 3.2], speed=10.0)
    allowed = cooperative_speeds(world, 4, [LEFT])
    # Both have less than their headway; neither brakes hard. The others have nothing to do.
    assert allowed[[0, 2]] == pytest.approx(10.0 - 1.5 * 0.8)
    assert np.isinf(allowed[[1, 3]]).all()


@pytest.mark.parametrize(("gap", "waits"), [(0.9, False), (1.1, True)])
def test_a_vehicle_that_stands_too_close_behind_to_make_room_goes_first(gap: float, waits: bool) -> None:
    world = make_world([0.0, -DEFAULT_LENGTH - gap], [0.0, 3.2], speed=0.0)
    allowed = cooperative_speeds(world, 2, [LEFT])
    assert np.isfinite(allowed[1]) == waits
    assert has_gap(world, LEFT) == waits


def test_vehicles_in_a_junction_that_reach_another_lane_do_not_count() -> None:
    world = make_world([0.0, -3.0], [0.0, 2.0], speed=2.0)
    assert not has_gap(world, LEFT)
    assert has_gap(world, LEFT._replace(elsewhere=(1,)))
    assert np.isinf(cooperative_speeds(world, 2, [LEFT._replace(elsewhere=(1,))])).all()


def test_only_learned_vehicles_are_slowed() -> None:
    world = make_world([0.0, 6.0, -8.0], [0.0, 3.2, 3.2], speed=10.0)
    assert len(cooperative_speeds(world, 1, [LEFT])) == 1


def test_nothing_is_done_while_the_end_of_the_lane_is_far() -> None:
    world = make_world([0.0, 6.0, -8.0], [0.0, 3.2, 3.2], speed=10.0)
    assert np.isinf(cooperative_speeds(world, 3, [LEFT._replace(left=101.0)])).all()
    assert np.isfinite(cooperative_speeds(world, 3, [LEFT._replace(left=99.0)])[[0, 2]]).all()


def test_of_two_side_by_side_that_want_each_others_lane_the_one_in_front_goes_first() -> None:
    world = make_world([0.0, 1.0], [0.0, 3.2], speed=0.0)
    allowed = cooperative_speeds(world, 2, [LEFT, LEFT._replace(row=1, lateral_offset=3.2)])
    assert allowed[0] == 0.0
    assert np.isinf(allowed[1])


@pytest.mark.parametrize(("own", "next_one", "faster"), [
    (20.0, None, True), (20.0, 28.0, True), (20.0, 21.0, False), (29.0, None, False), (None, None, False),
])  # fmt: skip
def test_a_vehicle_that_is_held_up_overtakes_on_the_left(
    own: float | None, next_one: float | None, faster: bool
) -> None:
    others = [(60.0, 0.0, own), (80.0, 3.2, next_one), (-20.0, 3.2, 5.0), (120.0, 0.0, 1.0)]
    x, y, speed = zip((0.0, 0.0, 25.0), *(other for other in others if other[2] is not None), strict=True)
    assert faster_there(make_world(list(x), list(y), speed=list(speed)), LEFT, 30.0) is faster


@pytest.mark.parametrize(("here", "there", "left", "changes"), [
    (30.0, None, 60.0, True), (30.0, 45.0, 60.0, True), (30.0, 38.0, 60.0, False), (None, None, 60.0, False),
    (30.0, None, 35.0, False), (8.0, 50.0, 60.0, False),
])  # fmt: skip
def test_a_vehicle_changes_for_a_queue_that_ends_later(
    here: float | None, there: float | None, left: float, changes: bool
) -> None:
    # The one at 20 m in the next lane still moves.
    x, y = zip(*((s, aside) for s, aside in ((0.0, 0.0), (here, 0.0), (there, 3.2)) if s is not None), strict=True)
    world = make_world([*x, 20.0], [*y, 3.2], speed=[8.0, *[0.5] * (len(x) - 1), 6.0])
    assert shorter_queue(world, LEFT, left) is changes


@pytest.mark.parametrize(("there", "back"), [(None, True), (29.5, True), (25.0, False)])
def test_it_goes_back_to_the_right_where_it_is_not_held_up_there(there: float | None, back: bool) -> None:
    world = make_world(
        [0.0] if there is None else [0.0, 70.0], [0.0] if there is None else [0.0, -3.2], speed=there or 9.0
    )
    assert faster_there(world, LEFT._replace(lateral_offset=3.2), 30.0, back=True) is back


@pytest.mark.parametrize(
    ("ahead", "acceleration", "faster"), [(5.0, 0.0, True), (5.0, 2.5, False), (5.0, -1.0, False), (13.0, 0.0, False)]
)
@pytest.mark.parametrize("aside", [-3.2, 3.2])
def test_on_a_street_it_overtakes_to_either_side_what_neither_speeds_up_nor_brakes(
    aside: float, ahead: float, acceleration: float, faster: bool
) -> None:
    world = make_world([0.0, 30.0], [0.0, 0.0], speed=[6.0, ahead], acceleration=[0.0, acceleration])
    assert faster_there(world, LEFT._replace(lateral_offset=aside), 13.9) is faster


def test_a_vehicle_that_changes_to_the_same_lane_from_its_other_side_takes_the_gap() -> None:
    world = make_world([0.0, 3.0], [0.0, 6.4], speed=10.0)
    assert has_gap(world, LEFT)
    assert not has_gap(world, LEFT, [1])


def test_vehicles_on_a_bridge_above_the_lanes_count_neither_as_held_up_nor_as_beside() -> None:
    # Its own lane lies along y = 0; a street crosses at 0.9 rad above the end of the view.
    levels = make_levels()
    turned = levels.level == 2
    levels = levels._replace(
        cos=np.where(turned, math.cos(0.9), levels.cos), sin=np.where(turned, math.sin(0.9), levels.sin)
    )
    change = LEFT
    world = make_world([-4.0, 1.0, 0.0], [0.0, 2.9, 0.0], heading=[0.0, 0.9, 0.9], speed=[10.0, 5.0, 5.0])
    levels = levels._replace(
        x=np.append(levels.x, [0.0, 2.0]), y=np.append(levels.y, [3.2, 3.2]),
        cos=np.append(levels.cos, [1.0, 1.0]), sin=np.append(levels.sin, [0.0, 0.0]),
        level=np.append(levels.level, [1, 1]).astype(np.int8),
    )  # fmt: skip
    order = np.argsort(levels.x, kind="stable")
    levels = levels._replace(**{name: column[order] for name, column in levels._asdict().items()})
    assert not has_gap(world, change)
    assert has_gap(world, change, levels=levels)
    assert np.isfinite(cooperative_speeds(world, 3, [change])).any()
    assert np.isinf(cooperative_speeds(world, 3, [change], levels)).all()
    assert faster_there(world.take(np.array([0, 2])), change, 30.0)
    assert not faster_there(world.take(np.array([0, 2])), change, 30.0, levels)
