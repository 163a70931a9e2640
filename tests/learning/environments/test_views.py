"""The vector environment, the single one and the parallel one show the same simulation."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.error import InvalidAction
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.learning.environments.make import parallel_env, vector_env
from slrl_sumo.learning.environments.options import make_source
from slrl_sumo.learning.environments.road_user_env import RoadUserEnv
from slrl_sumo.learning.environments.simulation_env import SimulationVectorEnv
from slrl_sumo.learning.rewards.transition import Transition
from slrl_sumo.learning.rl.actor import Actor
from slrl_sumo.models.bundle import load_bundle

N, STEPS = 6, 14
SPAWNED: dict[str, Any] = {"warm_up": 8.0, "episode_steps": 9}
TRIPS: dict[str, Any] = {"warm_up": 90.0, "takeover": {"car": 1, "bicycle": 1, "pedestrian": 1}}
pytestmark = pytest.mark.usefixtures("here")


def near(situation: Situation) -> NDArray[np.float32]:
    """An observation of one's own: speed, and the collision score of the best mode."""
    assert situation.rollouts is not None
    best = situation.rollouts.collision.min(axis=1)
    return np.column_stack([situation.observation.vector[:, 0], best]).astype(np.float32)


def onward(transition: Transition) -> NDArray[np.float64]:
    """A reward of one's own: progress, minus 5 for a contact."""
    return np.asarray(transition.terms(("progress",))["progress"] - 5.0 * transition.hit)


OWN: dict[str, Any] = {
    "observe": near,
    "observation_space": spaces.Box(0.0, 100.0, (2,), np.float32),
    "reward": onward,
}


SLOW = [pytest.param(options, marks=pytest.mark.slow) for options in (SPAWNED | OWN, TRIPS | OWN)]
ALL = [SPAWNED, TRIPS, *SLOW]


@pytest.fixture
def vector(request: pytest.FixtureRequest) -> Iterator[SimulationVectorEnv]:
    env = vector_env("intersection", num_envs=N, **request.param)
    yield env
    env.close()


def same(one: Any, other: Any) -> None:
    np.testing.assert_equal(one, other)


def row(seen: Any, slot: int) -> Any:
    """A row of an observation of the vector environment, as views show it."""
    return {name: seen[name][slot] for name in seen if name != "active"} if isinstance(seen, dict) else seen[slot]


