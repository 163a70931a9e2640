"""Several simulations side by side: the same seed gives the same steps, and dead workers are replaced."""

import os
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.simulation_env import ArenaSource
from slrl_sumo.learning.environments.vector_env import ArenaVectorEnv

SOURCE = ArenaSource(("intersection", "shared-space"), "intersection", ArenaSettings(agents=8, warm_up=4.0))
MODES = np.random.default_rng(4).integers(0, 20, (10, 16))


@pytest.fixture(scope="module")
def env() -> Iterator[ArenaVectorEnv]:
    env = ArenaVectorEnv(SOURCE, 2)
    yield env
    env.close()


def _play(env: ArenaVectorEnv, seed: int) -> list[NDArray[Any]]:
    seen, _ = env.reset(seed=seed)
    parts = [seen["vector"], seen["image"]]
    for modes in MODES:
        seen, reward, *_ = env.step(modes)
        parts += [seen["vector"], seen["image"], reward]
    return parts


def test_same_seed_same_steps(env: ArenaVectorEnv) -> None:
    first, again, other = _play(env, 3), _play(env, 3), _play(env, 4)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert any(not np.array_equal(a, b) for a, b in zip(first, other, strict=True))


def test_observations_are_in_their_spaces_and_workers_differ(env: ArenaVectorEnv) -> None:
    seen, _ = env.reset(seed=1)
    assert env.observation_space.contains(seen)
    assert env.action_space.contains(MODES[0])
    assert not np.array_equal(seen["vector"][:8], seen["vector"][8:])


def test_a_worker_killed_in_the_middle_is_replaced_and_the_others_go_on(env: ArenaVectorEnv) -> None:
    undisturbed = _play(env, 5)
    seen, _ = env.reset(seed=5)
    replaced = env.replaced
    for number, modes in enumerate(MODES):
        if number == 4:
            os.kill(env._workers.pids()[1], signal.SIGKILL)
        last = seen
        seen, reward, terminated, truncated, infos = env.step(modes)
        if number == 4:
            np.testing.assert_array_equal(infos["replaced"], np.arange(16) >= 8)
            assert truncated[8:].all()
            assert not terminated[8:].any()
            assert (reward[8:] == 0).all()
            np.testing.assert_array_equal(infos["final_obs"]["image"][8:], last["image"][8:])
        else:
            assert not infos["replaced"].any()
        np.testing.assert_array_equal(reward[:8], undisturbed[2 + 3 * number + 2][:8])
    assert env.replaced == replaced + 1
    assert env.observation_space.contains(seen)


@pytest.mark.slow
def test_a_worker_that_has_grown_is_replaced_at_the_next_reset() -> None:
    env = ArenaVectorEnv(ArenaSource(("intersection",), "intersection", SOURCE.settings), 1, memory_limit=1.0)
    try:
        first, _ = env.reset(seed=2)
        before = env._workers.pids()[0]
        again, _ = env.reset(seed=2)
        assert env._workers.pids()[0] != before
        np.testing.assert_array_equal(first["image"], again["image"])
        assert env.replaced == 0
    finally:
        env.close()


def test_final_observations_are_those_of_the_ended_episodes() -> None:
    env = ArenaVectorEnv(
        ArenaSource(("intersection",), "intersection", ArenaSettings(agents=8, warm_up=0.0, episode_steps=3)), 1
    )
    try:
        env.reset(seed=1)
        for _ in range(3):
            seen, _, terminated, truncated, infos = env.step(np.zeros(8, np.int64))
    finally:
        env.close()
    ended = terminated | truncated
    assert ended.sum() >= 6
    np.testing.assert_array_equal(infos["_final_obs"], ended)
    final = infos["final_obs"]
    assert (final["image"][ended].reshape(ended.sum(), -1).max(1) > 0).all()
    assert not final["image"][~ended].any()
    # They are of the old place, the observations of the new one.
    assert not np.array_equal(final["vector"][ended], seen["vector"][ended])


def test_what_cannot_be_loaded_is_said_in_one_line() -> None:
    env = ArenaVectorEnv(ArenaSource(("intersection",), "intersection", ArenaSettings(agents=5000)), 1)
    try:
        with pytest.raises(InputError, match="fit into this network"):
            env.reset(seed=1)
    finally:
        env.close()


@pytest.mark.slow
def test_in_the_preset_extended_all_see_a_route_up_to_the_end() -> None:
    settings = ArenaSettings(agents=8, warm_up=4.0, episode_steps=3, extended=True)
    env = ArenaVectorEnv(ArenaSource(("signalised",), "intersection", settings), 1)
    try:
        assert env.observation_space["route"].shape == (8, 14)  # type: ignore[index]
        assert env.observation_space["rollouts"].shape == (8, 20, 9)  # type: ignore[index]
        seen, _ = env.reset(seed=1)
        for number in range(4):
            assert env.observation_space.contains(seen)
            driving = seen["vector"][:, 4] == 0.0
            assert (seen["route"][driving, 0] == 1.0).all()
            last = seen
            if number == 3:
                os.kill(env._workers.pids()[0], signal.SIGKILL)
            seen, _, terminated, truncated, infos = env.step(np.zeros(8, np.int64))
            ended = terminated | truncated
            final = infos["final_obs"]["route"]
            assert not final[~ended].any()
            assert (final[ended & driving, 0] == 1.0).all()
            if number == 2:
                assert truncated.sum() >= 6
                # Of the old place, not of the new one.
                assert (final[ended & driving] != seen["route"][ended & driving]).any(axis=1).all()
    finally:
        env.close()
    # A worker that died: where they were seen last.
    assert infos["replaced"].all()
    np.testing.assert_array_equal(infos["final_obs"]["route"], last["route"])
