"""The simulation of an environment in a child process."""

import pickle
import weakref
from dataclasses import dataclass
from typing import Any

import cloudpickle
import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.jobs.process import WorkerDiedError, WorkerProcess, in_worker
from slrl_sumo.learning.environments.simulation_env import SimulationVectorEnv
from slrl_sumo.learning.environments.slots import all_masks
from slrl_sumo.learning.environments.source import ArenaSource

MEMORY_LIMIT = 1500.0
"""Memory (MiB) of a process above which the next reset replaces it: SUMO and its libraries do not free all memory."""


@dataclass(frozen=True, eq=False)
class Reply:
    """The result of SimulationVectorEnv.reset or step, and further data for the views; n slots."""

    seen: Any
    infos: dict[str, Any]
    ids: tuple[str | None, ...]
    """Present road user of each slot, (n,); None for slots without one."""
    type: NDArray[np.int8]
    """RoadUserType of each slot, (n,)."""
    speed: NDArray[np.float64]
    """Present speed of each slot, m/s, (n,)."""
    masks: NDArray[np.int8]
    """Allowed modes, (n, modes)."""
    scenario: str
    seconds_left: float
    """Time (s) until the scenario ends."""
    memory: float
    """Peak memory of the process so far, MiB."""
    reward: NDArray[np.float64] | None = None
    terminated: NDArray[np.bool_] | None = None
    truncated: NDArray[np.bool_] | None = None


class SimulationWork:
    """The work of a process: the SimulationVectorEnv of a pickled ArenaSource.

    Messages are pairs of the name of a method below and its arguments.
    """

    def __init__(self, source: bytes) -> None:
        self.source = source
        self._env: SimulationVectorEnv | None = None

    def __call__(self, message: tuple[str, tuple[Any, ...]]) -> Any:
        """Answer a message."""
        torch.set_num_threads(1)  # the models are so small that several threads only wait for each other
        self._env = self._env or SimulationVectorEnv(pickle.loads(self.source))
        name, arguments = message
        return getattr(self, name)(self._env, *arguments)

    def reset(self, env: SimulationVectorEnv, seed: int, scenario: str | None) -> Reply:
        """Start again."""
        seen, infos = env.reset(seed=seed, options={"scenario": scenario})
        return self._reply(env, seen, infos)

    def step(self, env: SimulationVectorEnv, modes: NDArray[np.int64]) -> Reply:
        """One decision."""
        seen, reward, terminated, truncated, infos = env.step(modes)
        return self._reply(env, seen, infos, reward, terminated, truncated)

    def picture(self, env: SimulationVectorEnv, road_user: str, before_reset: bool) -> NDArray[np.uint8]:
        """The surroundings of a road user from above, (512, 512, 3) RGB.

        `before_reset`: at the end of the last decision; otherwise after new episodes began.
        """
        from slrl_sumo.perception.top_view import top_view

        world = env.slots.world if before_reset else env.slots.arena.simulation.world
        return top_view(world, world.ids.index(road_user), env.slots.arena.simulation.road_map)

    def close(self) -> None:
        """End the simulation."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def _reply(self, env: SimulationVectorEnv, seen: Any, infos: dict[str, Any], *outcome: Any) -> Reply:
        slots, users = env.slots, env.slots.arena.simulation.population.world
        ids: list[str | None] = [None] * env.num_envs
        for slot, road_user in zip(slots.slots.tolist(), users.ids, strict=True):
            ids[slot] = road_user
        kinds, speeds = np.zeros(env.num_envs, np.int8), np.zeros(env.num_envs)
        kinds[slots.slots], speeds[slots.slots] = users.type, users.speed
        left, memory = slots.arena.seconds_left, peak_memory_mib()
        return Reply(seen, infos, tuple(ids), kinds, speeds, all_masks(slots), env.scenario, left, memory, *outcome)


class SimulationProcess:
    """A SimulationVectorEnv in a child process, so that a Python process may have several and survives crashes of SUMO.

    In a process that may not start another process (the workers of gymnasium's AsyncVectorEnv and of SubprocVecEnv),
    the simulation runs in the same process. Raises the errors of SimulationVectorEnv, and SumoError if the process
    died; a reset then starts again.
    """

    def __init__(self, source: ArenaSource) -> None:
        self._work = SimulationWork(cloudpickle.dumps(source))  # holds functions of scripts and notebooks by value
        self._process: WorkerProcess | None = None
        self._here = in_worker()
        self._memory = 0.0

    def reset(self, seed: int, scenario: str | None = None) -> Reply:
        """Open the simulation of a seed; a given `scenario` replaces the present one from now on."""
        if self._memory > MEMORY_LIMIT:
            self.close()
        reused = self._process is not None
        try:
            reply: Reply = self._asked("reset", seed, scenario)
        except SumoError:
            if not reused:
                raise
            # A process that has simulated before may die when libsumo loads again; a new process gives the same result.
            reply = self._asked("reset", seed, scenario)
        return reply

    def step(self, modes: NDArray[np.int64]) -> Reply:
        """Run one decision; `modes` (n,): -1 lets the selector `others` decide."""
        reply: Reply = self._asked("step", modes)
        return reply

    def picture(self, road_user: str, before_reset: bool) -> NDArray[np.uint8]:
        """See SimulationWork.picture."""
        picture: NDArray[np.uint8] = self._asked("picture", road_user, before_reset)
        return picture

    def close(self) -> None:
        """End the process."""
        self._memory = 0.0
        self._work.close()
        if self._process is not None:
            self._end()
            self._process = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy with a separate process, because wrappers copy environments."""
        return SimulationProcess, (pickle.loads(self._work.source),)

    def _asked(self, name: str, *arguments: Any) -> Any:
        if self._here:
            answer = self._work((name, arguments))
        else:
            if self._process is None:
                self._process = WorkerProcess(pickle.dumps(self._work), by_value=True)
                self._end = weakref.finalize(self, self._process.close)
            self._process.send(pickle.dumps((name, arguments)))
            try:
                answer = pickle.loads(self._process.receive())
            except WorkerDiedError as death:
                self.close()
                raise SumoError(f"the simulation ended: {death.printed_error or death}; call reset()") from None
            except BaseException:  # the answer of an interrupted request must not be that of the next
                self.close()
                raise
            if isinstance(answer, BaseException):
                self.close()
                raise answer
        if isinstance(answer, Reply):
            self._memory = answer.memory
        return answer
