"""Many independent simulations: jobs in, records out as they finish, in processes of this machine or on a Ray cluster.

libsumo holds one simulation per process and SUMO may take its process along, so every job runs in a worker process
(job_worker.py). Where these processes are is the only difference between the two places: `ProcessCrew` has them as its
children, `slrl_sumo.jobs.ray_jobs.RayCrew` has Ray tasks that do.
"""

import itertools
import pickle
from collections import Counter, deque
from collections.abc import Callable, Generator, Hashable, Iterable
from contextlib import closing
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.jobs.worker import Died, JobWorker

ATTEMPTS = 3
"""How often a job is begun whose process dies, before it is left out."""

MACHINES = 20
"""How often a job is begun whose machine is lost under it: that is hardly its own fault."""

HOPELESS = 3
"""Jobs left out before the first success, after which the whole study gives up."""

Job = TypeVar("Job", bound=Hashable)
Record = TypeVar("Record")


@dataclass(frozen=True)
class Place:
    """Where simulations run; the words are those of the command line."""

    workers: int | None = None
    """How many at once. None: 2 processes, or all cores that Ray has."""
    ray: str | None = None
    """None: processes of this machine. "local": a Ray of its own on this machine; else the address of a Ray cluster,
    HOST:PORT of its head, or "auto" for the one that this machine belongs to."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers {self.workers}: give a whole number, 1 or more")


@dataclass(frozen=True)
class Finished(Generic[Job, Record]):
    """A job and what came of it; None where it failed, with the `reason`."""

    job: Job
    record: Record | None
    reason: str = ""


class Crew(Protocol):
    """What a place gives: it takes pickled jobs and gives back pickled answers (see JobWorker), or how it was lost."""

    def free(self) -> bool:
        """Whether another job would begin soon."""

    def begin(self, number: int, job: bytes) -> None:
        """Take a job; `number` is how it is called when it comes back."""

    def wait(self) -> "list[tuple[int, bytes | Died | Lost]]":
        """The jobs that have ended since, at least one unless it takes long."""

    def close(self) -> None:
        """End all processes, whatever they do."""


class Lost(str):
    """How a machine was lost that had a job."""


def run_jobs(
    work: Callable[[Job], Record], jobs: Iterable[Job], place: Place
) -> Generator[Finished[Job, Record], None, None]:
    """Do `work` on each of `jobs` and yield each when it is done, in any order, exactly once.

    `work`, jobs and records are pickled; what `work` returns must depend on its job alone. `jobs` may be a generator:
    it is drawn from as processes become free, so that only unfinished jobs are in memory.

    A job whose process dies is begun again in a fresh process, ATTEMPTS times in all; one in which SUMO gives up is
    not, because it would again. A job whose machine is lost is begun again on another. Raises InputError where the
    input is wrong, SumoError where the first HOPELESS jobs all fail, RuntimeError with the traceback of a bug. Closing
    the generator ends the processes, and so does the death of this one.
    """
    with closing(_crew(work, place)) as crew:
        fresh, again = iter(jobs), deque[Job]()
        running: dict[int, Job] = {}
        died, lost = Counter[Job](), Counter[Job]()
        numbers = itertools.count()
        succeeded = left_out = 0

        def start() -> None:
            while crew.free():
                if again:
                    job = again.popleft()
                else:
                    try:
                        job = next(fresh)
                    except StopIteration:
                        return
                number = next(numbers)
                running[number] = job
                crew.begin(number, pickle.dumps(job))

        while True:
            start()
            if not running:
                return
            ended: list[Finished[Job, Record]] = []
            fatal: BaseException | None = None
            for number, answer in crew.wait():
                job = running.pop(number)
                outcome = answer if isinstance(answer, Died | Lost) else pickle.loads(answer)
                if isinstance(outcome, Died | Lost):
                    counter, limit = (died, ATTEMPTS) if isinstance(outcome, Died) else (lost, MACHINES)
                    counter[job] += 1
                    if counter[job] < limit:
                        again.append(job)
                        continue
                    outcome = SumoError(f"{outcome}, {limit} times")
                if isinstance(outcome, SumoError):
                    left_out += 1
                    if not succeeded and left_out == HOPELESS:
                        fatal = SumoError(f"the first {HOPELESS} simulations all failed: {outcome}")
                    ended.append(Finished(job, None, str(outcome)))
                elif isinstance(outcome, BaseException):
                    fatal = outcome
                else:
                    succeeded += 1
                    ended.append(Finished(job, outcome))
            if fatal is None:
                start()  # processes go on while the caller looks at what has ended
            yield from ended
            if fatal is not None:
                raise fatal


def anywhere(name: str, shipped: Iterable[str] = ()) -> str:
    """The name of a scenario or bundle for processes that have another working directory, perhaps on another machine.

    What ships with the package, by a name in `shipped` or because there is no such path here, is found everywhere; a
    path becomes absolute.
    """
    return name if name in shipped or not Path(name).exists() else str(Path(name).absolute())


def _crew(work: Callable[[Job], Record], place: Place) -> Crew:
    if place.ray is not None:
        from slrl_sumo.jobs.ray_jobs import RayCrew

        return RayCrew(pickle.dumps(work), place.ray, place.workers)
    return ProcessCrew(pickle.dumps(work), place.workers or 2)


class ProcessCrew:
    """Worker processes of this one."""

    def __init__(self, work: bytes, workers: int) -> None:
        self._work, self._workers = work, workers
        self._idle: list[JobWorker] = []
        self._busy: dict[JobWorker, int] = {}

    def free(self) -> bool:
        """See Crew."""
        return len(self._busy) < self._workers

    def begin(self, number: int, job: bytes) -> None:
        """See Crew. Raises InputError where no process can be started."""
        worker = self._idle.pop() if self._idle else JobWorker(self._work)
        self._busy[worker] = number
        worker.send(job)

    def wait(self) -> list[tuple[int, bytes | Died | Lost]]:
        """See Crew."""
        ready = wait([worker.pipe for worker in self._busy])
        ended: list[tuple[int, bytes | Died | Lost]] = []
        for worker in [worker for worker in self._busy if worker.pipe in ready]:
            number, answer = self._busy.pop(worker), worker.receive()
            if isinstance(answer, Died) or worker.old:
                worker.stop()
            else:
                self._idle.append(worker)
            ended.append((number, answer))
        return ended

    def close(self) -> None:
        """See Crew."""
        for worker in [*self._busy, *self._idle]:
            worker.stop()
