"""Paths of all modes at once against `advance`."""

import numpy as np
import pytest
from builders import make_crowd

from slrl_sumo.lookahead.mode_paths import HELD, STEPS, mode_paths
from slrl_sumo.scene.advance import advance, halting
from slrl_sumo.scene.types import DECISION_INTERVAL

MODES = 6


@pytest.mark.parametrize("halts", [False, True])
def test_mode_paths_are_those_of_advance_one_interval_after_the_other(halts: bool) -> None:
    users = make_crowd(40, 1, 100.0)
    acceleration, yaw_rate = np.random.default_rng(2).normal(0.0, 1.5, (2, len(users), MODES))
    top = np.full(len(users), 9.0)
    found = mode_paths(users, acceleration, yaw_rate, top, halting=halts)
    for mode in range(MODES):
        state, way = users, np.zeros(len(users))
        for step in range(STEPS):
            held = step < HELD
            felt = acceleration[:, mode] if held else np.zeros(len(users))
            if halts and held:
                felt = halting(state.speed, felt, DECISION_INTERVAL)
            state = advance(state, felt, yaw_rate[:, mode] * held, top, DECISION_INTERVAL)
            way = way + state.speed * DECISION_INTERVAL
            expected = state.x, state.y, np.cos(state.heading), np.sin(state.heading), state.speed, way
            for name, values in zip(("x", "y", "cos", "sin", "speed", "distance"), expected, strict=True):
                np.testing.assert_allclose(getattr(found, name)[:, step, mode], values, atol=1e-9)
    assert (found.speed == 0.0).any()
    assert (found.speed == 9.0).any()


def test_no_road_users_have_no_paths() -> None:
    empty, nothing = make_crowd(0, 5, 50.0), np.zeros((0, MODES))
    assert mode_paths(empty, nothing, nothing, np.zeros(0), halting=True).x.shape == (0, STEPS, MODES)
