"""Threads over which the road users of one decision are distributed."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

Result = TypeVar("Result")

FEWEST_ROWS = 64
"""Road users for which another thread is worth its handing over, which takes 0.1 ms."""


class RowThreads:
    """Calls a function for parts of the rows at once; compiled loops and numpy's on large arrays run at the same time.

    What a row's result is must not depend on the other rows of its part: then it does not depend on `count` either.
    """

    def __init__(self, count: int = 1) -> None:
        self._count = count
        self._pool: ThreadPoolExecutor | None = None

    def each(self, work: Callable[[slice], Result], rows: int) -> list[Result]:
        """Results of `work` for consecutive parts of so many rows, at least one part, in order."""
        parts = max(1, min(self._count, rows // FEWEST_ROWS))
        if parts == 1:
            return [work(slice(0, rows))]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._count - 1, thread_name_prefix="slrl_sumo-rows")
        ends = [rows * k // parts for k in range(parts + 1)]
        others = [self._pool.submit(work, slice(*pair)) for pair in pairwise(ends[1:])]
        first = work(slice(0, ends[1]))
        return [first, *(other.result() for other in others)]


ONE = RowThreads()
"""No other threads."""
