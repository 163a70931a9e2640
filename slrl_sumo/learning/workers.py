"""Many road users of several simulations as one vector environment: a worker process per simulation.

libsumo holds one simulation per process and may take the process with it when it crashes, so every arena lives in a
worker; one that dies, hangs or grows too large is replaced, and training goes on.
"""

import multiprocessing
import os
import resource
import signal
import sys
import tempfile
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.errors import SlrlError, SumoError
from slrl_sumo.learning.arena import Arena, ArenaSettings, Outcome
from slrl_sumo.learning.rewards import TERMS
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import PolicyConfig
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.raster import EGO_COLS, EGO_ROWS
from slrl_sumo.sumo.scenario import find_scenario

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

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class ArenaSource:
    """Where a worker finds what it plays: scenarios (as `slrl-sumo run` names them) and a bundle (name or folder)."""

    scenarios: tuple[str, ...]
    bundle: str
    settings: ArenaSettings


class ArenaVectorEnv(VectorEnv):
    """`workers` simulations with `source.settings.agents` slots each: every slot is one road user.

    Observations are dicts of arrays `vector` (n, 12) float32, `image` (n, 20, 40, 3) uint8 and `ahead` (n, 20, 4)
    float32, what each mode would lead to (simulation.lookahead), n = workers x agents; in the preset `extended` 9
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
        self._workers = [_Worker(source) for _ in range(workers)]
        self._agents = source.settings.agents

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """See the class; without a seed the next one after the last."""
        self._seed = seed if isinstance(seed, int) else self._seed + 1
        for number, worker in enumerate(self._workers):
            if worker.memory > self._memory_limit:
                worker.restart()
            worker.send(("reset", self._reset_seed(number)))
        replies = [self._reply(number) for number in range(len(self._workers))]
        self._seen = [reply or self._revive(number) for number, reply in enumerate(replies)]
        return _joined(self._seen, self._names), _joined(self._seen, ("type", "guidance"))

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """See gymnasium.vector.VectorEnv; `actions` (n,) are modes."""
        for number, worker in enumerate(self._workers):
            worker.send(("step", np.asarray(actions[number * self._agents : (number + 1) * self._agents], np.int64)))
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
        every = _joined(replies, tuple(replies[0]))
        infos: dict[str, Any] = {
            name: every[name] for name in (*TERMS, "speed_mps", "type", "steps", "replaced", "guidance")
        }
        observation = {name: every[name] for name in self._names}
        ended = infos["_final_obs"] = every["terminated"] | every["truncated"]
        infos["final_obs"] = {name: np.zeros_like(values) for name, values in observation.items()}
        for name, values in infos["final_obs"].items():
            values[ended] = every[f"final_{name}"]
        return observation, every["reward"], every["terminated"], every["truncated"], infos

    def close_extras(self, **kwargs: Any) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.stop()

    def kill(self, number: int) -> None:
        """Kill a worker as a crash would, to see that it is replaced."""
        self._workers[number].process.kill()

    def _reset_seed(self, number: int) -> tuple[int, int, int]:
        return self._seed, number, self._failures[number]

    def _reply(self, number: int) -> Arrays | None:
        """What a worker answers; None where it is dead or hangs."""
        reply = self._workers[number].receive()
        if isinstance(reply, SlrlError):
            if isinstance(reply, SumoError):
                return None
            raise reply
        if isinstance(reply, str):
            raise RuntimeError(f"a training worker failed:\n{reply}")
        arrays: Arrays | None = reply
        return arrays

    def _revive(self, number: int) -> Arrays:
        """Replace a worker and open another scenario in it."""
        while True:
            self._failures[number] += 1
            self.replaced += 1
            worker = self._workers[number]
            how = worker.epitaph()
            if self._failures[number] > ATTEMPTS:
                raise SumoError(f"training worker {number} died {ATTEMPTS} times in a row (last: {how})")
            worker.restart()
            worker.send(("reset", self._reset_seed(number)))
            reply = self._reply(number)
            if reply is not None:
                return reply


class _Worker:
    """A process with an arena, and the pipe to it."""

    def __init__(self, source: ArenaSource) -> None:
        self._source = source
        self._context = multiprocessing.get_context("spawn")
        self.memory = 0.0
        self._start()

    def _start(self) -> None:
        self._pipe, theirs = self._context.Pipe()
        self._folder = tempfile.TemporaryDirectory(prefix="slrl_sumo_", ignore_cleanup_errors=True)
        self.process = self._context.Process(target=_serve, args=(theirs, self._source, self._folder.name), daemon=True)
        # Ctrl-C reaches the whole process group; the trainer decides what it means. The child inherits the mask.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def send(self, message: Any) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # dead; whoever waits for its answer will see
            self._pipe.send(message)

    def receive(self) -> Any:
        try:
            if self._pipe.poll(PATIENCE):
                self.memory, reply = self._pipe.recv()
                return reply
        except (EOFError, OSError):
            pass
        return None

    def epitaph(self) -> str:
        self.process.join(0.2)
        code = self.process.exitcode
        if code is None:
            return f"no answer within {PATIENCE:g} s"
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"

    def restart(self) -> None:
        self.stop()
        self._start()

    def stop(self) -> None:
        self._pipe.close()  # the worker ends when it sees that
        self.process.join(2.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self._folder.cleanup()


def _serve(pipe: Connection, source: ArenaSource, folder: str) -> None:
    """The worker: opens and steps arenas as it is told, until the pipe closes."""
    import torch

    torch.set_num_threads(1)
    # Whatever SUMO leaves behind when it dies lies in a folder that the parent removes.
    tempfile.tempdir = folder
    _silence(Path(folder) / "printed")
    bundle = None
    with ExitStack() as open_arena:
        arena: Arena | None = None
        while True:
            try:
                word, value = pipe.recv()
            except (EOFError, OSError):
                return
            try:
                if word == "reset":
                    open_arena.close()
                    bundle = bundle or load_bundle(source.bundle)
                    drawn = np.random.default_rng(value)
                    scenario = find_scenario(source.scenarios[int(drawn.integers(len(source.scenarios)))])
                    arena = open_arena.enter_context(
                        Arena(scenario, bundle, source.settings, int(drawn.integers(2**31)))
                    )
                    reply: Any = _seen(arena.observation) | {"guidance": arena.guidance()}
                else:
                    assert arena is not None
                    reply = _flat(arena.step(value)) | {"guidance": arena.guidance()}
            except SlrlError as error:
                reply = error
            except Exception:
                import traceback

                reply = traceback.format_exc()
            try:
                pipe.send((_memory(), reply))
            except (BrokenPipeError, ConnectionResetError):
                return


def _silence(file: Path) -> None:
    """What SUMO's C++ code prints would tear the trainer's progress apart."""
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)


def _memory() -> float:
    """Greatest resident memory of this process so far, MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0 if sys.platform != "darwin" else 1024.0**2)


def _seen(observation: Observation) -> Arrays:
    assert observation.image is not None
    assert observation.ahead is not None
    seen: Arrays = {"vector": observation.vector, "image": observation.image, "ahead": observation.ahead}
    if observation.route is not None:
        seen["route"] = observation.route
    return seen | {"type": observation.type}


def _flat(outcome: Outcome) -> Arrays:
    """An outcome as arrays of n rows; the final observations are those of the ended episodes only."""
    reply = _seen(outcome.observation)
    seen = [name for name in reply if name != "type"]
    ended = outcome.terminated | outcome.truncated
    reply |= {"reward": outcome.reward, "terminated": outcome.terminated, "truncated": outcome.truncated}
    reply |= {"speed_mps": outcome.speed, "steps": outcome.steps, **outcome.terms}
    reply |= {"replaced": np.zeros(len(ended), np.bool_)}
    for name in seen:
        reply[f"final_{name}"] = reply[name][:0] if outcome.final is None else getattr(outcome.final, name)
    return reply


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
        **{f"final_{name}": last[name] for name in ("vector", "image", "ahead", "route") if name in last},
    }


def _joined(parts: list[Arrays], names: tuple[str, ...]) -> Arrays:
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
