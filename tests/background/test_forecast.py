"""Where learned road users will be."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.background.forecast import FORECAST_HORIZON, MOMENTS, MOTION_HORIZON, forecast
from slrl_sumo.perception.route_context import RouteContext, route_context
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead
from slrl_sumo.scene.state import WorldState

ALONG = SPACING * (np.arange(POINTS) - HERE)


def car(speed: float, **changes: float) -> WorldState:
    user = make_world(0.0, 0.0, 0.0, speed, type=0, length=5.0, width=1.8, ids=("learned",))
    return replace(user, **{name: np.array([value]) for name, value in changes.items()})


def on(x: Floats, y: Floats, user: WorldState, stop: float = np.inf) -> RouteContext:
    """The context of a road user on the path through `x`, `y`."""
    route = replace(RouteAhead.unknown(1), known=np.ones(1, np.bool_), x=x[None], y=y[None], stop=np.array([stop]))
    return route_context(route, user)


def left_turn(radius: float, begin: float) -> tuple[Floats, Floats]:
    """A path to the east that turns left after `begin` m."""
    angle = np.clip((ALONG - begin) / radius, 0.0, np.pi / 2)
    rest = np.maximum(ALONG - begin - radius * np.pi / 2, 0.0)
    x = np.minimum(ALONG, begin) + radius * np.sin(angle)
    return x, radius * (1.0 - np.cos(angle)) + rest


def test_without_a_route_vehicles_keep_their_yaw_rate_for_a_short_time() -> None:
    boxes, predicted, _ = forecast(car(2.0, yaw_rate=0.5))
    near = MOMENTS <= MOTION_HORIZON
    assert predicted[0] == near.sum()
    # A circle of radius v / yaw rate.
    t = MOMENTS[near]
    np.testing.assert_allclose(boxes[0, near, 0], 4.0 * np.sin(0.5 * t), atol=1e-12)
    np.testing.assert_allclose(boxes[0, near, 1], 4.0 * (1 - np.cos(0.5 * t)), atol=1e-12)
    np.testing.assert_allclose(boxes[0, near, 2], 0.5 * t)


def test_pedestrians_without_a_route_go_straight_on() -> None:
    boxes, predicted, _ = forecast(car(1.3, type=2, yaw_rate=0.9))
    near = np.arange(predicted[0])
    np.testing.assert_allclose(boxes[0, near, 0], 1.3 * MOMENTS[near])
    np.testing.assert_allclose(boxes[0, near, 1:3], 0.0)


def test_road_users_that_stand_are_where_they_are() -> None:
    user = car(0.0)
    assert forecast(user).predicted.tolist() == [1]
    assert forecast(user, on(ALONG, 0.0 * ALONG, user)).predicted.tolist() == [1]


@pytest.mark.parametrize("yaw_rate", [-0.5, 0.0, 0.5])
def test_on_its_route_a_road_user_follows_the_path_whatever_its_yaw_rate(yaw_rate: float) -> None:
    user = car(8.0, yaw_rate=yaw_rate)
    boxes, predicted, _ = forecast(user, on(*left_turn(10.0, 8.0), user))
    assert predicted[0] == len(MOMENTS)
    assert MOMENTS[-1] == FORECAST_HORIZON
    # 32 m: 8 m straight on, 15.7 m in the turn, 8.3 m north.
    np.testing.assert_allclose(boxes[0, -1, :3], [18.0, 18.3, np.pi / 2], atol=0.15)
    assert np.abs(boxes[0, MOMENTS < 1.0, 1]).max() < 1e-6


def test_it_stops_where_its_route_makes_it_stop_if_it_still_can() -> None:
    user = car(8.0)
    straight = ALONG, 0.0 * ALONG
    stopping = forecast(user, on(*straight, user, stop=12.0)).boxes[0, -1, 0]
    assert 9.0 < stopping < 12.0
    assert forecast(user, on(*straight, user, stop=4.0)).boxes[0, -1, 0] == pytest.approx(32.0)


def test_it_does_not_drive_through_its_leader() -> None:
    user = car(8.0)
    both = user.join(replace(car(0.0, x=20.0), ids=("leader",)))
    context = on(ALONG, 0.0 * ALONG, both)
    assert forecast(user, context).boxes[0, -1, 0] == pytest.approx(15.0)


def test_beside_its_path_it_returns_to_it() -> None:
    user = car(8.0, y=1.0)
    boxes = forecast(user, on(ALONG, 0.0 * ALONG, user)).boxes[0]
    np.testing.assert_allclose(boxes[0, :3], [0.0, 1.0, 0.0], atol=1e-9)
    assert (np.diff(boxes[:, 1]) <= 1e-9).all()
    assert boxes[-1, 1] == pytest.approx(0.0)


@pytest.mark.parametrize("changes", [{"y": 8.0}, {"heading": 2.0}], ids=["beside", "against"])
def test_a_road_user_that_does_not_follow_its_path_is_predicted_as_without_one(changes: dict[str, float]) -> None:
    user = car(8.0, **changes)
    np.testing.assert_array_equal(forecast(user, on(ALONG, 0.0 * ALONG, user)).boxes, forecast(user).boxes)


def test_later_in_the_interval_the_path_is_that_of_the_decision() -> None:
    user = car(8.0)
    context = on(*left_turn(10.0, 8.0), user, stop=20.0)
    later = forecast(replace(user, x=user.x + 3.2), context).boxes[0]
    np.testing.assert_allclose(later[0, :2], [3.2, 0.0], atol=1e-9)
    now = forecast(user, context).boxes[0]
    np.testing.assert_allclose(later[-1], now[-1], atol=1e-6)


def test_faster_road_users_are_committed_for_longer() -> None:
    assert forecast(car(9.0)).committed[0] == pytest.approx(1.0)
    assert forecast(car(1.3, type=2)).committed[0] > MOTION_HORIZON
