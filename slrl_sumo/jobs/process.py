"""A child process that may crash: libsumo holds one simulation per process, and a crash of SUMO ends that process.

All processes of this package with SUMO are WorkerProcesses: runs, studies, training and benchmarks.
"""

import ctypes
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from importlib import import_module
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import Any

from slrl_sumo.errors import DefectError, InputError, SlrlError, SumoError
from slrl_sumo.jobs.interrupt import SIGNALS, interrupts_deferred
from slrl_sumo.jobs.standard_streams import open_closed_streams

PRINTED = "printed"
"""File in the folder of a process that collects its output."""
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's mallopt (https://man7.org/linux/man-pages/man3/mallopt.3.html)."""
EXIT_S = 5.0
"""Time (s) for the exit of a process after its pipe was closed."""
GUARD = """read -r end
for second in 1 2 3 4 5; do kill -0 "$1" && sleep 1; done
kill -9 "$1"
rm -rf -- "$2"
"""
"""A shell that waits for the end of this process, of which it reads nothing but the end of its input: then it gives the
child $1 EXIT_S to exit, kills it, and removes its folder $2. A child cannot do so itself: libsumo holds the interpreter
while it loads, which takes minutes in cities, and a process that is killed removes nothing."""


class WorkerDiedError(SumoError):
    """A worker process died, or did not answer in time."""

    exitcode: int | None = None
    """As multiprocessing.Process.exitcode: -N for signal N."""
    printed_error: str = ""
    """Last error message of SUMO in the output of the process."""


class WorkerProcess:
    """A fresh process that applies `work`, a pickled callable of one argument, to pickled requests.

    A request has one pickled answer: the return value, the SlrlError that was raised, or a DefectError with the
    traceback of any other exception. If `work` returns a generator, each of its items is an answer, and then None. The
    process serves many requests because torch loads slowly; it ends with its parent. It ignores SIGINT, SIGTERM and
    SIGHUP, keeps its temporary files in a folder that is removed with it, and collects its output there. It imports the
    script of this process only where `work` refers to it, and not if that holds the script's functions `by_value`.
    Raises InputError if that folder cannot be created, or this process may not start another (`in_worker`).
    """

    def __init__(self, work: bytes, *, by_value: bool = False) -> None:
        open_closed_streams()
        self.work = work
        self.requests = 0
        """Number of sent requests."""
        self._child: _Child | None = None
        try:
            with interrupts_deferred():
                self._child = child = _child(script_needed=not by_value and b"__main__" in work)
                self.pipe, self.pid = child.pipe, child.process.pid or 0
                with suppress(OSError):  # as in `send`
                    self.pipe.send_bytes(work)
        except KeyboardInterrupt:
            self.close()
            raise

    def send(self, request: bytes) -> None:
        """Send a pickled request."""
        self.requests += 1
        with suppress(OSError):  # the process is dead: `receive` reports it
            self.pipe.send_bytes(request)

    def receive(self, timeout: float | None = None) -> bytes:
        """Wait for a pickled answer, at most `timeout` s. Raises WorkerDiedError; the process must then be closed."""
        try:
            if timeout is not None and not self.pipe.poll(max(0.0, timeout)):
                raise WorkerDiedError("no answer in time")
            return self.pipe.recv_bytes()
        except (EOFError, OSError):
            raise self._death() from None

    def close(self, timeout: float = 0.0) -> None:
        """End the process: it may take `timeout` s to exit, then it is killed."""
        if self._child is not None:
            self._child.close(timeout)

    def _death(self) -> WorkerDiedError:
        assert self._child is not None
        process = self._child.process
        process.join(EXIT_S)
        code = process.exitcode
        name = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
        death = WorkerDiedError(f"its process died ({name})")
        death.exitcode = code
        with suppress(OSError):
            lines = (self._child.folder / PRINTED).read_text(errors="replace").splitlines()
            errors = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
            death.printed_error = errors[-1] if errors else ""
        return death


