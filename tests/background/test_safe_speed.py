"""Speeds at which vehicles stop, follow or pass in time."""

import numpy as np
import pytest

from slrl_sumo.background.forecast import MOMENTS
from slrl_sumo.background.safe_speed import STOP_SHORT, safe_speeds
from slrl_sumo.scene.geometry import Floats

STEP = 0.4
LIMITS = np.array([[2.6, 4.5, 9.0]])
"""m/s²: acceleration, deceleration, emergency deceleration of SUMO's passenger cars."""


def speed_for(
    enter: Floats,
    speed: float,
    *,
    leading: float = 0.0,
    count: int = len(MOMENTS),
    certain: float = np.inf,
    later: float = 0.0,
) -> tuple[float, bool]:
    """Speed of a vehicle at `speed` for a road user that it touches after `enter` m, (q,), for 6 m, and whether it
    brakes hard."""
    target, hard = safe_speeds(
        enter[None], enter[None] + 6.0, np.full((1, len(MOMENTS)), leading), np.array([count]), np.array([certain]),
        np.array([speed]), LIMITS, STEP, later,
    )  # fmt: skip
    return float(target[0]), bool(hard[0])


def one_speed(enter: float, speed: float) -> tuple[float, bool]:
    """The same for a road user that stands."""
    return speed_for(np.full(len(MOMENTS), enter), speed, count=1)


def stopped_after(enter: float, speed: float, decelerations: list[float] | None = None) -> float:
    """How far a vehicle drives that takes the safe speed of every step (SUMO's way of stepping)."""
    driven = 0.0
    while speed > 0.01:
        following = min(one_speed(enter - driven, speed)[0], speed)
        if decelerations is not None:
            decelerations.append((speed - following) / STEP)
        speed = following
        driven += speed * STEP
    return driven


def test_nothing_in_the_way_sets_no_speed() -> None:
    assert one_speed(np.inf, 10.0) == (np.inf, False)


def test_safe_speeds_stop_short_of_obstacles_and_brake_comfortably_where_there_is_room() -> None:
    decelerations: list[float] = []
    driven = stopped_after(40.0, 13.9, decelerations)
    assert 40.0 - STOP_SHORT - 0.6 < driven <= 40.0 - STOP_SHORT + 1e-6
    assert max(decelerations) <= 4.5 + 1e-6


@pytest.mark.parametrize("gap", [13.0, 17.0, 20.0])
def test_they_brake_harder_only_where_that_is_needed_and_no_harder_than_the_vehicle_can(gap: float) -> None:
    decelerations: list[float] = []
    assert stopped_after(gap, 13.9, decelerations) <= gap
    assert 4.5 < max(decelerations) <= 9.0 + 1e-6


def test_without_room_they_brake_as_hard_as_the_vehicle_can() -> None:
    speed, hard = one_speed(3.0, 13.9)
    assert speed == pytest.approx(13.9 - 9.0 * STEP)
    assert hard


def test_a_leader_that_drives_away_may_be_followed() -> None:
    standing, _ = one_speed(15.0, 10.0)
    behind, _ = speed_for(15.0 + 8.0 * MOMENTS, 10.0, leading=8.0)
    assert standing < behind
    assert speed_for(STOP_SHORT + 8.0 * (STEP + MOMENTS), 8.0, leading=8.0)[0] == pytest.approx(8.0)


def touch(first: float, begin: float, end: float = np.inf) -> Floats:
    """A touch after `first` m from `begin` to `end` s."""
    return np.where((begin <= MOMENTS) & (end >= MOMENTS), first, np.inf)


def test_a_road_user_gone_before_the_vehicle_comes_is_no_reason_to_brake() -> None:
    assert speed_for(touch(30.0, 0.0, 1.0), 5.0)[0] == np.inf
    # ... but a road user that stays is one as soon as the distance asks for it.
    assert speed_for(touch(2.0, 1.0), 5.0)[0] < 5.0


def test_a_road_user_that_comes_after_the_vehicle_is_no_reason_to_brake() -> None:
    # At 10 m/s the rear is past after 0.8 s.
    assert speed_for(touch(2.0, 1.2), 10.0)[0] == np.inf
    assert speed_for(touch(2.0, 1.2), 4.0)[0] < 4.0


def test_braking_is_comfortable_for_what_a_road_user_may_still_not_do() -> None:
    crossing = touch(11.0, 0.8)
    assert speed_for(crossing, 13.0, certain=0.7) == (13.0 - 4.5 * STEP, False)
    speed, hard = speed_for(crossing, 13.0, certain=0.9)
    assert hard
    assert speed < 13.0 - 4.5 * STEP


def test_hard_braking_that_does_not_avoid_a_moving_road_user_is_left_out() -> None:
    # An oncoming one beside the front, which it brushes now: 13 m/s are 3 m short of stopping in any case.
    assert speed_for(touch(0.5, 0.0, 0.0), 13.0, later=STEP)[1] is False
    assert one_speed(0.5, 13.0)[1] is True
