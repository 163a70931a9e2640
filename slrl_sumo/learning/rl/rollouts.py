"""Rollouts of several simulations, a worker process each, on this machine or on a Ray cluster.

Every worker gets the weights and plays with a policy of its own: between two updates nothing crosses a border. What it
plays depends on what it is asked for alone (`Order`), not on which process does it, so one that dies is replaced by one
that plays the same again, and the training goes on as if nothing had been.
"""

import os
import pickle
import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load, save

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.pool import MACHINES, Lost, Place
from slrl_sumo.jobs.worker import Died, JobWorker
from slrl_sumo.learning.rl.arena_slots import OBSERVED, ArenaSlots, ArenaSource, peak_memory
from slrl_sumo.learning.rl.ppo import Actor, Agent, Batch, joined, rollout
from slrl_sumo.learning.rl.vector_env import ATTEMPTS, MEMORY_LIMIT, PATIENCE
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy, PolicyConfig

STEP_PATIENCE = 2.0
"""s more that a worker may take for each step."""


@dataclass(frozen=True)
class Order:
    """What a worker is to play."""

    draw: tuple[int, ...]
    """What draws the simulation."""
    past: NDArray[np.uint8]
    """(steps, n): the modes that were chosen in it before."""
    num_steps: int
    seed: int
    """Of the choices."""


@dataclass(frozen=True)
class Part:
    """A rollout of one simulation."""

    batch: Batch
    infos: list[dict[str, Any]]
    memory: float
    """MiB of the process so far."""


class Roller:
    """What a worker does, from order to order: it goes on where it is, or plays the past again if it is not there."""

    def __init__(self, source: ArenaSource, config: PolicyConfig, explore: float) -> None:
        self._source, self._config, self._explore = source, config, explore
        self._slots = ArenaSlots(source)
        self._actor: Actor | None = None
        self._at: tuple[tuple[int, ...], int] | None = None
        self._seen: tuple[dict[str, NDArray[Any]], NDArray[np.float32]] = {}, np.zeros((0, 0), np.float32)

    def __call__(self, message: tuple[bytes, bytes]) -> Part:
        """Play a pickled Order with a policy of these weights (safetensors)."""
        torch.set_num_threads(1)
        order: Order = pickle.loads(message[0])
        if self._actor is None:
            prior = load_bundle(self._source.bundle).prior
            self._actor = Actor(Policy(self._config), prior, self._explore, torch.device("cpu"))
        self._actor.policy.load_state_dict(load(message[1]))
        at, self._at = self._at, None  # nowhere, should this fail
        if at != (order.draw, len(order.past)):
            reply = self._slots.reset(order.draw)
            for modes in order.past:
                reply = self._slots.flat_step(modes.astype(np.int64))
            self._seen = {name: reply[name] for name in OBSERVED if name in reply}, reply["guidance"]
        generator = torch.Generator().manual_seed(order.seed)
        observation, guidance = self._seen
        batch, observation, infos, guidance = rollout(
            self._actor, self._slots, observation, guidance, order.num_steps, generator
        )
        self._seen = observation, guidance
        self._at = order.draw, len(order.past) + order.num_steps
        return Part(batch, infos, peak_memory())


class Team(Protocol):
    """Workers by number, each with a simulation."""

    def publish(self, weights: bytes) -> None:
        """The weights for all orders from now on."""

    def begin(self, number: int, order: bytes, patience: float) -> None:
        """Give a worker a pickled order, for which it has so many s."""

    def wait(self) -> list[tuple[int, bytes | Died | Lost]]:
        """Pickled answers of those that have ended since, by number."""

    def replace(self, number: int) -> None:
        """A fresh process for a worker."""

    def close(self) -> None:
        """End them all."""


