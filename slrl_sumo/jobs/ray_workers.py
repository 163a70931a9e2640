"""Worker processes on a Ray cluster: each machine holds the same worker processes as a machine without Ray does.

A Ray task or actor passes its request on to a WorkerProcess of its own, so that a crash of SUMO does not end Ray's
process, and differs from the loss of a machine. Ray itself retries nothing: slrl_sumo.jobs.pool does, and counts.
"""

import math
import pickle
import time
from contextlib import ExitStack
from typing import Any

from slrl_sumo.errors import InputError
from slrl_sumo.jobs.process import WorkerDiedError, WorkerProcess
from slrl_sumo.jobs.ray_cluster import LOCAL, check_head, ray_cluster
from slrl_sumo.jobs.workers import MAX_REQUESTS, MachineLostError
from slrl_sumo.version import __version__

QUEUED_SHARE = 0.125
"""Tasks beyond the number of cores, as a share of it: they wait on the cluster, so that no core waits for this
process."""

LOOK_S = 2.0
"""s between two looks at the size of the cluster: machines come and go."""

FIND_S = 10.0
"""s in which Ray must have found a core for a new actor."""


class _RayCalls:
    """Calls under way on a Ray cluster, each by the number of its request."""

    def __init__(self, address: str, cpus: int | None) -> None:
        self._open = ExitStack()
        self._ray = self._open.enter_context(ray_cluster(address, cpus))
        self._address = address
        self._running: dict[Any, tuple[int, float]] = {}

    def wait(self) -> list[tuple[int, Any]]:
        """See LocalWorkers; after LOOK_S without an answer the list is empty."""
        ready, waiting = self._ray.wait(list(self._running), num_returns=1, timeout=LOOK_S)
        if not ready:
            check_head(self._ray, self._address)
        elif waiting:
            ready = ready + self._ray.wait(waiting, num_returns=len(waiting), timeout=0)[0]
        ended: list[tuple[int, Any]] = [(self._running.pop(call)[0], self._outcome(call)) for call in ready]
        now = time.monotonic()
        for call in [call for call, (_, deadline) in self._running.items() if deadline < now]:
            ended.append((self._running.pop(call)[0], WorkerDiedError("no answer in time")))
        return ended

    def close(self) -> None:
        """Leave the cluster; what was begun there ends."""
        self._open.close()

    def _outcome(self, call: Any) -> Any:
        """What a call returned, or MachineLostError. Raises InputError if a machine cannot run it."""
        try:
            return pickle.loads(self._ray.get(call))
        except self._ray.exceptions.RayTaskError as error:
            cause = str(error.cause).splitlines()[-1] if error.cause else str(error)
            raise InputError(
                f"a machine of the cluster cannot run this ({cause}); install slrl-sumo {__version__} on all of them",
                argument="ray",
                value=self._address,
            ) from None
        except self._ray.exceptions.RayError as error:
            return MachineLostError(f"its machine was lost ({type(error).__name__})")


class RayTasks(_RayCalls):
    """Requests as Ray tasks, which any machine of the cluster may take.

    `workers`: number of tasks at once, or None: as many as the cluster has cores, and QUEUED_SHARE more. A Ray instance
    of its own (address "local") has that many cores.
    """

    def __init__(self, work: bytes, address: str, workers: int | None) -> None:
        super().__init__(address, workers)
        self._limit = None if address == LOCAL else workers
        self._task = self._ray.remote(max_retries=0, num_cpus=1)(perform)
        self._work = self._ray.put(work)
        self._looked = -math.inf
        self._capacity = 1

    def capacity(self) -> int:
        """See LocalWorkers."""
        if time.monotonic() > self._looked + LOOK_S:
            check_head(self._ray, self._address)
            cores = int(self._ray.cluster_resources().get("CPU", 0))
            self._capacity = self._limit or max(1, cores + math.ceil(QUEUED_SHARE * cores))
            self._looked = time.monotonic()
        return self._capacity

    def begin(self, number: int, request: bytes) -> None:
        """See LocalWorkers; the task may run on any machine."""
        self._running[self._task.remote(__version__, self._work, request)] = number, math.inf


class RayActors(_RayCalls):
    """`count` workers by number, a Ray actor with one core each. Where there are fewer cores than workers, because a
    machine was lost or `count` is higher, the other actors share them."""

    def __init__(self, work: bytes, count: int, address: str) -> None:
        super().__init__(address, count)
        self._actor = self._ray.remote(max_restarts=0, max_task_retries=0)(Actor)
        self._work = self._ray.put(work)
        self._shared: Any = None
        self._cores = [0] * count
        self._actors: list[Any] = [None] * count
        for number in range(count):
            self._start(number, self._free_core())

    def publish(self, shared: bytes) -> None:
        """See LocalWorkers; through the object store, once to each machine however many actors it has."""
        self._shared = self._ray.put(shared)

    def begin(self, number: int, request: bytes, timeout: float = math.inf) -> None:
        """See LocalWorkers."""
        call = self._actors[number].perform.remote(__version__, self._shared, request)
        self._running[call] = number, time.monotonic() + timeout

    def replace(self, number: int) -> None:
        """See LocalWorkers."""
        self._ray.kill(self._actors[number])
        self._cores[number] = 0
        self._start(number, self._free_core())
        # Ray needs half a minute to notice that a machine is dead, and counts its cores until then.
        if self._cores[number] and not self._ray.wait([self._actors[number].ready.remote()], timeout=FIND_S)[0]:
            self._ray.kill(self._actors[number])
            self._start(number, 0)

    def _free_core(self) -> int:
        cores = sum(node["Resources"].get("CPU", 0.0) for node in self._ray.nodes() if node["Alive"])
        return int(sum(self._cores) < cores)

    def _start(self, number: int, core: int) -> None:
        self._cores[number] = core
        self._actors[number] = self._actor.options(num_cpus=core).remote(self._work)


class Actor:
    """A worker on a Ray cluster."""

    def __init__(self, work: bytes) -> None:
        self._work = work

    def ready(self) -> None:
        """Returns when the actor has started."""

    def perform(self, version: str, shared: bytes | None, request: bytes) -> bytes:
        """Pass a request on to the worker process of this actor."""
        return perform(version, self._work, pickle.dumps((request, shared)))


_process: WorkerProcess | None = None
"""Worker process of this Ray process, which lives from task to task."""


def perform(version: str, work: bytes, request: bytes) -> bytes:
    """The Ray task: pass a request on to the worker process of this Ray process and return its pickled answer."""
    global _process
    if version != __version__:
        return pickle.dumps(
            InputError(f"a machine of the cluster has slrl-sumo {__version__}, this is {version}; install the same")
        )
    if _process is not None and (_process.requests >= MAX_REQUESTS or _process.work != work):
        _process.close()
        _process = None
    _process = _process or WorkerProcess(work)
    _process.send(request)
    try:
        return _process.receive()
    except WorkerDiedError as death:
        _process.close()
        _process = None
        return pickle.dumps(death)
