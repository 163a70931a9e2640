"""Episodes in worker processes: libsumo holds one simulation per process, and SUMO may take its process along."""

import multiprocessing
import os
import shutil
import signal
import tempfile
import traceback
from collections import deque
from collections.abc import Callable, Generator, Hashable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from slrl_sumo.analysis.episodes import Episode, EpisodeSettings, play
from slrl_sumo.analysis.outcomes import TypeOutcome
from slrl_sumo.errors import InputError, SumoError

ATTEMPTS = 3
"""How often an episode is begun whose process dies, before it is left out."""

HOPELESS = 3
"""Episodes left out before the first success, after which the evaluation gives up."""


Job = TypeVar("Job", bound=Hashable)
Record = TypeVar("Record")


@dataclass(frozen=True)
class Finished(Generic[Job, Record]):
    """A job and what came of it; None where it could not be done, with the `reason`."""

    job: Job
    record: Record | None
    reason: str = ""


@dataclass(frozen=True)
class Played:
    """An episode and what happened in it; None where it could not be played, with the `reason`."""

    episode: Episode
    outcome: tuple[TypeOutcome, ...] | None
    reason: str = ""


class _Death(str):
    """How the process of a job died."""


@dataclass(frozen=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    job: Any
    folder: str
    """Its temporary files: what SUMO leaves behind when it dies is removed with it."""


def play_all(settings: EpisodeSettings, episodes: Sequence[Episode], workers: int) -> Generator[Played, None, None]:
    """Play `episodes` in so many processes and yield each when it is done, in any order; see `run_jobs`."""
    with closing(run_jobs(partial(play, settings), episodes, workers)) as results:
        for finished in results:
            yield Played(finished.job, finished.record, finished.reason)


def run_jobs(
    work: Callable[[Job], Record], jobs: Sequence[Job], workers: int
) -> Generator[Finished[Job, Record], None, None]:
    """Do `work` on each of `jobs` in so many processes and yield each when it is done, in any order.

    `work`, jobs and records are pickled. A job whose process dies is begun again in a fresh process, ATTEMPTS times in
    all; one in which SUMO gives up is not, because it would again. Raises InputError where the input is wrong,
    SumoError where the first HOPELESS jobs all fail, RuntimeError with the traceback of a bug. Closing the generator
    ends the processes, and so does the death of this one.
    """
    waiting = deque(jobs)
    failed = dict.fromkeys(jobs, 0)
    crew: list[_Worker] = []
    succeeded = left_out = 0
    try:
        while waiting or crew:
            while waiting and len(crew) < workers:
                crew.append(_hire(work, waiting.popleft()))
            ready = wait([worker.pipe for worker in crew])
            for worker in [worker for worker in crew if worker.pipe in ready]:
                crew.remove(worker)
                message = _receive(worker)
                if isinstance(message, InputError | RuntimeError):
                    _dismiss(worker)
                    raise message
                if isinstance(message, SumoError | _Death):
                    _dismiss(worker)
                    failed[worker.job] += 1
                    if isinstance(message, _Death) and failed[worker.job] < ATTEMPTS:
                        waiting.append(worker.job)
                        continue
                    left_out += 1
                    if not succeeded and left_out == HOPELESS:
                        raise SumoError(f"the first {HOPELESS} episodes all failed: {message}")
                    yield Finished(worker.job, None, str(message))
                    continue
                succeeded += 1
                if waiting:
                    following = _Worker(worker.process, worker.pipe, waiting.popleft(), worker.folder)
                    crew.append(following)
                    _send(following)
                else:
                    _dismiss(worker)
                yield Finished(worker.job, message)
    finally:
        for worker in crew:
            _dismiss(worker)


def _hire(work: Callable[[Any], Any], job: Hashable) -> _Worker:
    """A fresh process that does `job`."""
    context = multiprocessing.get_context("spawn")
    mine, its = context.Pipe()
    try:
        folder = tempfile.mkdtemp(prefix="slrl_sumo_")
    except OSError as error:
        raise InputError(f"no place for temporary files ({error.strerror}); make room, or set TMPDIR") from None
    process = context.Process(target=_serve, args=(its, work, folder), daemon=True)
    # Ctrl-C reaches the whole process group; this process decides what it means. The child inherits the mask; the
    # tracker that comes with the first child would lift it again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    its.close()
    worker = _Worker(process, mine, job, folder)
    _send(worker)
    return worker


def _send(worker: _Worker) -> None:
    with suppress(OSError):  # it is dead: that shows when its answer is received
        worker.pipe.send(worker.job)


def _receive(worker: _Worker) -> Any:
    """The record of its job, or how it failed: InputError, SumoError, RuntimeError or _Death."""
    try:
        message = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join()
        code = worker.process.exitcode or 0
        return _Death(f"its process died ({signal.Signals(-code).name if code < 0 else f'exit code {code}'})")
    return RuntimeError(f"an episode failed by a bug:\n{message}") if isinstance(message, str) else message


def _dismiss(worker: _Worker) -> None:
    worker.pipe.close()
    worker.process.kill()
    worker.process.join()
    shutil.rmtree(worker.folder, ignore_errors=True)


def _serve(pipe: Connection, work: Callable[[Any], Any], folder: str) -> None:
    """The worker: does what it is sent until the other side is closed; it stays alive because torch loads slowly."""
    tempfile.tempdir = folder
    # What SUMO's C++ code prints would tear the parent's progress bar apart.
    descriptor = os.open(Path(folder) / "printed", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)
    try:
        while True:
            pipe.send(_answer(work, pipe.recv()))
    except (EOFError, OSError):
        # The parent has gone; if it was killed, nobody else clears up.
        shutil.rmtree(folder, ignore_errors=True)


def _answer(work: Callable[[Any], Any], job: Any) -> Any:
    try:
        return work(job)
    except (InputError, SumoError) as error:
        return error
    except Exception:
        return traceback.format_exc()
