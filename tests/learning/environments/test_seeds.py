"""What a reset may be given as a seed, through the three environments, on a real SUMO."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.make import parallel_env, vector_env
from slrl_sumo.learning.environments.seeds import given_seed, given_seeds, next_seed

QUICK: dict[str, Any] = {"warm_up": 0.0}
N = 2
KINDS = ("single", "vector", "parallel")
pytestmark = pytest.mark.usefixtures("here")


def make(kind: str) -> Any:
    if kind == "vector":
        return vector_env("intersection", num_envs=N, **QUICK)
    if kind == "parallel":
        return parallel_env("intersection", agents=N, **QUICK)
    return gymnasium.make("slrl_sumo/Intersection-v0", agents=N, **QUICK)


def begin(env: Any, **keywords: Any) -> Any:
    """The first observation of the first road user after a reset."""
    seen, _ = env.reset(**keywords)
    return {name: np.array(seen[name]) for name in seen} if "vector" in seen else seen["road_user_0"]


def differ(one: Any, other: Any) -> bool:
    return any(not np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("kind", KINDS)
def test_whole_numbers_of_all_types_are_one_seed(kind: str) -> None:
    env = make(kind)
    first = begin(env, seed=3)
    np.testing.assert_equal(begin(env, seed=np.int64(3)), first)
    np.testing.assert_equal(begin(env, seed=np.array(3)), first)
    assert differ(begin(env, seed=np.uint8(4)), first)
    env.close()


@pytest.mark.parametrize("seed", [-1, np.int64(-1), 3.0, np.float64(3), "three", b"3", True, [None, 1], {3, 4}])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_seed_is_named(kind: str, seed: Any) -> None:
    env = make(kind)
    with pytest.raises(InputError, match=r"^seed=.*: give a whole number from 0 on"):
        env.reset(seed=seed)
    env.close()


def test_a_seed_of_each_sub_environment_draws_the_simulation() -> None:
    env = make("vector")
    first = begin(env, seed=[3, 4])
    for same in ((3, 4), np.array([3, 4]), range(3, 5)):
        np.testing.assert_equal(begin(env, seed=same), first)
    assert differ(begin(env, seed=[3, 5]), first)
    assert differ(begin(env, seed=[4, 3]), first)
    for wrong in ([3], [3, 4, 5], [3, None], [3, -4], [3, 4.0], [[3, 4], [3, 4]], "34"):
        with pytest.raises(InputError, match=r"^seed="):
            env.reset(seed=wrong)
    env.close()


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_seed_environments_begin_differently(kind: str) -> None:
    one, other = make(kind), make(kind)
    first = begin(one)
    one.close()  # only one vector environment may be open
    assert differ(begin(other), first)
    other.close()


def test_the_next_seed_is_the_one_after_the_last() -> None:
    assert next_seed(7, 3) == next_seed(7, None) == 7
    assert next_seed(None, 7) == 8
    assert len({next_seed(None, None) for _ in range(20)}) > 1
    assert given_seed(None) is given_seeds(None, 2) is given_seeds([None, None], 2) is None
    assert given_seed(2**80) == 2**80  # as numpy's generators take it
