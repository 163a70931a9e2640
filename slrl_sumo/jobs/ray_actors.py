"""Rollout workers as Ray actors: each holds the same worker process as a machine without Ray does."""

import pickle
import time
from contextlib import ExitStack
from typing import Any

from slrl_sumo.jobs.pool import Lost
from slrl_sumo.jobs.ray_cluster import check_head, ray_cluster
from slrl_sumo.jobs.ray_jobs import LOOK_S, perform, received
from slrl_sumo.jobs.worker import Died
from slrl_sumo.version import __version__

FIND_S = 10.0
"""s in which Ray must have found a core for a new actor."""


class Host:
    """The actor. Weights come through the object store: once to each machine, however many actors it has."""

    def __init__(self, work: bytes) -> None:
        self._work = work

    def ready(self) -> None:
        """Answers when the actor has begun."""

    def perform(self, version: str, weights: bytes, order: bytes) -> bytes | Died:
        """Pass an order on to the worker process of this actor."""
        return perform(version, self._work, pickle.dumps((order, weights)))


class RayTeam:
    """See slrl_sumo.learning.rl.rollouts.Team. An actor holds one core. Where there are fewer cores than workers,
    because a machine was lost or so many were asked for, the others share them."""

    def __init__(self, work: bytes, count: int, address: str) -> None:
        self._open = ExitStack()
        self._ray = self._open.enter_context(ray_cluster(address, count))
        self._address = address
        self._host = self._ray.remote(max_restarts=0, max_task_retries=0)(Host)
        self._work, self._weights = self._ray.put(work), None
        self._running: dict[Any, tuple[int, float]] = {}
        self._cores: list[int] = []
        self._actors: list[Any] = []
        for _ in range(count):
            core = self._free_core()
            self._cores.append(core)
            self._actors.append(self._hire(core))

    def publish(self, weights: bytes) -> None:
        """See Team."""
        self._weights = self._ray.put(weights)

    def begin(self, number: int, order: bytes, patience: float) -> None:
        """See Team."""
        call = self._actors[number].perform.remote(__version__, self._weights, order)
        self._running[call] = number, time.monotonic() + patience

    def wait(self) -> list[tuple[int, bytes | Died | Lost]]:
        """See Team."""
        ready, _ = self._ray.wait(list(self._running), num_returns=1, timeout=LOOK_S)
        if not ready:
            check_head(self._ray, self._address)
        answers: list[tuple[int, bytes | Died | Lost]] = []
        for call, (number, deadline) in list(self._running.items()):
            if call in ready:
                answers.append((number, received(self._ray, self._address, call)))
            elif deadline < time.monotonic():
                answers.append((number, Died("no answer in time")))
            else:
                continue
            del self._running[call]
        return answers

    def replace(self, number: int) -> None:
        """See Team."""
        self._ray.kill(self._actors[number])
        self._cores[number] = 0
        core = self._free_core()
        actor = self._hire(core)
        if core and not self._ray.wait([actor.ready.remote()], timeout=FIND_S)[0]:
            self._ray.kill(actor)  # Ray takes half a minute to see that a machine is dead, and counted its cores
            core, actor = 0, self._hire(0)
        self._cores[number], self._actors[number] = core, actor

    def close(self) -> None:
        """See Team."""
        self._open.close()

    def _free_core(self) -> int:
        cores = sum(node["Resources"].get("CPU", 0.0) for node in self._ray.nodes() if node["Alive"])
        return int(sum(self._cores) < cores)

    def _hire(self, core: int) -> Any:
        return self._host.options(num_cpus=core).remote(self._work)
