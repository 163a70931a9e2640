"""Learned road users of several simulations as one vector environment: a worker process per simulation.

libsumo holds one simulation per process and may crash with it, so every arena lives in a worker process; one that dies,
times out or grows too large is replaced, and training continues.
"""

import pickle
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.jobs.pool import Failures, ask_all
from slrl_sumo.jobs.workers import LocalWorkers
from slrl_sumo.learning.rl.arena_slots import OBSERVED, ArenaSlots, ArenaSource, Arrays, stepped
from slrl_sumo.learning.rl.rewards import TERMS
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import PolicyConfig
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import FEATURES

TIMEOUT = 120.0
"""s that a worker may take for one step or reset."""
ATTEMPTS = 5
"""Failures of a worker in a row after which training is given up."""
MEMORY_LIMIT = 1500.0
"""MiB of a worker, above which it is replaced at the next reset."""


def observation_space(config: PolicyConfig) -> spaces.Dict:
    """Observation of one road user for a policy: the fields of `Observation` of these names."""
    seen: dict[str, spaces.Space[Any]] = {
        "vector": spaces.Box(-np.inf, np.inf, (len(FEATURES),), np.float32),
        "image": spaces.Box(0, 255, (EGO_ROWS, EGO_COLS, 3), np.uint8),
        "rollouts": spaces.Box(-np.inf, np.inf, (MODES, len(config.rollout_features)), np.float32),
        "action_mask": spaces.MultiBinary(MODES),
    }
    if config.route_columns:
        seen["route"] = spaces.Box(-np.inf, np.inf, (config.route_columns,), np.float32)
    return spaces.Dict(seen)


ACTION_SPACE: spaces.Discrete = spaces.Discrete(MODES)


class ArenaVectorEnv(VectorEnv):
    """`workers` simulations with `source.settings.agents` slots each: every slot is one road user.

    Observations are dicts of arrays `vector` (n, 12) float32, `image` (n, 20, 40, 3) uint8 and `rollouts` (n, 20, 4)
    float32, the rollout of each mode (lookahead.lookahead), n = workers x agents; in the preset `extended` 9 columns,
    and `route` (n, 14).
    Autoreset within the same step: `infos["final_obs"]` holds the last observation of the episodes that ended (rows
    where `infos["_final_obs"]`; zeros elsewhere). `infos` also has the terms of the reward by name, `speed_mps`,
    `type`, `steps` (decisions of the episode so far) and `replaced` (rows whose worker died in this step: their
    episodes are truncated, with reward 0), all (n,), and `teacher_costs` (n, modes) (see Arena.teacher_costs).

    `reset(seed=...)` opens a scenario in every worker, drawn by the seed: same seed, same episodes. Raises InputError
    if a worker cannot load scenario or bundle, SumoError if one fails ATTEMPTS times in a row.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 (gymnasium's own way)

    def __init__(self, source: ArenaSource, workers: int, *, memory_limit: float = MEMORY_LIMIT) -> None:
        self.num_envs = workers * source.settings.agents
        config = PolicyConfig(preset="extended" if source.settings.extended else "paper")
        space = observation_space(config)
        self.single_observation_space = space
        self._names = tuple(space)
        self.single_action_space = ACTION_SPACE
        self.observation_space = batch_space(space, self.num_envs)
        self.action_space = batch_space(ACTION_SPACE, self.num_envs)
        self.replaced = 0
        """Number of workers that were replaced because they died or timed out."""
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
                replies[number] = _cut_off(replies[number], self._seen[number])
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
            draw = self._seed, number, self._failures.deaths[number]
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
        self._slots = ArenaSlots(source)

    def __call__(self, message: tuple[str, Any]) -> tuple[float, Arrays]:
        """("reset", numbers that draw the simulation) or ("step", modes)."""
        import torch

        torch.set_num_threads(1)
        word, value = message
        reply = self._slots.reset(value) if word == "reset" else self._slots.flat_step(value)
        return peak_memory_mib(), reply


def _cut_off(restarted: Arrays, last: Arrays) -> Arrays:
    """The step in which a worker failed: all its episodes end at their last observation, with reward 0."""
    n = len(restarted["type"])
    none = np.zeros(n)
    return restarted | {
        "reward": none,
        "terminated": np.zeros(n, np.bool_),
        "truncated": np.ones(n, np.bool_),
        "speed_mps": none,
        "steps": np.zeros(n, np.int64),
        **dict.fromkeys(TERMS, none),
        "replaced": np.ones(n, np.bool_),
        **{f"final_{name}": last[name] for name in OBSERVED if name in last},
    }


def _joined(parts: list[Arrays], names: tuple[str, ...]) -> Arrays:
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
