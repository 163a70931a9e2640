"""How every process of ours that holds a SUMO begins."""

import ctypes
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path

PRINTED = "printed"
"""File in its folder that gets what is printed in it."""
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's mallopt (https://man7.org/linux/man-pages/man3/mallopt.3.html)."""


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Processes that are started inside do not hear Ctrl-C, which reaches the whole process group: this process decides
    what it means."""
    # Children inherit the mask; the tracker that comes with the first child would lift it again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def settle_in(folder: str | Path) -> None:
    """Let this process keep its temporary files in `folder`, print into a file there, and keep freed memory.

    What SUMO leaves behind when it dies is removed with the folder; what its C++ code prints would tear the parent's
    progress bar apart.
    """
    tempfile.tempdir = str(folder)
    descriptor = os.open(Path(folder) / PRINTED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)
    _keep_freed_memory()


def _keep_freed_memory() -> None:
    """Arrays of 0.1 to 1 MB come and go in every decision: glibc would give each back to the system, and have the next
    one zeroed page by page. Other C libraries are left as they are."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, 32 << 20)
        mallopt(TRIM_THRESHOLD, 256 << 20)
