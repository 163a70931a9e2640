"""A process that does jobs: libsumo holds one simulation per process, and SUMO may take its process along."""

import multiprocessing
import pickle
import shutil
import signal
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.jobs.process import deaf_to_interrupts, settle_in

LIFE = 500
"""Jobs after which a process is replaced: SUMO and its libraries do not give back all memory."""


class Died(str):
    """How the process of a job died."""


class JobWorker:
    """A fresh process that does `work`, a pickled function or callable object of one argument, on pickled jobs.

    Its answer is pickled as well: what the function returned, the InputError or SumoError that it raised, or a
    RuntimeError with the traceback of anything else. It stays alive between jobs because torch loads slowly. Temporary
    files of its own, and what SUMO leaves behind when it dies, are removed with it. Raises InputError where there is no
    place for them.
    """

    def __init__(self, work: bytes) -> None:
        self.work = work
        self._jobs = 0
        context = multiprocessing.get_context("spawn")
        self.pipe, its = context.Pipe()
        try:
            self._folder = tempfile.mkdtemp(prefix="slrl_sumo_")
        except OSError as error:
            raise InputError(f"no place for temporary files ({error.strerror}); make room, or set TMPDIR") from None
        self._process = context.Process(target=_serve, args=(its, work, self._folder), daemon=True)
        with deaf_to_interrupts():
            self._process.start()
        its.close()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid or 0

    @property
    def old(self) -> bool:
        """Whether it should be replaced before the next job."""
        return self._jobs >= LIFE

    def send(self, job: bytes) -> None:
        """Begin a job."""
        self._jobs += 1
        with suppress(OSError):  # it is dead: that shows when its answer is received
            self.pipe.send_bytes(job)

    def receive(self, patience: float | None = None) -> bytes | Died:
        """Wait for the answer, at most `patience` s: who needs longer counts as dead, and must be stopped."""
        try:
            if patience is not None and not self.pipe.poll(max(0.0, patience)):
                return Died("no answer in time")
            return self.pipe.recv_bytes()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            return Died(f"its process died ({signal.Signals(-code).name if code < 0 else f'exit code {code}'})")

    def stop(self) -> None:
        """End it, whatever it does."""
        self.pipe.close()
        self._process.kill()
        self._process.join()
        shutil.rmtree(self._folder, ignore_errors=True)


def _serve(pipe: Connection, work: bytes, folder: str) -> None:
    """The process: does what it is sent until the other side is closed."""
    settle_in(folder)
    perform: list[Callable[[Any], Any]] = []
    try:
        while True:
            pipe.send_bytes(_answer(work, perform, pipe.recv_bytes()))
    except (EOFError, OSError):
        # The parent has gone; if it was killed, nobody else clears up.
        shutil.rmtree(folder, ignore_errors=True)


def _answer(work: bytes, perform: list[Callable[[Any], Any]], job: bytes) -> bytes:
    """The pickled answer; `perform` holds the function when it has been loaded, because it may have a state."""
    try:
        if not perform:
            perform.append(pickle.loads(work))
        return pickle.dumps(perform[0](pickle.loads(job)))
    except (InputError, SumoError) as error:
        return pickle.dumps(error)
    except Exception:
        return pickle.dumps(RuntimeError(f"a simulation failed by a bug:\n{traceback.format_exc()}"))
