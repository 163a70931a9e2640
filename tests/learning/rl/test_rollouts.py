"""Rollouts by worker processes: the same whatever dies, and another simulation where one cannot be survived."""

import os
import pickle
import signal
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.jobs.pool import Backend
from slrl_sumo.jobs.process import WorkerDiedError
from slrl_sumo.jobs.workers import LocalWorkers
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.rl.actor import Agent
from slrl_sumo.learning.rl.batch import Batch
from slrl_sumo.learning.rl.rollouts import Result, RolloutWorker, WorkerRollouts
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig

SMALL = PolicyConfig(channels=(4, 4), hidden=16, head=8)
SOURCE = ArenaSource(("intersection", "shared-space"), "intersection", ArenaSettings(agents=8, warm_up=4.0))


@pytest.fixture(scope="module")
def agent() -> Agent:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(5)
        policy = Policy(SMALL)
    return Agent(policy, load_bundle("intersection").prior, 0.03, 5e-4, torch.device("cpu"))


@pytest.fixture(scope="module")
def rollouts() -> Iterator[WorkerRollouts]:
    rollouts = WorkerRollouts(SOURCE, SMALL, 0.03, Backend(2))
    yield rollouts
    rollouts.close()


def collect(rollouts: WorkerRollouts, agent: Agent, kill_before: int | None = None) -> list[Any]:
    """Three rollouts of one seed, as plain arrays; a worker is killed before one of them."""
    rollouts.reset(3)
    arrays: list[Any] = []
    for number in range(3):
        if number == kill_before:
            assert isinstance(rollouts._workers, LocalWorkers)
            os.kill(rollouts._workers.pids()[1], signal.SIGKILL)
        batch, infos = rollouts.collect(agent, 4, 70 + number)
        arrays += [batch.seen["image"].numpy(), batch.actions.numpy(), batch.rewards.numpy(), batch.next_value.numpy()]
        arrays += [info["speed_mps"] for info in infos] + [batch.logprobs.numpy(), batch.teacher_costs.numpy()]
    return arrays


@pytest.mark.slow
def test_a_worker_that_dies_plays_the_same_again(rollouts: WorkerRollouts, agent: Agent) -> None:
    undisturbed = collect(rollouts, agent)
    assert undisturbed[0].shape == (4, 16, 20, 40, 3)
    assert not np.array_equal(undisturbed[1][:, :8], undisturbed[1][:, 8:])
    replaced = rollouts.replaced
    for before in (0, 2):
        for a, b in zip(undisturbed, collect(rollouts, agent, before), strict=True):
            np.testing.assert_array_equal(a, b)
    assert rollouts.replaced == replaced + 2


def test_the_weights_are_those_of_the_agent(rollouts: WorkerRollouts, agent: Agent) -> None:
    rollouts.reset(3)
    before, _ = rollouts.collect(agent, 2, 1)
    logits, worth = agent.logits_and_value({name: value.flatten(0, 1) for name, value in before.seen.items()})
    chosen = logits.gather(1, before.actions.flatten()[:, None])[:, 0]
    torch.testing.assert_close(before.logprobs.flatten(), chosen.detach(), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(before.values.flatten(), worth.detach(), rtol=1e-4, atol=1e-4)


class _FragileWorkers:
    """A single worker that dies a number of times."""

    def __init__(self, deaths: int) -> None:
        self.deaths, self.draws, self.result = deaths, [], None  # type: ignore[var-annotated]

    def publish(self, weights: bytes) -> None: ...

    def begin(self, number: int, request: bytes, timeout: float) -> None:
        self.draws.append(pickle.loads(request).draw)

    def wait(self) -> list[tuple[int, Any]]:
        dies = len(self.draws) <= self.deaths
        return [(0, WorkerDiedError("SIGSEGV") if dies else self.result)]

    def replace(self, number: int) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def result() -> Result:
    none, no = torch.zeros(2, 8), torch.zeros(2, 8, dtype=torch.bool)
    batch = Batch({}, torch.zeros(2, 8, dtype=torch.int64), none, none, none, no, no, none, none[0], none[..., None])
    return Result(batch, [{"replaced": np.zeros(8, np.bool_)}, {"replaced": np.zeros(8, np.bool_)}], 0.0)


def test_after_two_deaths_another_simulation_is_drawn_and_after_more_it_is_given_up(
    agent: Agent, result: Result
) -> None:
    lone = WorkerRollouts(SOURCE, SMALL, 0.03, Backend(1))
    lone.close()
    for deaths, draws in ((1, [(9, 0, 0)] * 2), (2, [(9, 0, 0)] * 2 + [(9, 0, 2)])):
        workers = lone._workers = _FragileWorkers(deaths)
        workers.result = result
        lone.reset(9)
        _, infos = lone.collect(agent, 2, 1)
        assert workers.draws == draws
        assert [info["replaced"].all() for info in infos] == [deaths == 2, False]
    lone._workers = _FragileWorkers(99)
    with pytest.raises(SumoError, match=r"training worker 0 died 5 times in a row \(last: SIGSEGV\)"):
        lone.collect(agent, 2, 1)


def test_what_cannot_be_loaded_is_said_in_one_line(agent: Agent) -> None:
    source = replace(SOURCE, settings=replace(SOURCE.settings, agents=5000))
    rollouts = WorkerRollouts(source, SMALL, 0.03, Backend(1))
    try:
        rollouts.reset(1)
        with pytest.raises(InputError, match="fit into this network"):
            rollouts.collect(agent, 2, 1)
    finally:
        rollouts.close()


@pytest.mark.slow
def test_a_worker_that_has_grown_is_replaced_at_the_next_reset(
    rollouts: WorkerRollouts, agent: Agent, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = collect(rollouts, agent)
    assert isinstance(rollouts._workers, LocalWorkers)
    before, replaced = set(rollouts._workers.pids().values()), rollouts.replaced
    monkeypatch.setattr("slrl_sumo.learning.rl.rollouts.MEMORY_LIMIT", 1.0)
    again = collect(rollouts, agent)
    assert not set(rollouts._workers.pids().values()) & before
    assert rollouts.replaced == replaced
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_work_of_a_worker_is_small_to_send() -> None:
    assert len(pickle.dumps(RolloutWorker(SOURCE, SMALL, 0.03))) < 5000
