"""Paths of all modes at once against `advance`."""

import numpy as np
import pytest
from builders import make_crowd, make_world

from slrl_sumo.lookahead.mode_paths import HELD, STEPS, mode_paths, turns_held
from slrl_sumo.scene.advance import advance, halting
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

MODES = 6


@pytest.mark.parametrize("on_route", [False, True])
def test_mode_paths_are_those_of_advance_one_interval_after_the_other(on_route: bool) -> None:
    users = make_crowd(40, 1, 100.0)
    acceleration, yaw_rate = np.random.default_rng(2).normal(0.0, 1.5, (2, len(users), MODES))
    top = np.full(len(users), 9.0)
    found = mode_paths(users, acceleration, yaw_rate, top, on_route=on_route)
    for mode in range(MODES):
        state, way = users, np.zeros(len(users))
        for step in range(STEPS):
            held = step < HELD
            turns = np.full(len(users), held)
            if on_route:
                walks = users.type == RoadUserType.PEDESTRIAN
                turns[walks] = step < turns_held(yaw_rate[walks, mode])
            felt = acceleration[:, mode] if held else np.zeros(len(users))
            if on_route and held:
                felt = halting(state.speed, felt, DECISION_INTERVAL)
            state = advance(state, felt, yaw_rate[:, mode] * turns, top, DECISION_INTERVAL)
            way = way + state.speed * DECISION_INTERVAL
            expected = state.x, state.y, np.cos(state.heading), np.sin(state.heading), state.speed, way
            for name, values in zip(("x", "y", "cos", "sin", "speed", "distance"), expected, strict=True):
                np.testing.assert_allclose(getattr(found, name)[:, step, mode], values, atol=1e-9)
    assert (found.speed == 0.0).any()
    assert (found.speed == 9.0).any()
    first = mode_paths(users, acceleration, yaw_rate, top, on_route=on_route, steps=2)
    for some, whole in zip(first, found, strict=True):
        np.testing.assert_array_equal(some, whole[:, :2])


def test_no_road_users_have_no_paths() -> None:
    empty, nothing = make_crowd(0, 5, 50.0), np.zeros((0, MODES))
    assert mode_paths(empty, nothing, nothing, np.zeros(0), on_route=True).x.shape == (0, STEPS, MODES)


def test_pedestrians_on_a_route_turn_by_45_degrees_or_for_one_interval() -> None:
    """A mode that turns by 4 rad/s was rolled out as a circle, in which nothing was met."""
    person = make_world([0.0], [0.0], type=RoadUserType.PEDESTRIAN, speed=1.4)
    yaw_rate = np.array([[3.9, 1.0, 0.3]])
    found = mode_paths(person, np.zeros((1, 3)), yaw_rate, np.full(1, 1.8), on_route=True)
    turned = np.arctan2(found.sin[0, -1], found.cos[0, -1])
    np.testing.assert_allclose(turned, [3.9 * 0.4, 0.8, 0.3 * 0.4 * HELD], atol=1e-9)
    assert np.hypot(found.x, found.y)[0, -1].min() > 4.0
