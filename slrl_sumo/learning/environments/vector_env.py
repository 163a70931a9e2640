"""Learned road users of several simulations as one vector environment: a worker process per simulation.

libsumo holds one simulation per process and may crash with it, so every arena lives in a worker process; one that dies,
times out or grows too large is replaced, and training continues.
"""

import pickle
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.jobs.pool import Failures, ask_all
from slrl_sumo.jobs.workers import LocalWorkers
from slrl_sumo.learning.environments.simulation_env import (
    ACTION_SPACE,
    ArenaSource,
    SimulationVectorEnv,
    drawn_seed,
    observation_space,
    stepped,
    told_terms,
)
from slrl_sumo.learning.environments.slots import OBSERVED, Arrays

TIMEOUT = 120.0
"""s that a worker may take for one step or reset."""
ATTEMPTS = 5
"""Failures of a worker in a row after which training is given up."""
MEMORY_LIMIT = 1500.0
"""MiB of a worker, above which it is replaced at the next reset."""


class ArenaVectorEnv(VectorEnv):
    """`workers` simulations in processes of their own, side by side: see SimulationVectorEnv, n = workers x agents.

    `infos` also has `replaced` (n,): rows whose worker died in this step. Their episodes are truncated, with reward 0.

    `reset(seed=...)` opens a scenario in every worker, drawn by the seed: same seed, same episodes. Raises InputError
    if a worker cannot load scenario or bundle, SumoError if one fails ATTEMPTS times in a row.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 (gymnasium's own way)

    def __init__(self, source: ArenaSource, workers: int, *, memory_limit: float = MEMORY_LIMIT) -> None:
        self.num_envs = workers * source.settings.agents
        space = observation_space(source.settings)
        self.single_observation_space = space
        self._names = tuple(space)
        self.single_action_space = ACTION_SPACE
        self.observation_space = batch_space(space, self.num_envs)
        self.action_space = batch_space(ACTION_SPACE, self.num_envs)
        self.replaced = 0
        """Number of workers that were replaced because they died or timed out."""
        self._terms = told_terms(source.settings)
        self._memory_limit = memory_limit
        self._seed = 0
        self._count, self._agents = workers, source.settings.agents
        self._workers = LocalWorkers(pickle.dumps(ArenaWorker(source)), workers)
        self._failures = Failures(ATTEMPTS)
        self._memory = [0.0] * workers
        self._seen: list[Arrays] = [{}] * workers

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """See the class; without a seed the one after the last is taken."""
        self._seed = seed if isinstance(seed, int) else self._seed + 1
        for number, memory in enumerate(self._memory):
            if memory > self._memory_limit:
                self._workers.replace(number)
        self._seen, _ = self._asked({})
        return _joined(self._seen, self._names), _joined(self._seen, ("type", "teacher_costs"))

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """See gymnasium.vector.VectorEnv; `actions` (n,) are modes."""
        modes = np.asarray(actions, np.int64).reshape(self._count, self._agents)
        replies, restarted = self._asked(dict(enumerate(modes)))
        for number in range(self._count):
            if number in restarted:
                replies[number] = _cut_off(replies[number], self._seen[number], self._terms)
            else:
                self._failures.deaths[number] = 0
        self._seen = replies
        return stepped(_joined(replies, tuple(replies[0])))

    def close_extras(self, **kwargs: Any) -> None:
        """End all workers."""
        self._workers.close()

    def _asked(self, modes: dict[int, NDArray[np.int64]]) -> tuple[list[Arrays], set[int]]:
        """Replies of all workers to their `modes`, by worker, or to a reset without; and the workers that failed: they
        were replaced, and reset with another scenario."""
        restarted = set()

        def begin(number: int) -> None:
            draw = drawn_seed(self._seed, number, self._failures.deaths[number])
            message = ("step", modes[number]) if number in modes and number not in restarted else ("reset", draw)
            self._workers.begin(number, pickle.dumps(message), TIMEOUT)

        def failed(number: int, error: SumoError) -> None:
            self.replaced += 1
            restarted.add(number)

        answers = ask_all(self._workers, range(self._count), begin, failed, self._failures)
        self._memory = [answers[number][0] for number in range(self._count)]
        return [answers[number][1] for number in range(self._count)], restarted


class ArenaWorker:
    """The work of a process: resets and steps of one simulation. An answer has the peak memory of the process, MiB."""

    def __init__(self, source: ArenaSource) -> None:
        self._source = source
        self._env: SimulationVectorEnv | None = None

    def __call__(self, message: tuple[str, Any]) -> tuple[float, Arrays]:
        """("reset", seed) or ("step", modes)."""
        import torch

        torch.set_num_threads(1)
        self._env = env = self._env or SimulationVectorEnv(self._source)
        word, value = message
        reply = env.flat_reset(value) if word == "reset" else env.flat_step(value)
        return peak_memory_mib(), reply


def _cut_off(restarted: Arrays, last: Arrays, terms: tuple[str, ...]) -> Arrays:
    """The step in which a worker failed: all its episodes end at their last observation, with reward 0."""
    n = len(restarted["type"])
    none = np.zeros(n)
    no = np.zeros(n, np.bool_)
    trips = {"gone": np.ones(n, np.bool_), "reached": no, "clean": no} if "active" in restarted else {}
    return restarted | {
        "reward": none,
        "terminated": no,
        "truncated": np.ones(n, np.bool_),
        "speed_mps": none,
        "steps": np.zeros(n, np.int64),
        **dict.fromkeys(terms, none),
        **trips,
        "replaced": np.ones(n, np.bool_),
        **{f"final_{name}": last[name] for name in OBSERVED if name in last},
    }


def _joined(parts: list[Arrays], names: tuple[str, ...]) -> Arrays:
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
