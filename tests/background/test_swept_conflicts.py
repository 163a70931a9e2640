"""Where swept boxes meet other road users."""

from typing import Any

import numpy as np
import pytest
from builders import make_levels, make_world

from slrl_sumo.background.forecast import MOMENTS, forecast
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.swept_boxes import Sweep, sweep
from slrl_sumo.background.swept_conflicts import approaching, conflicts, cosine_at_touch, speed_along, touched
from slrl_sumo.scene.levels import FLAT
from slrl_sumo.scene.state import WorldState

ONE = np.array([0])
MARGIN = 0.3
SIZE = np.array([[5.0, 1.8]])


def road_user(x: float, y: float, heading: float = 0.0, speed: float = 0.0, **changes: float) -> WorldState:
    return make_world(x, y, heading, speed, **{"type": 2, "length": 0.4, "width": 0.4, "ids": ("learned",), **changes})


def straight_on() -> Sweep:
    """A car whose front is at the origin, facing east, 40 m of way ahead."""
    s = np.linspace(0.0, 40.0, 81)
    zero = np.zeros(1)
    return sweep(s[None], 0.0 * s[None], np.array([100.0]), zero, zero, zero, SIZE)


def met(user: WorldState, margin: float = 0.0) -> tuple[Any, Any]:
    boxes, count, _ = forecast(user)
    enter, leave = conflicts(straight_on(), ONE, boxes, ONE, count, np.array([margin]))
    return enter[0], leave[0]


def test_a_road_user_standing_ahead_is_met_at_its_near_side_and_left_when_the_rear_is_past() -> None:
    enter, leave = met(road_user(20.0, 0.0))
    assert enter[0] == pytest.approx(19.8, abs=SPACING)
    assert leave[0] == pytest.approx(25.2, abs=SPACING)
    assert np.isinf(enter[1:]).all()


@pytest.mark.parametrize("beside", [0.9 + 0.2 + MARGIN - 0.05, 0.9 + 0.2 + MARGIN + 0.05])
def test_a_margin_is_kept_on_either_side_and_no_more(beside: float) -> None:
    for side in (beside, -beside):
        enter, _ = met(road_user(20.0, side), MARGIN)
        assert np.isfinite(enter[0]) == (beside < 0.9 + 0.2 + MARGIN)


def test_a_road_user_that_is_being_passed_is_no_reason_to_stop() -> None:
    assert np.isinf(met(road_user(-2.0, 1.2))[0]).all()
    # ... not even when it walks into the vehicle's side.
    assert np.isinf(met(road_user(-2.0, 1.6, -np.pi / 2, 0.7))[0]).all()
    # Behind the vehicle is nothing to meet.
    assert np.isinf(met(road_user(-8.0, 0.0))[0]).all()


def test_a_road_user_right_in_front_is_met_at_once() -> None:
    assert met(road_user(0.1, 0.0))[0][0] == 0.0


def test_a_pedestrian_walking_towards_the_path_is_met_when_it_will_be_there() -> None:
    enter, _ = met(road_user(20.0, -2.5, np.pi / 2, 1.3))
    # 1.4 m lie between both boxes.
    there = (MOMENTS > 1.4 / 1.3) & (MOMENTS <= 1.5)
    assert np.isinf(enter[~there]).all()
    assert enter[there] == pytest.approx(19.8, abs=SPACING)


def test_a_road_user_that_comes_from_behind_is_no_reason_to_stop() -> None:
    enter, _ = met(road_user(-15.0, 0.0, 0.0, 14.0, type=0, length=5.0, width=1.8))
    assert np.isinf(enter).all()


def test_in_a_right_turn_the_way_meets_a_cyclist_beside_it() -> None:
    radius = 8.0
    angle = np.minimum(SPACING * np.arange(60) / radius, np.pi / 2)
    after = np.maximum(SPACING * np.arange(60) - radius * np.pi / 2, 0.0)
    zero = np.zeros(1)
    turning = sweep(
        (radius * np.sin(angle))[None], (-radius * (1 - np.cos(angle)) - after)[None], np.array([100.0]),
        zero, zero, zero, SIZE,
    )  # fmt: skip
    cyclist = road_user(-3.0, -2.4, 0.0, 6.0, length=1.6, width=0.6)
    boxes, count, _ = forecast(cyclist)
    enter, _ = conflicts(turning, ONE, boxes, ONE, count, np.zeros(1))
    assert np.isfinite(enter[0, 1:]).any()
    assert np.isinf(met(cyclist)[0]).all()


@pytest.mark.parametrize(
    ("heading", "along"), [(0.0, 3.0), (np.pi / 4, 3.0 * np.sqrt(0.5)), (1.1, 0.0), (np.pi / 2, 0.0), (np.pi, 0.0)]
)
def test_speed_along_the_way_is_that_of_road_users_that_lead(heading: float, along: float) -> None:
    user = road_user(20.0, 0.0, heading, 3.0)
    enter = np.where(MOMENTS == 0.0, 19.5, np.inf)[None]
    cosine = cosine_at_touch(straight_on(), ONE, touched(enter), forecast(user).boxes, ONE)
    speed = speed_along(cosine, user.speed[ONE])
    assert speed[0, 0] == pytest.approx(along, abs=1e-9)


def test_the_quick_look_leaves_out_only_road_users_far_from_the_path() -> None:
    s = np.linspace(0.0, 40.0, 81)
    path_x, path_y = np.stack([s, s]), np.stack([0.0 * s, 0.0 * s + 500.0])
    boxes = forecast(road_user(20.0, 0.0)).boxes
    both = np.array([0, 1])
    coming = approaching(path_x, path_y, np.repeat(SIZE, 2, axis=0), both, boxes, np.array([0, 0]), MARGIN)
    assert coming.tolist() == [True, False]


@pytest.mark.parametrize("length", [-3.0, 0.0, 60.0, 1e300])
def test_vehicles_of_any_length_are_straight_on_a_straight_way(length: float) -> None:
    s = np.linspace(0.0, 40.0, 81)[None]
    size, zero, three = np.array([[length, 1.8]]), np.zeros(1), np.full(1, 3.0)
    ahead = sweep(s, 0.0 * s + 3.0, np.full(1, 100.0), zero, three, zero, size)
    assert ahead.heading == pytest.approx(0.0)
    assert ahead.width == pytest.approx(1.8)


def test_a_road_user_on_a_bridge_above_the_path_is_not_met() -> None:
    # The bridge crosses 20 m ahead of the front.
    levels = make_levels()
    levels = levels._replace(x=levels.x + 20.0)
    for user, meets in (
        (road_user(20.0, 0.0, np.pi / 2, length=5.0, width=1.8), False),
        (road_user(20.0, -12.0, np.pi / 2, 8.0, length=5.0, width=1.8), False),
        (road_user(20.0, 0.0, 0.0, length=5.0, width=1.8), True),
    ):
        boxes, count, _ = forecast(user)
        for ground, met_there in ((FLAT, True), (levels, meets)):
            enter, _ = conflicts(straight_on(), ONE, boxes, ONE, count, np.zeros(1), ground)
            assert np.isfinite(enter).any() == met_there
