"""Rollouts of several simulations, each in a worker process, on this machine or on a Ray cluster.

Each worker gets the weights and acts with its own copy of the policy: between two updates of the policy, no data
crosses a process border. The simulation of a worker depends only on its Request, not on its process: a process that
dies is replaced by a process that simulates the same again, and the training continues exactly as without the loss.
"""

import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load, save

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.jobs.pool import Backend, Failures, ask_all
from slrl_sumo.jobs.process import WorkerDiedError
from slrl_sumo.jobs.ray_workers import RayActors
from slrl_sumo.jobs.workers import LocalWorkers, MachineLostError
from slrl_sumo.learning.environments.seeds import drawn_seed
from slrl_sumo.learning.environments.simulation_env import SimulationVectorEnv
from slrl_sumo.learning.environments.simulation_process import MEMORY_LIMIT
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.rl.actor import Actor, Agent
from slrl_sumo.learning.rl.batch import Batch, joined
from slrl_sumo.learning.rl.rollout import rollout
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.models.threads import one_thread

TIMEOUT = 120.0
"""Greatest time (s) of a worker for the start of a simulation."""
WORKER_ATTEMPTS = 5
"""Number of successive failures of a worker after which the training fails."""
STEP_TIMEOUT = 2.0
"""Additional time (s) of a worker for each step."""


@dataclass(frozen=True)
class Request:
    """The simulation that a worker continues."""

    draw: tuple[int, ...]
    """Numbers that draw the simulation."""
    past: NDArray[np.uint8]
    """Modes chosen so far, (steps, n)."""
    num_steps: int
    seed: int
    """Seed of the drawn modes."""


@dataclass(frozen=True)
class Result:
    """A rollout of one simulation."""

    batch: Batch
    infos: list[dict[str, Any]]
    memory: float
    """Peak memory of the process so far, MiB."""


class RolloutWorker:
    """The work of a process: continues its simulation, or first repeats the past of a request in a new simulation."""

    def __init__(self, source: ArenaSource, config: PolicyConfig, explore: float) -> None:
        self._source, self._config, self._explore = source, config, explore
        self._env: SimulationVectorEnv | None = None  # made in the process: its spaces are large
        self._actor: Actor | None = None
        self._at: tuple[tuple[int, ...], int] | None = None
        """Draw and number of steps of the open simulation."""
        self._seen: tuple[dict[str, NDArray[Any]], NDArray[np.float32]] = {}, np.zeros((0, 0), np.float32)

    @one_thread()
    def __call__(self, message: tuple[bytes, bytes]) -> Result:
        """Answer a pickled Request with a policy of these weights (safetensors)."""
        request: Request = pickle.loads(message[0])
        self._env = env = self._env or SimulationVectorEnv(self._source)
        if self._actor is None:
            prior = load_bundle(self._source.bundle).prior
            self._actor = Actor(Policy(self._config), prior, self._explore, torch.device("cpu"))
        self._actor.policy.load_state_dict(load(message[1]))
        at, self._at = self._at, None  # unknown if the rollout fails
        if at != (request.draw, len(request.past)):
            start, info = env.reset(seed=drawn_seed(*request.draw))
            for modes in request.past:
                start, *_, info = env.step(modes)
            self._seen = start, info["teacher_costs"]
        generator = torch.Generator().manual_seed(request.seed)
        observation, teacher_costs = self._seen
        batch, observation, infos, teacher_costs = rollout(
            self._actor, env, observation, teacher_costs, request.num_steps, generator
        )
        self._seen = observation, teacher_costs
        self._at = request.draw, len(request.past) + request.num_steps
        return Result(batch, infos, peak_memory_mib())


class WorkerRollouts:
    """See slrl_sumo.learning.rl.ppo.Rollouts: `backend.workers` simulations of `source`, with policies of `config`.

    Raises InputError if a worker cannot load scenario or bundle, SumoError if a worker fails WORKER_ATTEMPTS times in
    succession.
    """

    def __init__(self, source: ArenaSource, config: PolicyConfig, explore: float, backend: Backend) -> None:
        self.replaced = 0
        """Number of workers that were replaced because they died or timed out."""
        self._count = backend.workers or 1
        self._no_past = np.zeros((0, source.settings.agents), np.uint8)
        self._seed = 0
        self._memory = [0.0] * self._count
        self._draws: list[tuple[int, ...]] = [()] * self._count
        self._past = [self._no_past] * self._count
        work = pickle.dumps(RolloutWorker(source, config, explore))
        self._workers = (
            LocalWorkers(work, self._count) if backend.ray is None else RayActors(work, self._count, backend.ray)
        )

    def reset(self, seed: int) -> None:
        """See Rollouts."""
        self._seed = seed
        for number in range(self._count):
            self._restart(number, 0)
            if self._memory[number] > MEMORY_LIMIT:
                self._workers.replace(number)
                self._memory[number] = 0.0

    def collect(self, agent: Agent, num_steps: int, seed: int) -> tuple[Batch, list[dict[str, Any]]]:
        """See Rollouts."""
        state = agent.policy.state_dict()
        self._workers.publish(save({name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}))
        failures = Failures(WORKER_ATTEMPTS)
        restarted = set()

        def begin(number: int) -> None:
            drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
            request = Request(self._draws[number], self._past[number], num_steps, drawn)
            timeout = TIMEOUT + STEP_TIMEOUT * (len(request.past) + num_steps)
            self._workers.begin(number, pickle.dumps(request), timeout)

        def failed(number: int, error: SumoError) -> None:
            self.replaced += 1
            # The first death of a process may have a cause outside its simulation. After a second death, or a failure
            # of SUMO, which would happen again, another simulation is drawn.
            if not isinstance(error, WorkerDiedError | MachineLostError) or failures.deaths[number] > 1:
                self._restart(number, failures.deaths[number])
                restarted.add(number)

        answers = ask_all(self._workers, range(self._count), begin, failed, failures)
        results: list[Result] = [answers[number] for number in range(self._count)]
        for number, result in enumerate(results):
            self._memory[number] = result.memory
            self._past[number] = np.concatenate([self._past[number], result.batch.actions.numpy().astype(np.uint8)])
            if number in restarted:
                result.infos[0]["replaced"][:] = True
        infos = [
            {name: np.concatenate([info[name] for info in step]) for name in step[0]}
            for step in zip(*(result.infos for result in results), strict=True)
        ]
        return joined([result.batch for result in results]), infos

    def close(self) -> None:
        """End all workers."""
        self._workers.close()

    def _restart(self, number: int, attempt: int) -> None:
        self._draws[number] = self._seed, number, attempt
        self._past[number] = self._no_past
