"""Speeds that leave room to stop, against numpy's interpolation of what the models can do."""

import numpy as np
from builders import make_crowd, straight_routes

from slrl_sumo.lookahead.leaders import Leaders
from slrl_sumo.lookahead.mode_rollout import roll_out
from slrl_sumo.lookahead.route_fit import (
    AT,
    CALM,
    HEADWAY,
    SPARE,
    TOO_MUCH,
    RouteContext,
    allowed_speed,
    on_route,
    ways_left,
)
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL


def drawn_prospects(users: WorldState) -> RouteContext:
    """Paths straight ahead, with lines and leaders near, far and nowhere."""
    rng, n = np.random.default_rng(2), len(users)
    stop = rng.choice([-1.0, 0.5, 3.0, 12.0, 33.0, 1e3, np.inf], n)
    desired = rng.uniform(5.0, 60.0, n)
    poses = zip(users.x, users.y, users.heading, strict=True)
    route = straight_routes(*poses, desired=desired, stop=stop)
    gap = rng.choice([0.0, 2.0, 20.0, np.inf], n)
    # What is needed to a stand rises unevenly with speed, and differs from type to type.
    stopping = np.cumsum(rng.uniform(0.01, 0.5, (3, len(STOPPING))), axis=1)
    return RouteContext(route, Leaders(gap, rng.uniform(0.0, 8.0, n)), Capability(np.ones((3, 2, 1)), stopping))


def test_allowed_speeds_leave_room_to_stop() -> None:
    users = make_crowd(200, 1, 100.0)
    context = drawn_prospects(users)
    stop, room = ways_left(context, users, np.arange(200))
    assert np.array_equal(stop, context.route.stop - SPARE)
    within = CALM * np.maximum(np.minimum(stop, room - HEADWAY * users.speed), 0.0)
    found = allowed_speed(context, users)
    for row, kind in enumerate(users.type):
        most = np.interp(within[row], context.able.stopping[kind], STOPPING)
        assert found[row] == np.minimum(most, context.route.desired[row])
    assert (found == context.route.desired).any()
    assert (found == 0.0).any()


def test_strains_are_those_of_the_way_to_a_stand() -> None:
    users = make_crowd(60, 3, 100.0)
    context, rows = drawn_prospects(users), np.random.default_rng(4).permutation(60)[:40]
    me = users.take(rows)
    acceleration, yaw_rate = np.random.default_rng(5).normal(0.0, 1.0, (2, 40, 6))
    free = roll_out(me, acceleration, yaw_rate, np.full(40, 45.0), halting=True)
    fits = on_route(context, me, rows, free, yaw_rate)
    stop, room = ways_left(context, me, rows)
    leading = context.leaders.speed[rows]
    for i, kind in enumerate(me.type):
        first, speed = free.speed[i, 0], free.speed[i, 1]
        need = np.interp(first, STOPPING, context.able.stopping[kind])
        np.testing.assert_allclose(
            fits.brake[i], np.minimum(need / np.maximum(stop[i] - first * DECISION_INTERVAL, AT), TOO_MUCH)
        )
        behind = room[i] + leading[i] * DECISION_INTERVAL - (DECISION_INTERVAL + HEADWAY) * first
        np.testing.assert_allclose(fits.follow[i], np.minimum(need / np.maximum(behind, AT), TOO_MUCH), atol=1e-12)
        left = np.minimum(stop[i], room[i] + 2.0 * leading[i] * DECISION_INTERVAL - HEADWAY * speed)
        left = left - (first + speed) * DECISION_INTERVAL
        most = np.interp(CALM * left, context.able.stopping[kind], STOPPING)
        most = np.minimum(most, context.route.desired[rows[i]])
        pace = np.clip((speed - most) / np.maximum(most, 1.0), -1.0, 1.0)
        np.testing.assert_allclose(fits.pace[i], pace, atol=1e-12)
    assert (fits.brake == TOO_MUCH).any()
    assert (fits.brake == 0.0).any()
