"""Training and runs take the same decisions: on the same scene they see, allow and do the same."""

import numpy as np
import pytest

from slrl_sumo.agent.constraints import Constraints, constraints_of
from slrl_sumo.agent.decide import Situation
from slrl_sumo.agent.make_driver import make_driver
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import Arena, ArenaSettings
from slrl_sumo.lookahead.route_fit import RouteFit
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.scenario import find_scenario

N = 12
POSE = ("x", "y", "heading", "speed", "acceleration", "yaw_rate")


def run_driver(arena: Arena, selector: str) -> ModelDriver:
    """The driver that a run makes, in the simulation of `arena`."""
    session = arena._session
    driver = make_driver(selector, arena.bundle, session.api, session.network, 5)
    assert isinstance(driver, ModelDriver)
    return driver


def assert_same_situation(trained: Situation, run: Situation) -> None:
    """What a training knows, a run knows as well, as far as its selector needs it."""
    np.testing.assert_array_equal(trained.observation.vector, run.observation.vector)
    assert (trained.mask is None) == (run.mask is None)
    if run.mask is not None:
        np.testing.assert_array_equal(trained.mask, run.mask)
    for mine, theirs in (
        (trained.observation.image, run.observation.image),
        (trained.observation.route, run.observation.route),
    ):
        if theirs is not None:
            np.testing.assert_array_equal(mine, theirs)
    if run.rollouts is None:
        return
    assert trained.rollouts is not None
    for name in ("acceleration", "yaw_rate", "collision", "off_surface", "speed", "turn"):
        np.testing.assert_array_equal(getattr(trained.rollouts, name), getattr(run.rollouts, name))
    if run.rollouts.route is not None:
        for name in RouteFit._fields:
            np.testing.assert_array_equal(getattr(trained.rollouts.route, name), getattr(run.rollouts.route, name))


def assert_same_motion(trained: WorldState, run: WorldState, rows: np.ndarray) -> None:
    # Without rollouts only the chosen mode's model is evaluated, in single precision: its last digit may differ.
    for name in POSE:
        np.testing.assert_allclose(getattr(trained, name)[:N][rows], getattr(run, name)[rows], atol=1e-5)


@pytest.mark.parametrize("selector", ["prior", "greedy", "sampled"])
@pytest.mark.parametrize(
    ("bundle", "scenario"),
    [("intersection", "signalised"), ("intersection-paper", "intersection"), ("shared-space", "shared-space")],
)
def test_training_decides_as_a_run_does(bundle: str, scenario: str, selector: str) -> None:
    models = load_bundle(bundle)
    assert models.policy is not None
    # The prior reads no routes in a run, so the training that it is compared with has none.
    extended = models.policy.config.preset == "extended" and selector != "prior"
    settings = ArenaSettings(agents=N, warm_up=8.0, episode_steps=1000, preset="extended" if extended else "paper")
    changed = 0
    with Arena(find_scenario(scenario), models, settings, 3) as arena:
        driver = run_driver(arena, selector)
        for _ in range(25):
            world = arena.world
            moved = driver.drive(world, N, arena.simulation.road_map)
            assert driver.situation is not None
            assert moved.modes is not None
            assert_same_situation(arena.situation, driver.situation)
            outcome = arena.step(moved.modes)
            # Road users that wrapped around or began anew are elsewhere.
            stayed = np.hypot(outcome.world.x[:N] - world.x[:N], outcome.world.y[:N] - world.y[:N]) < 15.0
            assert stayed.sum() > N // 2
            assert_same_motion(outcome.world, moved.users, stayed)
            anew = np.flatnonzero(outcome.terminated | outcome.truncated)
            driver.forget(tuple(world.ids[row] for row in anew))
            changed += sum(int(rows.sum()) for name, rows in moved.changed.items() if name != "speed_cap")
    # Constraints that need routes have changed something.
    assert (changed > 0) == extended


def test_road_users_that_stand_too_long_are_released_in_training_as_in_runs() -> None:
    settings = ArenaSettings(agents=N, warm_up=8.0, episode_steps=1000, preset="extended")
    released = 0
    with Arena(find_scenario("signalised"), load_bundle("intersection"), settings, 3) as arena:
        driver = run_driver(arena, "greedy")
        for _ in range(20):
            driver.consider(arena.world, N, arena.simulation.road_map)
            assert driver.situation is not None
            assert arena.situation.rollouts is not None
            assert_same_situation(arena.situation, driver.situation)
            mask = arena.situation.mask
            if mask is not None:
                assert mask.any(axis=1).all()
                released += int((~mask).any(axis=1).sum())
            # All road users brake to a stand and stay there.
            outcome = arena.step(arena.situation.rollouts.speed.argmin(axis=1))
            anew = np.flatnonzero(outcome.terminated | outcome.truncated)
            driver.forget(tuple(arena.world.ids[row] for row in anew))
    assert released > 0


def test_constraints_are_named() -> None:
    assert constraints_of(True, ["speed_cap"]) == Constraints(guard=True, speed_cap=False)
    with pytest.raises(InputError, match="without='brakes': there is no constraint of that name; use path_smoothing"):
        constraints_of(False, ["brakes"])


def test_constraints_can_be_switched_off() -> None:
    settings = ArenaSettings(agents=N, warm_up=8.0, episode_steps=1000, preset="extended")
    off = Constraints(
        path_smoothing=False,
        steering_residual=False,
        braking_residual=False,
        deadlock_release=False,
        standing_still=False,
        speed_cap=False,
    )
    with Arena(find_scenario("signalised"), load_bundle("intersection"), settings, 3) as arena:
        session = arena._session
        driver = make_driver("greedy", arena.bundle, session.api, session.network, 5, constraints=off)
        assert isinstance(driver, ModelDriver)
        for _ in range(10):
            moved = driver.drive(arena.world, N, arena.simulation.road_map)
            assert moved.changed == {}
            assert driver.situation is not None
            assert driver.situation.masks == {}
            # The path is the one that the route gives.
            assert driver.situation.context is not None
            assert driver.situation.context.route is driver.situation.scene.route
            arena.step(arena.situation.rollouts.speed.argmin(axis=1))  # type: ignore[union-attr]
