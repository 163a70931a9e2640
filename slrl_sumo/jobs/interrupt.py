"""SIGINT and SIGTERM end long work early without losing finished results."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible(tolerated: int = 0) -> Iterator[list[int]]:
    """Raise KeyboardInterrupt on SIGINT and SIGTERM; the first `tolerated` signals are only recorded.

    Yields the list of the signal numbers received so far; outside the main thread it stays empty.
    """
    caught: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        if len(caught) > tolerated:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # Python handles signals in the main thread only
        yield caught
        return
    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
