"""Worker processes by number, and how requests to them fail."""

import math
import pickle
import time
from multiprocessing.connection import wait
from typing import Any

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.process import WorkerDiedError, WorkerProcess

MAX_REQUESTS = 500
"""Requests after which a worker process is replaced: SUMO and its libraries do not return all memory."""


class MachineLostError(SumoError):
    """The machine of a worker process was lost."""


class LocalWorkers:
    """`count` worker processes of this machine, numbered from 0: each answers one request at a time (WorkerProcess).

    A process starts with the first request for its number, and again after it has died, was replaced, or has answered
    `max_requests`.
    """

    def __init__(self, work: bytes, count: int, max_requests: float = math.inf) -> None:
        self._work, self._count, self._max_requests = work, count, max_requests
        self._shared: bytes | None = None
        self._processes: dict[int, WorkerProcess] = {}
        self._deadlines: dict[int, float] = {}

    def capacity(self) -> int:
        """How many requests can be under way at once."""
        return self._count

    def publish(self, shared: bytes) -> None:
        """From now on `work` gets the tuple (request as bytes, `shared`)."""
        self._shared = shared

    def begin(self, number: int, request: bytes, timeout: float = math.inf) -> None:
        """Send a pickled request to a worker, which must answer within `timeout` s. Raises InputError if no process can
        be started."""
        if number not in self._processes:
            self._processes[number] = WorkerProcess(self._work)
        self._deadlines[number] = time.monotonic() + timeout
        self._processes[number].send(request if self._shared is None else pickle.dumps((request, self._shared)))

    def wait(self) -> list[tuple[int, Any]]:
        """Wait until a request has ended. Returns numbers and what `work` returned, or an exception: what it raised
        (see WorkerProcess), WorkerDiedError or MachineLostError."""
        first = min(self._deadlines.values())
        timeout = None if first == math.inf else max(0.0, first - time.monotonic())
        ready = wait([self._processes[number].pipe for number in self._deadlines], timeout)
        ended: list[tuple[int, Any]] = []
        for number, deadline in list(self._deadlines.items()):
            process = self._processes[number]
            if process.pipe not in ready and deadline > time.monotonic():
                continue
            del self._deadlines[number]
            try:
                ended.append((number, pickle.loads(process.receive(0.0))))
            except WorkerDiedError as death:
                ended.append((number, death))
                self.replace(number)
            if process.requests >= self._max_requests:
                self.replace(number)
        return ended

    def replace(self, number: int) -> None:
        """End the process of a worker; its next request starts another."""
        if number in self._processes:
            self._processes.pop(number).close()

    def pids(self) -> dict[int, int]:
        """Process ids by number."""
        return {number: process.pid for number, process in self._processes.items()}

    def close(self) -> None:
        """End all processes."""
        for number in list(self._processes):
            self.replace(number)