class WorkerRollouts:
    """See slrl_sumo.learning.rl.ppo.Rollouts: `place.workers` simulations of `source`, with policies of `config`.

    Raises InputError where a worker cannot load what it is to play, SumoError where one dies ATTEMPTS times in a row.
    """

    def __init__(self, source: ArenaSource, config: PolicyConfig, explore: float, place: Place) -> None:
        self.replaced = 0
        """How often a worker was replaced because it died or hung."""
        count = place.workers or 1
        self._agents = source.settings.agents
        self._memory = [0.0] * count
        self._seed = 0
        self._draws: list[tuple[int, ...]] = [()] * count
        self._past = [np.zeros((0, self._agents), np.uint8)] * count
        work = pickle.dumps(Roller(source, config, explore))
        if place.ray is None:
            self._team: Team = ProcessTeam(work, count)
        else:
            from slrl_sumo.jobs.ray_actors import RayTeam

            self._team = RayTeam(work, count, place.ray)

    def reset(self, seed: int) -> None:
        """See Rollouts."""
        self._seed = seed
        for number in range(len(self._draws)):
            self._begin_anew(number, 0)
            if self._memory[number] > MEMORY_LIMIT:
                self._team.replace(number)
                self._memory[number] = 0.0

    def collect(self, agent: Agent, num_steps: int, seed: int) -> tuple[Batch, list[dict[str, Any]]]:
        """See Rollouts."""
        state = agent.policy.state_dict()
        self._team.publish(save({name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}))
        missing = set(range(len(self._draws)))
        parts: dict[int, Part] = {}
        failures, lost = dict.fromkeys(missing, 0), dict.fromkeys(missing, 0)
        begun_anew = set()
        for number in missing:
            self._order(number, num_steps, seed)
        while missing:
            for number, answer in self._team.wait():
                outcome = answer if isinstance(answer, Died | Lost) else pickle.loads(answer)
                if isinstance(outcome, Part):
                    parts[number] = outcome
                    missing.discard(number)
                    self._memory[number] = outcome.memory
                    chosen = outcome.batch.actions.numpy().astype(np.uint8)
                    self._past[number] = np.concatenate([self._past[number], chosen])
                    continue
                if isinstance(outcome, BaseException) and not isinstance(outcome, SumoError):
                    raise outcome
                self.replaced += 1
                if isinstance(outcome, Lost):
                    lost[number] += 1
                else:
                    failures[number] += 1
                if failures[number] > ATTEMPTS or lost[number] > MACHINES:
                    raise SumoError(f"training worker {number} died {ATTEMPTS} times in a row (last: {outcome})")
                # Who was killed may have had nothing to do with it; who dies again, or gives up, would always do so.
                if isinstance(outcome, SumoError) or failures[number] > 1:
                    self._begin_anew(number, failures[number])
                    begun_anew.add(number)
                self._team.replace(number)
                self._order(number, num_steps, seed)
        for number in begun_anew:
            parts[number].infos[0]["replaced"][:] = True
        ordered = [parts[number] for number in range(len(parts))]
        infos = [
            {name: np.concatenate([info[name] for info in step]) for name in step[0]}
            for step in zip(*(part.infos for part in ordered), strict=True)
        ]
        return joined([part.batch for part in ordered]), infos

    def close(self) -> None:
        """End all workers."""
        self._team.close()

    def _begin_anew(self, number: int, attempt: int) -> None:
        self._draws[number] = self._seed, number, attempt
        self._past[number] = self._past[number][:0]

    def _order(self, number: int, num_steps: int, seed: int) -> None:
        drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
        order = Order(self._draws[number], self._past[number], num_steps, drawn)
        patience = PATIENCE + STEP_PATIENCE * (len(order.past) + num_steps)
        self._team.begin(number, pickle.dumps(order), patience)


class ProcessTeam:
    """See Team: child processes of this one."""

    def __init__(self, work: bytes, count: int) -> None:
        self._work, self._weights = work, b""
        self.workers = [JobWorker(work) for _ in range(count)]
        self._deadlines: dict[int, float] = {}

    def publish(self, weights: bytes) -> None:
        """See Team."""
        self._weights = weights

    def begin(self, number: int, order: bytes, patience: float) -> None:
        """See Team."""
        self._deadlines[number] = time.monotonic() + patience
        self.workers[number].send(pickle.dumps((order, self._weights)))

    def wait(self) -> list[tuple[int, bytes | Died | Lost]]:
        """See Team."""
        first = min(self._deadlines.values()) - time.monotonic()
        ready = wait([self.workers[number].pipe for number in self._deadlines], max(0.0, first))
        answers: list[tuple[int, bytes | Died | Lost]] = []
        for number, deadline in list(self._deadlines.items()):
            if self.workers[number].pipe in ready or deadline < time.monotonic():
                del self._deadlines[number]
                answers.append((number, self.workers[number].receive(0.0)))
        return answers

    def replace(self, number: int) -> None:
        """See Team."""
        self.workers[number].stop()
        self.workers[number] = JobWorker(self._work)

    def kill(self, number: int) -> None:
        """Kill a worker as a crash would, to see that it is replaced."""
        os.kill(self.workers[number].pid, signal.SIGKILL)

    def close(self) -> None:
        """See Team."""
        for worker in self.workers:
            worker.stop()
