"""Environments and training show what the models of the bundle read."""

from pathlib import Path

import numpy as np
import pytest
from builders import make_bundle
from gymnasium import spaces

import slrl_sumo
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.make import vector_env
from slrl_sumo.learning.environments.observations import vector_space
from slrl_sumo.learning.rl.ppo import PpoSettings
from slrl_sumo.learning.rl.train import TrainRequest, train
from slrl_sumo.learning.rl.training_settings import NetworkSettings, TrainSettings
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.features import STATES
from slrl_sumo.perception.route_features import PATH_FEATURES, ROUTE_FEATURES

N = 6


@pytest.mark.parametrize("state", ["paper", "history"])
def test_the_vector_has_the_columns_of_the_bundle(state: str, tmp_path: Path) -> None:
    make_bundle(state).save(tmp_path / "bundle")
    env = vector_env(scenario="shared-space", num_envs=N, bundle=str(tmp_path / "bundle"), warm_up=4.0)
    space = env.single_observation_space
    assert isinstance(space, spaces.Dict)
    assert space["vector"] == vector_space(state)
    before, _ = env.reset(seed=1)
    for _ in range(4):
        seen, _, terminated, truncated, _ = env.step(np.zeros(N, np.int64))
        assert env.observation_space.contains(seen)
        goes_on = ~(terminated | truncated)
        assert goes_on.any()
        if state == "history":
            then, now = (STATES[state].index(name) for name in ("speed", "speed_1"))
            assert seen["vector"][goes_on, now] == pytest.approx(before["vector"][goes_on, then])
        before = seen
    env.close()


def test_the_preset_image_shows_the_past_and_the_path_ahead_and_no_rollouts() -> None:
    env = vector_env(scenario="signalised", num_envs=N, preset="image", warm_up=4.0)
    space = env.single_observation_space
    assert isinstance(space, spaces.Dict)
    assert set(space) == {"vector", "action_mask", "image", "route"}
    assert space["vector"] == vector_space("history")  # the models of the bundle read 12 columns
    assert space["route"].shape == (len(ROUTE_FEATURES) + len(PATH_FEATURES),)
    without = vector_env(scenario="signalised", num_envs=N, preset="image", image=False).single_observation_space
    assert isinstance(without, spaces.Dict)
    assert set(space) - set(without) == {"image"}
    env.reset(seed=1)
    for _ in range(3):
        seen, *_ = env.step(np.zeros(N, np.int64))
        assert env.observation_space.contains(seen)
        assert seen["route"][:, len(ROUTE_FEATURES) :].any(axis=1).all()
    env.close()


def test_a_selector_of_the_preset_image_is_trained_and_runs(tmp_path: Path) -> None:
    settings = TrainSettings(
        ppo=PpoSettings(num_steps=4, num_minibatches=2, update_epochs=1),
        arena=ArenaSettings(agents=N, warm_up=0.0, episode_steps=4),
        policy=PolicyConfig(preset="image", channels=(4, 4), hidden=16, head=8),
        networks=NetworkSettings(count=1, reset_every=1),
    )
    request = TrainRequest("signalised", "intersection", tmp_path / "out", steps=2 * 4 * N, workers=1)
    train(request, settings, resume=False, report=lambda *_: None)
    trained = load_bundle(tmp_path / "out").policy
    assert trained is not None
    assert trained.config.preset == "image"
    result = slrl_sumo.run("signalised", bundle=str(tmp_path / "out"), selector="greedy", agents=N, steps=3, seed=1)
    assert result.summary.decisions == 3


def test_a_selector_is_trained_on_models_that_read_the_past(tmp_path: Path) -> None:
    make_bundle("history").save(tmp_path / "past")
    settings = TrainSettings(
        ppo=PpoSettings(num_steps=4, num_minibatches=2, update_epochs=1),
        arena=ArenaSettings(agents=N, warm_up=0.0, episode_steps=4),
        policy=PolicyConfig(preset="extended", image=False, hidden=16, head=8),
        networks=NetworkSettings(count=1, reset_every=1),
    )
    request = TrainRequest("shared-space", str(tmp_path / "past"), tmp_path / "out", steps=2 * 4 * N, workers=1)
    train(request, settings, resume=False, report=lambda *_: None)
    trained = load_bundle(tmp_path / "out")
    assert trained.config.preset == "history"
    assert trained.policy is not None
