"""Many road users of several simulations as one vector environment: a worker process per simulation.

libsumo holds one simulation per process and may take the process with it when it crashes, so every arena lives in a
worker; one that dies, hangs or grows too large is replaced, and training goes on.
"""

import os
import pickle
import signal
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.worker import Died, JobWorker
from slrl_sumo.learning.rl.arena_slots import (
    OBSERVED,
    ArenaSlots,
    ArenaSource,
    Arrays,
    peak_memory,
    stepped,
)
from slrl_sumo.learning.rl.rewards import TERMS
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import PolicyConfig
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import FEATURES

PATIENCE = 120.0
"""s that a worker may take for one step or reset."""
ATTEMPTS = 4
"""How often in a row a worker is replaced before training gives up."""
MEMORY_LIMIT = 1500.0
"""MiB of a worker, above which it is replaced at the next reset."""


def observation_space(config: PolicyConfig) -> spaces.Dict:
    """What one road user sees for a policy: the fields of `Observation` of these names."""
    seen: dict[str, spaces.Space[Any]] = {
        "vector": spaces.Box(-np.inf, np.inf, (len(FEATURES),), np.float32),
        "image": spaces.Box(0, 255, (EGO_ROWS, EGO_COLS, 3), np.uint8),
        "ahead": spaces.Box(-np.inf, np.inf, (MODES, config.ahead_columns), np.float32),
    }
    if config.route_columns:
        seen["route"] = spaces.Box(-np.inf, np.inf, (config.route_columns,), np.float32)
    return spaces.Dict(seen)


ACTION_SPACE: spaces.Discrete = spaces.Discrete(MODES)


class ArenaVectorEnv(VectorEnv):
    """`workers` simulations with `source.settings.agents` slots each: every slot is one road user.

    Observations are dicts of arrays `vector` (n, 12) float32, `image` (n, 20, 40, 3) uint8 and `ahead` (n, 20, 4)
    float32, what each mode would lead to (lookahead.lookahead), n = workers x agents; in the preset `extended` 9
    columns, and `route` (n, 14).
    Autoreset within the same step: `infos["final_obs"]` holds the last observation of the episodes that ended (rows
    where `infos["_final_obs"]`; zeros elsewhere). `infos` also has the terms of the reward by name, `speed_mps`,
    `type`, `steps` (decisions of the episode so far) and `replaced` (rows whose worker died in this step: their
    episodes are truncated, with reward 0), all (n,), and `guidance` (n, modes) (see Arena.guidance).

    `reset(seed=...)` opens a scenario in every worker, drawn by the seed: same seed, same episodes. Raises InputError
    where a worker cannot load what it is to play, SumoError where one dies ATTEMPTS times in a row.
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
        """How often a worker was replaced because it died or hung."""
        self._memory_limit = memory_limit
        self._seed = 0
        self._failures = [0] * workers
        self._seen: list[Arrays] = [{}] * workers
        self._work = pickle.dumps(Stepper(source))
        self._workers = [JobWorker(self._work) for _ in range(workers)]
        self._memory, self._how = [0.0] * workers, [""] * workers
        self._agents = source.settings.agents

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """See the class; without a seed the next one after the last."""
        self._seed = seed if isinstance(seed, int) else self._seed + 1
        for number, memory in enumerate(self._memory):
            if memory > self._memory_limit:
                self._replace(number)
            self._send(number, "reset", self._reset_seed(number))
        replies = [self._reply(number) for number in range(len(self._workers))]
        self._seen = [reply or self._revive(number) for number, reply in enumerate(replies)]
        return _joined(self._seen, self._names), _joined(self._seen, ("type", "guidance"))

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """See gymnasium.vector.VectorEnv; `actions` (n,) are modes."""
        for number in range(len(self._workers)):
            mine = slice(number * self._agents, (number + 1) * self._agents)
            self._send(number, "step", np.asarray(actions[mine], np.int64))
        replies = []
        for number in range(len(self._workers)):
            reply = self._reply(number)
            if reply is None:
                last = self._seen[number]
                reply = _cut_off(self._revive(number), last)
            else:
                self._failures[number] = 0
            replies.append(reply)
        self._seen = replies
        return stepped(_joined(replies, tuple(replies[0])))

    def close_extras(self, **kwargs: Any) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.stop()

    def kill(self, number: int) -> None:
        """Kill a worker as a crash would, to see that it is replaced."""
        os.kill(self._workers[number].pid, signal.SIGKILL)

    def _reset_seed(self, number: int) -> tuple[int, int, int]:
        return self._seed, number, self._failures[number]

    def _send(self, number: int, word: str, value: Any) -> None:
        self._workers[number].send(pickle.dumps((word, value)))

    def _reply(self, number: int) -> Arrays | None:
        """What a worker answers; None where it is dead, hangs, or SUMO gave up."""
        answer = self._workers[number].receive(PATIENCE)
        reply = answer if isinstance(answer, Died) else pickle.loads(answer)
        if isinstance(reply, Died | SumoError):
            self._how[number] = str(reply)
            return None
        if isinstance(reply, BaseException):
            raise reply
        self._memory[number], arrays = reply
        return arrays  # type: ignore[no-any-return]

    def _replace(self, number: int) -> None:
        self._workers[number].stop()
        self._workers[number] = JobWorker(self._work)
        self._memory[number] = 0.0

    def _revive(self, number: int) -> Arrays:
        """Replace a worker and open another scenario in it."""
        while True:
            self._failures[number] += 1
            self.replaced += 1
            if self._failures[number] > ATTEMPTS:
                raise SumoError(f"training worker {number} died {ATTEMPTS} times in a row (last: {self._how[number]})")
            self._replace(number)
            self._send(number, "reset", self._reset_seed(number))
            reply = self._reply(number)
            if reply is not None:
                return reply


class Stepper:
    """What a worker does: resets and steps of one simulation. Each answer comes with the process's memory, MiB."""

    def __init__(self, source: ArenaSource) -> None:
        self._slots = ArenaSlots(source)

    def __call__(self, message: tuple[str, Any]) -> tuple[float, Arrays]:
        """("reset", numbers that draw the simulation) or ("step", modes)."""
        import torch

        torch.set_num_threads(1)
        word, value = message
        reply = self._slots.reset(value) if word == "reset" else self._slots.flat_step(value)
        return peak_memory(), reply


def _cut_off(revived: Arrays, last: Arrays) -> Arrays:
    """The step in which a worker died: all its episodes end where they were seen last, for nothing."""
    n = len(revived["type"])
    none = np.zeros(n)
    return revived | {
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
