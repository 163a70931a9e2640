"""Jobs as Ray tasks: each machine of the cluster holds the same worker processes as a machine without Ray does.

A task passes its job on to a process of its own (job_worker.py), so that SUMO's death is not Ray's, and is told apart
from that of a machine. Ray itself tries nothing again: jobs.py does, and counts.
"""

import math
import pickle
import time
from contextlib import ExitStack
from typing import Any

from slrl_sumo.errors import InputError
from slrl_sumo.jobs.pool import Lost
from slrl_sumo.jobs.ray_address import LOCAL
from slrl_sumo.jobs.ray_cluster import check_head, ray_cluster
from slrl_sumo.jobs.worker import Died, JobWorker
from slrl_sumo.version import __version__

AHEAD = 0.125
"""Tasks beyond the number of cores, as a share of it: they wait on the cluster, so that cores do not wait for us."""

LOOK_S = 2.0
"""s between two looks at how large the cluster is: machines come and go."""


class RayCrew:
    """See slrl_sumo.jobs.pool.Crew. `workers`: at most so many jobs at once; with a Ray of our own, its cores."""

    def __init__(self, work: bytes, address: str, workers: int | None) -> None:
        self._open = ExitStack()
        self._ray = self._open.enter_context(ray_cluster(address, workers))
        self._address = address
        self._most = None if address == LOCAL else workers
        self._task = self._ray.remote(max_retries=0, num_cpus=1)(perform)
        self._work = self._ray.put(work)
        self._running: dict[Any, int] = {}
        self._looked = -math.inf
        self._room = 1

    def free(self) -> bool:
        """See Crew."""
        if time.monotonic() > self._looked + LOOK_S:
            check_head(self._ray, self._address)
            cores = int(self._ray.cluster_resources().get("CPU", 0))
            self._room = self._most or max(1, cores + math.ceil(AHEAD * cores))
            self._looked = time.monotonic()
        return len(self._running) < self._room

    def begin(self, number: int, job: bytes) -> None:
        """See Crew."""
        self._running[self._task.remote(__version__, self._work, job)] = number

    def wait(self) -> list[tuple[int, bytes | Died | Lost]]:
        """See Crew."""
        waiting = list(self._running)
        ready, waiting = self._ray.wait(waiting, num_returns=1, timeout=LOOK_S)
        if ready and waiting:
            more, _ = self._ray.wait(waiting, num_returns=len(waiting), timeout=0)
            ready += more
        return [(self._running.pop(task), received(self._ray, self._address, task)) for task in ready]

    def close(self) -> None:
        """See Crew."""
        self._open.close()


def received(ray: Any, address: str, call: Any) -> bytes | Died | Lost:
    """What a task or the method of an actor gave back. Raises InputError where a machine cannot run it."""
    try:
        answer: bytes | Died = ray.get(call)
    except ray.exceptions.RayTaskError as error:
        cause = str(error.cause).splitlines()[-1] if error.cause else str(error)
        raise InputError(
            f"--ray {address}: a machine of the cluster cannot run this ({cause}); "
            f"install slrl-sumo {__version__} on all of them"
        ) from None
    except ray.exceptions.RayError as error:
        return Lost(f"its machine was lost ({type(error).__name__})")
    return answer


_worker: JobWorker | None = None
"""Of this process of Ray, which stays alive from task to task."""


def perform(version: str, work: bytes, job: bytes) -> bytes | Died:
    """The task: do a job in a process of its own, the same as for the job before."""
    global _worker
    if version != __version__:
        return pickle.dumps(
            InputError(f"a machine of the cluster has slrl-sumo {__version__}, this is {version}; install the same")
        )
    if _worker is not None and (_worker.old or _worker.work != work):
        _worker.stop()
        _worker = None
    if _worker is None:
        _worker = JobWorker(work)
    _worker.send(job)
    answer = _worker.receive()
    if isinstance(answer, Died):
        _worker.stop()
        _worker = None
    return answer
