"""Requests to worker processes with retry: independent jobs in any order, or one request to each worker.

Backends differ only in the machines of the processes: `LocalWorkers` starts them on this machine,
slrl_sumo.jobs.ray_workers on the machines of a Ray cluster.
"""

import pickle
from collections import Counter, deque
from collections.abc import Callable, Generator, Hashable, Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from slrl_sumo.errors import SumoError, check_whole_number
from slrl_sumo.jobs.process import WorkerDiedError
from slrl_sumo.jobs.ray_workers import RayActors, RayTasks
from slrl_sumo.jobs.workers import MAX_REQUESTS, LocalWorkers, MachineLostError

JOB_ATTEMPTS = 3
"""Number of attempts of a job after deaths of its process; then the job is left out."""

MACHINE_ATTEMPTS = 20
"""Number of attempts of a job or request after losses of its machine, which the job rarely causes."""

MAX_FIRST_FAILURES = 3
"""Number of jobs left out before the first success after which the whole study fails."""

MAX_WORKERS = 16_384

Job = TypeVar("Job", bound=Hashable)
Record = TypeVar("Record")


@dataclass(frozen=True)
class Backend:
    """Location of worker processes; fields are named as on the command line."""

    workers: int | None = None
    """Number of processes at the same time. None: 2, or the number of Ray's cores."""
    ray: str | None = None
    """None: this machine. "local": a separate Ray instance on this machine. Otherwise the address of a Ray cluster:
    HOST:PORT of its head, or "auto" for the cluster of this machine."""

    def __post_init__(self) -> None:
        if self.workers is not None:
            check_whole_number("workers", self.workers, 1, MAX_WORKERS)


@dataclass(frozen=True)
class Finished(Generic[Job, Record]):
    """A job and its record; the record is None if the job failed, for `reason`."""

    job: Job
    record: Record | None
    reason: str = ""


class Failures:
    """Numbers of lost processes and machines, by job or worker."""

    def __init__(self, attempts: int) -> None:
        self.attempts = attempts
        self.deaths, self.losses = Counter[Hashable](), Counter[Hashable]()

    def add(self, key: Hashable, error: SumoError) -> int:
        """Count a failure. Returns 0, or after the last attempt the number of attempts."""
        lost = isinstance(error, MachineLostError)
        counter, limit = (self.losses, MACHINE_ATTEMPTS) if lost else (self.deaths, self.attempts)
        counter[key] += 1
        return limit if counter[key] >= limit else 0


def run_jobs(
    work: Callable[[Job], Record], jobs: Iterable[Job], backend: Backend
) -> Generator[Finished[Job, Record], None, None]:
    """Apply `work` to each of `jobs` and yield each job once, when it is finished, in any order.

    `work`, jobs and records are pickled; the record must depend only on the job. `jobs` may be a generator: it advances
    when processes become free, so that only unfinished jobs are in memory.

    After the death of its process, a job is repeated in a new process, with JOB_ATTEMPTS attempts in total. After a
    failure of SUMO, a job is not repeated, because it would fail again. After the loss of its machine, a job is
    repeated on another machine. Raises InputError for wrong input, SumoError if the first MAX_FIRST_FAILURES jobs all
    fail, and DefectError with the traceback of a defect.
    Closing the generator ends the processes, and so does the death of this process.
    """
    with closing(_workers(work, backend)) as workers:
        fresh, again = iter(jobs), deque[Job]()
        running: dict[int, Job] = {}
        free: list[int] = []
        failures = Failures(JOB_ATTEMPTS)
        succeeded = left_out = 0

        def start() -> None:
            while len(running) < workers.capacity():
                if again:
                    job = again.popleft()
                else:
                    try:
                        job = next(fresh)
                    except StopIteration:
                        return
                number = free.pop() if free else len(running)
                running[number] = job
                workers.begin(number, pickle.dumps(job))

        while True:
            start()
            if not running:
                return
            ended: list[Finished[Job, Record]] = []
            fatal: BaseException | None = None
            for number, outcome in workers.wait():
                job = running.pop(number)
                free.append(number)
                if isinstance(outcome, WorkerDiedError | MachineLostError):
                    attempts = failures.add(job, outcome)
                    if not attempts:
                        again.append(job)
                        continue
                    outcome = SumoError(f"{outcome}, {attempts} times")
                if isinstance(outcome, SumoError):
                    left_out += 1
                    if not succeeded and left_out == MAX_FIRST_FAILURES:
                        fatal = SumoError(f"the first {MAX_FIRST_FAILURES} simulations all failed: {outcome}")
                    ended.append(Finished(job, None, str(outcome)))
                elif isinstance(outcome, BaseException):
                    fatal = outcome
                else:
                    succeeded += 1
                    ended.append(Finished(job, outcome))
            if fatal is None:
                start()  # the processes continue while the caller handles the finished jobs
            yield from ended
            if fatal is not None:
                raise fatal


def ask_all(
    workers: LocalWorkers | RayActors,
    numbers: Iterable[int],
    begin: Callable[[int], None],
    failed: Callable[[int, SumoError], None],
    failures: Failures,
) -> dict[int, Any]:
    """`begin` a request at each of the workers `numbers` and wait for all answers, by number.

    After each failure (a process or machine is lost, or SUMO fails), `failed` is called, then `begin` again, with a new
    process. Raises SumoError if a worker has failed too often (see Failures), and other exceptions immediately.
    """
    missing, answers = set(numbers), dict[int, Any]()
    for number in sorted(missing):
        begin(number)
    while missing:
        for number, outcome in workers.wait():
            if not isinstance(outcome, BaseException):
                answers[number] = outcome
                missing.discard(number)
                continue
            if not isinstance(outcome, SumoError):
                raise outcome
            attempts = failures.add(number, outcome)
            if attempts:
                raise SumoError(f"training worker {number} died {attempts} times in a row (last: {outcome})")
            failed(number, outcome)
            workers.replace(number)
            begin(number)
    return answers


def portable_name(name: str, shipped: Iterable[str] = ()) -> str:
    """The name of a scenario or bundle for processes with another working directory, perhaps on another machine.

    Names in `shipped`, and names without a path of that name here, belong to the package and are found everywhere; a
    path becomes absolute.
    """
    return name if name in shipped or not Path(name).exists() else str(Path(name).absolute())


def _workers(work: Callable[[Job], Record], backend: Backend) -> LocalWorkers | RayTasks:
    if backend.ray is None:
        return LocalWorkers(pickle.dumps(work), backend.workers or 2, MAX_REQUESTS)
    return RayTasks(pickle.dumps(work), backend.ray, backend.workers)
