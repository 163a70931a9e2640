"""Compilation of kernels on all cores, in the first run on a machine: numba compiles on one core per process.

`signatures.json`, written by `tools/record_signatures.py`, lists the kernels and the types of their arguments.
"""

import fcntl
import gc
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numba

types: Any = numba.types
SIGNATURES = Path(__file__).with_name("signatures.json")
FEWEST_KERNELS = 8
"""Least number of kernels to compile for which other processes are started: a start takes 1 s, a kernel 0.2 to 4 s."""
MOST_PROCESSES = 8
"""Greatest number of processes: the slowest kernel takes an eighth of the total time. Each process uses 250 MiB."""
AGAIN_S = 0.03
"""Time (s) between two checks for machine code of another process."""

Spelled = str | list[Any] | dict[str, Any]
"""Type of an argument: its name; for arrays the type of the numbers, dimensions and layout; a list for a tuple; for a
named tuple its class and the types of its fields."""


class _Process:
    """State of this process."""

    compiles_ahead = False
    """Whether this process compiles for another process."""
    others: list[subprocess.Popen[bytes]] | None = None
    """Compiling processes that this process has started; None before the first need."""


def awaited(name: str, signature: Sequence[Any]) -> Iterator[None]:
    """Yield every AGAIN_S while other processes may still compile the kernel `name` for `signature`, and once after
    that.

    `name`: module and function. The first call starts these processes, unless another command has started them.
    """
    if _Process.compiles_ahead or [spelled(one) for one in signature] not in recorded().get(name, []):
        return
    if _Process.others is None:
        _Process.others = []
        with suppress(OSError):  # other processes are at work, or none can be started
            _start(_Process.others)
    while _at_work():
        time.sleep(AGAIN_S)
        yield
    yield


@cache
def recorded() -> dict[str, list[list[Spelled]]]:
    """Signatures of the kernels of typical runs, by module and function."""
    found: dict[str, list[list[Spelled]]] = json.loads(SIGNATURES.read_text())
    return found


def spelled(one: Any) -> Spelled:
    """A numba type as JSON."""
    if isinstance(one, types.BaseNamedTuple):
        of = one.instance_class
        return {f"{of.__module__}.{of.__qualname__}": [spelled(field) for field in one.types]}
    if isinstance(one, types.BaseTuple):
        return [spelled(field) for field in one.types]
    if isinstance(one, types.Array):
        return f"{one.dtype} {one.ndim} {one.layout}" + ("" if one.mutable else " readonly")
    return str(one)


def parsed(spelling: Spelled) -> Any:
    """The numba type of a spelling."""
    if isinstance(spelling, dict):
        ((name, fields),) = spelling.items()
        return types.BaseNamedTuple.from_types([parsed(field) for field in fields], named(name))
    if isinstance(spelling, list):
        return types.Tuple([parsed(field) for field in spelling])
    dtype, *rest = spelling.split()
    if not rest:
        return getattr(types, dtype)
    ndim, layout, *readonly = rest
    return types.Array(getattr(types, dtype), int(ndim), layout, readonly=bool(readonly))


def named(name: str) -> Any:
    """The kernel or class with this qualified name (module and name)."""
    module, _, attribute = name.rpartition(".")
    return getattr(import_module(module), attribute)


def _start(others: list[subprocess.Popen[bytes]]) -> None:
    """Start a process for each core; the processes hold a lock on SIGNATURES until they end."""
    cores = len(os.sched_getaffinity(0))
    missing = [number for number, name in enumerate(recorded()) if not named(name)._cache.filled()]
    if cores == 1 or len(missing) < FEWEST_KERNELS or not sys.executable:
        return
    program = f"import sys; sys.path[:] = {sys.path}; from {__name__} import compile_for; compile_for({os.getpid()})"
    with open(SIGNATURES, "rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        numbers, end = os.pipe()
        try:
            os.write(end, bytes(missing))
            os.close(end)
            others += [
                subprocess.Popen(
                    [sys.executable, "-c", program],
                    stdin=numbers,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    pass_fds=[lock.fileno()],
                )
                for _ in range(min(cores, MOST_PROCESSES))
            ]
        finally:
            os.close(numbers)


def _at_work() -> bool:
    """Whether compiling processes of this or another command are running."""
    for other in _Process.others or ():
        other.poll()  # reaps a process that has ended
    with open(SIGNATURES, "rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # a file system without locks
            return False
    return False


def compile_for(run: int) -> None:
    """Compile the kernels whose numbers arrive on the standard input, one byte each, until the input or process `run`
    ends."""
    _Process.compiles_ahead = True
    kernels = list(recorded().items())
    gc.disable()  # garbage collection takes a tenth of the compile time
    while os.getppid() == run and (number := os.read(0, 1)):
        name, signatures = kernels[number[0]]
        for signature in signatures:
            named(name).compile(tuple(map(parsed, signature)))
