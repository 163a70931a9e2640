"""SIGINT, SIGTERM and SIGHUP end long work early without losing finished results."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals of Ctrl-C, of `kill`, and of the end of the terminal or of the connection."""


_open: list[list[int]] = []
"""The signal numbers received in each context that is open, the innermost last."""


@contextmanager
def interruptible(tolerated: int = 0) -> Iterator[list[int]]:
    """Raise KeyboardInterrupt, with the number, on SIGINT, SIGTERM and SIGHUP; the first `tolerated` are only recorded.

    Yields the list of the signal numbers received so far; outside the main thread it stays empty. SIGHUP stays ignored
    where it is: `nohup` asks for that.

    Work that tolerates interrupts does not begin after one that was lost on the way there: CPython drops exceptions in
    callbacks of weak references, of which imports have many.
    """
    if tolerated and (lost := [number for received in _open for number in received]):
        raise KeyboardInterrupt(lost[0])
    caught: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        if len(caught) > tolerated:
            raise KeyboardInterrupt(number)

    if threading.current_thread() is not threading.main_thread():  # Python handles signals in the main thread only
        yield caught
        return
    ignored = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else set()
    before = {number: signal.signal(number, handle) for number in SIGNALS if number not in ignored}
    _open.append(caught)
    try:
        yield caught
    finally:
        _open.pop()
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interruptible_to_the_end() -> Iterator[None]:
    """As `interruptible`; an interrupt that is lost inside is raised at the end."""
    with interruptible() as caught:
        yield
    if caught:
        raise KeyboardInterrupt(caught[0])


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP received inside take effect afterwards; outside the main thread, nothing changes.

    Blocking them in the main thread does not do that: the system delivers them to another thread (numpy has some), and
    Python then runs the handler in the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    handled = [each for each in SIGNALS if signal.getsignal(each) not in (signal.SIG_IGN, None)]
    before = {each: signal.signal(each, lambda each, _: received.append(each)) for each in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for each in received:
            signal.raise_signal(each)