def played(env: SimulationVectorEnv, modes: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    """What the vector environment gives after a reset and after each decision."""
    return [env.reset(seed=5), *(env.step(some) for some in modes)]


@pytest.mark.parametrize("vector", ALL, indirect=True)
def test_the_parallel_environment_gives_rows_of_the_vector_environment(
    vector: SimulationVectorEnv, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = parallel_env("intersection", agents=N, **request.node.callspec.params["vector"])
    replies: list[Any] = []
    step = env._simulation.step
    monkeypatch.setattr(env._simulation, "step", lambda modes: replies.append(step(modes)) or replies[-1])
    random = np.random.default_rng(3)
    first = env.reset(seed=5)
    lived = []
    infos = first[1]
    while env.agents and len(lived) < STEPS:
        actions = {agent: random.choice(np.flatnonzero(infos[agent]["action_mask"])) for agent in env.agents}
        lived.append((actions, env.step(actions)))
        infos = lived[-1][1][4]
    env.close()
    (start, _), *steps = played(vector, np.array([reply.infos["mode"] for reply in replies]))
    slots = {agent: info["slot"] for agent, info in first[1].items()}
    for agent, slot in slots.items():
        same(first[0][agent], row(start, slot))
        assert env.observation_space(agent).contains(first[0][agent])
    compared = entered = 0
    for (actions, (seen, rewards, ended, cut, infos)), (after, reward, terminated, truncated, told) in zip(
        lived, steps, strict=True
    ):
        for agent, action in actions.items():
            slot = slots[agent]
            assert told["mode"][slot] == action
            over = terminated[slot] or truncated[slot]
            same(seen[agent], row(told["final_obs"] if over else after, slot))
            assert rewards[agent] == reward[slot]
            assert (ended[agent], cut[agent]) == (terminated[slot], truncated[slot])
            assert infos[agent]["slot"] == slot
            compared += 1
        for agent in seen.keys() - actions.keys():  # it enters
            slots[agent] = infos[agent]["slot"]
            same(seen[agent], row(after, slots[agent]))
            entered += 1
    assert compared > 4 * N
    assert entered == 0 or "takeover" in request.node.callspec.params["vector"]


@pytest.mark.parametrize("vector", ALL, indirect=True)
def test_the_single_environment_gives_one_row_of_the_vector_environment(
    vector: SimulationVectorEnv, request: pytest.FixtureRequest
) -> None:
    env = RoadUserEnv(scenario="intersection", agents=N, **request.node.callspec.params["vector"])
    seen, info = env.reset(seed=5)
    slot, lived, every = info["slot"], [], []
    for action in range(STEPS):
        lived.append(env.step(np.int64(action)))
        assert env._reply is not None
        every.append(env._reply.infos["mode"])
        assert every[-1][slot] == action
        if lived[-1][2] or lived[-1][3]:
            break
    env.close()
    (start, _), *steps = played(vector, np.array(every))
    same(seen, row(start, slot))
    for mine, (after, reward, terminated, truncated, told) in zip(lived, steps, strict=True):
        over = terminated[slot] or truncated[slot]
        same(mine[0], row(told["final_obs"] if over else after, slot))
        assert mine[1:4] == (reward[slot], terminated[slot], truncated[slot])
        assert mine[4]["speed_mps"] == told["speed_mps"][slot]
    assert len(lived) >= 3


@pytest.mark.parametrize("options", [SPAWNED, TRIPS])
def test_a_shipped_selector_drives_through_any_of_them(options: dict[str, Any]) -> None:
    """From the observation alone the policy chooses what the selector `greedy` chooses inside."""
    bundle = load_bundle("intersection")
    assert bundle.policy is not None
    actor = Actor(bundle.policy, bundle.prior, 0.0, torch.device("cpu"))

    def chosen(seen: dict[str, Any]) -> NDArray[np.int64]:
        with torch.inference_mode():
            logits, _ = actor.logits_and_value({name: torch.as_tensor(values) for name, values in seen.items()})
        return np.asarray(logits.argmax(-1).numpy())

    inside = vector_env("intersection", num_envs=N, others="greedy", **options)
    seen, _ = inside.reset(seed=2)
    wanted = []
    for _ in range(4):
        active = seen["active"] == 1 if "active" in seen else np.ones(N, bool)
        wanted.append((active, chosen(seen)))
        seen, *_, infos = inside.step(np.full(N, -1))
        same(infos["mode"][active], wanted[-1][1][active])
    inside.close()
    env = parallel_env("intersection", agents=N, others="greedy", **options)
    views, told = env.reset(seed=2)
    for active, modes in wanted:
        slots = {agent: told[agent]["slot"] for agent in env.agents}
        actions = {agent: int(chosen({k: v[None] for k, v in views[agent].items()})[0]) for agent in env.agents}
        assert all(active[slots[agent]] and actions[agent] == modes[slots[agent]] for agent in env.agents)
        views, *_, told = env.step(actions)  # type: ignore[arg-type]
    env.close()


WRONG = {
    "2 of 6": (np.zeros(2, np.int64), r"actions of shape \(2,\) and type int64: give 6 whole numbers from -1 to 19"),
    "a column": (np.zeros((N, 1), np.int64), r"actions of shape \(6, 1\)"),
    "below": (np.array([0, 0, -7, 0, 0, 0]), "action -7: give 6 whole numbers from -1 to 19"),
    "above": (np.array([0, 33, 0, 0, 0, 0]), "action 33: give 6 whole numbers from -1 to 19"),
    "unsigned": (np.full(N, 200, np.uint8), "action 200"),
    "between": (np.full(N, 2.9), "type float64"),
    "true": (np.ones(N, np.bool_), "type bool"),
    "none": ([None] * N, "type object"),
}


@pytest.mark.parametrize("options", [SPAWNED, pytest.param(TRIPS, marks=pytest.mark.slow)])
def test_actions_of_the_vector_environment_must_be_modes(options: dict[str, Any]) -> None:
    env = vector_env("intersection", num_envs=N, **options)
    env.reset(seed=5)
    for actions, message in WRONG.values():
        with pytest.raises(InvalidAction, match=message):
            env.step(actions)
    after, *_ = env.step([0, 1, 19, 0, 0, 0])  # type: ignore[arg-type]
    env.reset(seed=5)
    again, *_ = env.step(np.array([0, 1, 19, 0, 0, 0], np.uint8))  # type: ignore[arg-type]
    same(after, again)  # what was refused has left no trace
    env.close()


def test_a_training_has_no_selector_to_leave_a_road_user_to() -> None:
    source = replace(make_source("intersection", N, None, warm_up=0.0), others=None)
    env = SimulationVectorEnv(source)
    env.reset(seed=5)
    with pytest.raises(InvalidAction, match="action -1: give 6 whole numbers from 0 to 19"):
        env.step(np.full(N, -1))
    env.close()
