"""Speeds that leave room to stop, against numpy's interpolation of what the models can do."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_crowd, straight_routes

from slrl_sumo.lookahead.mode_paths import mode_paths
from slrl_sumo.lookahead.route_fit import (
    AT,
    COMFORT_SHARE,
    HEADWAY,
    MAX_RATIO,
    allowed_speed,
    route_fit,
)
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.perception.leaders import BRAKES
from slrl_sumo.perception.route_context import GAP, STOP_MARGIN, RouteContext, route_context
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED


def drawn_context(users: WorldState) -> tuple[RouteContext, Capability]:
    """Paths straight ahead, with lines and leaders near, far and nowhere."""
    rng, n = np.random.default_rng(2), len(users)
    stop = rng.choice([-1.0, 0.5, 3.0, 12.0, 33.0, 1e3, np.inf], n)
    desired = rng.uniform(5.0, 60.0, n)
    poses = zip(users.x, users.y, users.heading, strict=True)
    route = straight_routes(*poses, desired_speed=desired, stop=stop)
    gap = rng.choice([0.0, 2.0, 20.0, np.inf], n)
    # What is needed to a stand rises unevenly with speed, and differs from type to type.
    stopping = np.cumsum(rng.uniform(0.01, 0.5, (3, len(STOPPING))), axis=1)
    speed = rng.uniform(0.0, 8.0, n)
    context = replace(
        route_context(route, users),
        follow_speed=speed,
        follow_distance=gap - GAP[users.type] + speed**2 / (2.0 * BRAKES),
    )
    return context, Capability(np.ones((3, 2, 1)), stopping)


def test_allowed_speeds_leave_room_to_stop() -> None:
    users = make_crowd(200, 1, 100.0)
    context, capability = drawn_context(users)
    stop, room = context.stop_distance, context.follow_distance
    assert (stop <= context.route.stop - STOP_MARGIN[users.type]).all()
    braking = context.follow_speed**2 / (2.0 * BRAKES)
    alike = [
        np.interp(v, STOPPING, capability.stopping[k]) for v, k in zip(context.follow_speed, users.type, strict=True)
    ]
    behind = COMFORT_SHARE * (room - braking - HEADWAY[users.type] * users.speed) + np.minimum(braking, alike)
    within = np.maximum(np.minimum(COMFORT_SHARE * stop, behind), 0.0)
    found = allowed_speed(context, capability, users)
    for row, kind in enumerate(users.type):
        most = np.interp(within[row], capability.stopping[kind], STOPPING)
        assert found[row] == np.minimum(most, context.route.desired_speed[row])
    assert (found == context.route.desired_speed).any()
    assert (found == 0.0).any()


@pytest.mark.parametrize("hardest", [3.0, BRAKES, 6.0])
def test_cars_keep_their_headway_whatever_their_brakes(hardest: float) -> None:
    """Behind a leader at the same speed. With 6 m/s² they kept 0.3 s."""
    users = make_crowd(1, 1, 100.0)
    users = replace(users, type=np.zeros(1, np.int8), speed=np.array([12.0]))
    (context, _), stopping = drawn_context(users), STOPPING**2 / (2.0 * hardest)
    apart = HEADWAY[0] * 12.0 + (2.0 * max(144.0 / (2.0 * hardest) - 18.0, 0.0))
    context = replace(
        context,
        route=replace(context.route, desired_speed=np.array([40.0])),
        stop_distance=np.array([np.inf]),
        follow_speed=np.array([12.0]),
        follow_distance=np.array([apart + 18.0]),
    )
    capability = Capability(np.ones((3, 2, 1)), np.tile(stopping, (3, 1)))
    assert allowed_speed(context, capability, users)[0] == pytest.approx(12.0, abs=0.05)


def test_ratios_are_those_of_stopping_distances() -> None:
    users = make_crowd(60, 3, 100.0)
    (context, capability), rows = drawn_context(users), np.random.default_rng(4).permutation(60)[:40]
    me = users.take(rows)
    acceleration, yaw_rate = np.random.default_rng(5).normal(0.0, 1.0, (2, 40, 6))
    free = mode_paths(me, acceleration, yaw_rate, np.full(40, 45.0), on_route=True)
    fits = route_fit(context, capability, me, rows, free, yaw_rate)
    stop, room = context.stop_distance[rows], context.follow_distance[rows]
    leading = context.follow_speed[rows]
    for i, kind in enumerate(me.type):
        first, speed = free.speed[i, 0], free.speed[i, 1]
        need = np.interp(first, STOPPING, capability.stopping[kind])
        left = stop[i] - first * DECISION_INTERVAL
        too_late = (left < -STOP_MARGIN[kind]) & (first > STANDING_SPEED)
        np.testing.assert_allclose(
            fits.stop_ratio[i], np.minimum(0.5 * MAX_RATIO * too_late + need / np.maximum(left, AT), MAX_RATIO)
        )
        behind = room[i] + leading[i] * DECISION_INTERVAL - (DECISION_INTERVAL + HEADWAY[kind]) * first
        np.testing.assert_allclose(
            fits.follow_ratio[i], np.minimum(need / np.maximum(behind, AT), MAX_RATIO), atol=1e-12
        )
        theirs = min(leading[i] ** 2 / (2.0 * BRAKES), np.interp(leading[i], STOPPING, capability.stopping[kind]))
        shared = np.minimum(theirs, need) / np.maximum(behind, AT)
        np.testing.assert_allclose(fits.leader_ratio[i], np.minimum(shared, MAX_RATIO), atol=1e-12)
        covered, braking = (first + speed) * DECISION_INTERVAL, leading[i] ** 2 / (2.0 * BRAKES)
        later = room[i] + 2.0 * leading[i] * DECISION_INTERVAL - covered - braking
        braking = min(braking, np.interp(leading[i], STOPPING, capability.stopping[kind]))
        left = np.minimum(
            COMFORT_SHARE * (stop[i] - covered), COMFORT_SHARE * (later - HEADWAY[kind] * speed) + braking
        )
        most = np.interp(left, capability.stopping[kind], STOPPING)
        most = np.minimum(most, context.route.desired_speed[rows[i]])
        pace = np.clip((speed - most) / np.maximum(most, 1.0), -1.0, 1.0)
        np.testing.assert_allclose(fits.speed_error[i], pace, atol=1e-12)
    assert (fits.stop_ratio == MAX_RATIO).any()
    assert (fits.stop_ratio == 0.0).any()


def test_a_mode_that_stops_is_on_no_wrong_way() -> None:
    users, rows = replace(make_crowd(30, 3, 100.0), speed=np.ones(30)), np.arange(30)
    _, capability = drawn_context(users)
    straight = straight_routes(*zip(users.x, users.y, users.heading, strict=True), desired_speed=1.5)
    speeds, yaw_rate = np.array([0.0, 0.7, 1.0]), np.full((30, 3), 0.5)
    acceleration = np.tile((speeds - 1.0) / DECISION_INTERVAL, (30, 1))
    free = mode_paths(users, acceleration, yaw_rate, np.full(30, 45.0), on_route=True)
    error = route_fit(route_context(straight, users), capability, users, rows, free, yaw_rate).heading_error
    assert (error[:, 0] == 0.0).all()
    # All turn by the same angle; the share of it counts, and what leads back to the path.
    assert error[:, 1:] == pytest.approx(np.tile(0.2 * speeds[1:], (30, 1)), rel=0.25)
