"""Signals that end long work early, without losing what is finished."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible(patience: int = 0) -> Iterator[list[int]]:
    """SIGINT and SIGTERM raise KeyboardInterrupt, after `patience` of them that are only collected.

    Yields the list of the signals' numbers.
    """
    caught: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        if len(caught) > patience:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