class _Child:
    """A process that waits for its work, with its pipe, its folder and the shell that guards it."""

    def __init__(self, modules: tuple[str, ...] = (), *, script_needed: bool = False) -> None:
        if in_worker():
            raise InputError(
                "SUMO needs a process of its own, which workers of multiprocessing.Pool may not start; "
                "use concurrent.futures.ProcessPoolExecutor"
            )
        context = multiprocessing.get_context("spawn")
        with signals_blocked(), nullcontext() if script_needed else _script_hidden():
            try:
                self.folder = Path(tempfile.mkdtemp(prefix="slrl_sumo_"))
            except OSError as error:
                raise InputError(f"no place for temporary files ({error.strerror}); make room, or set TMPDIR") from None
            self.pipe, child_end = context.Pipe()
            self.process = context.Process(target=_serve, args=(child_end, self.folder, modules), daemon=True)
            self.process.start()
            self._guard = subprocess.Popen(
                ["/bin/sh", "-c", GUARD, "guard", str(self.process.pid), str(self.folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        child_end.close()

    def close(self, timeout: float = 0.0) -> None:
        """See WorkerProcess."""
        self.pipe.close()
        try:
            if timeout:
                self.process.join(timeout)
        finally:  # also where the user does not wait
            self.process.kill()
            self.process.join()
            shutil.rmtree(self.folder, ignore_errors=True)
            self._guard.communicate()


def in_worker() -> bool:
    """Whether this process may not start another: workers of multiprocessing.Pool and of gymnasium may not."""
    return bool(multiprocessing.current_process().daemon)


_ahead: list[_Child] = []


@contextmanager
def started_ahead(*modules: str) -> Iterator[None]:
    """Start the process of the first WorkerProcess inside already now: it imports `modules` while this one imports what
    it needs itself, a quarter of the start of a run. It ends with the context if nothing needed it."""
    open_closed_streams()
    try:
        with suppress(InputError), interrupts_deferred():  # the WorkerProcess will report it
            _ahead.append(_Child(modules))
        yield
    finally:
        while _ahead:
            _ahead.pop().close()


def _child(*, script_needed: bool) -> _Child:
    return _ahead.pop() if _ahead and not script_needed else _Child(script_needed=script_needed)


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Processes started inside ignore SIGNALS, which terminals and schedulers send to all processes of a command: the
    parent handles them."""
    # Children inherit the mask. The resource tracker, which starts with the first child, ignores SIGINT and SIGTERM by
    # itself, and while it starts it unblocks them here.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _script_hidden() -> Iterator[None]:
    """Processes started inside do not import the script of this process, which thus need not guard its code against
    that with `if __name__ == "__main__"`."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def set_up_process(folder: str | Path) -> None:
    """Keep temporary files of this process in `folder`, redirect its output into a file there, and keep freed memory.

    Files that SUMO leaves behind when it crashes are removed with the folder; output of its C++ code would damage the
    progress bar of the parent.
    """
    # PyTorch reads this when it is loaded. Threads that spin while waiting are several times slower on busy machines.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    tempfile.tempdir = str(folder)
    descriptor = os.open(Path(folder) / PRINTED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)
    # Every decision allocates and frees arrays of 0.1 to 1 MB: glibc would return each to the system, and the next one
    # would be zeroed page by page. Other C libraries have no mallopt.
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, 32 << 20)
        mallopt(TRIM_THRESHOLD, 256 << 20)


def _serve(pipe: Connection, folder: Path, modules: tuple[str, ...]) -> None:
    """The child process: imports `modules`, then answers requests until the parent closes the pipe."""
    set_up_process(folder)
    perform: list[Callable[[Any], Any]] = []
    with suppress(Exception):  # the work will meet it again, and report it
        for module in modules:
            import_module(module)
    try:
        work = pipe.recv_bytes()
        while True:
            with closing(_answers(work, perform, pipe.recv_bytes())) as answers:
                for answer in answers:
                    pipe.send_bytes(answer)
    except (EOFError, OSError):
        # The parent has closed the pipe. If it was killed, no other process removes the folder.
        shutil.rmtree(folder, ignore_errors=True)


def _answers(work: bytes, perform: list[Callable[[Any], Any]], request: bytes) -> Generator[bytes, None, None]:
    """Pickled answers to a request; `perform` holds the callable once it is loaded, because it may have state."""
    try:
        if not perform:
            perform.append(pickle.loads(work))
        answer = perform[0](pickle.loads(request))
        if isinstance(answer, Generator):
            with closing(answer):
                for item in answer:
                    yield pickle.dumps(item)
            answer = None
        yield pickle.dumps(answer)
    except SlrlError as error:
        yield pickle.dumps(error)
    except Exception as error:
        yield pickle.dumps(DefectError.of(error))
