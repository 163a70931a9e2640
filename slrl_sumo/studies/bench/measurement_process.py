"""A measurement in separate processes, each with its own simulation and its own peak memory."""

import pickle
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from slrl_sumo.errors import SlrlError, SumoError
from slrl_sumo.jobs.process import WorkerDiedError
from slrl_sumo.jobs.workers import LocalWorkers

Result = TypeVar("Result")


@dataclass(frozen=True)
class Workload:
    """The measured workload."""

    scenario: str
    agents: int
    cores: int
    """Number of simulations side by side."""
    mix: str
    bundle: str
    selector: str | None
    """None: the default of the bundle."""
    steps: int
    """Measured decisions."""
    seed: int
    threads: int = 1
    """Of each decision of each simulation."""


class DoesNotFit(SlrlError):  # noqa: N818 (an outcome of a measurement, not a fault)
    """The scenario has no room for the number of road users."""


Measurement = Callable[[Workload], Generator[None, None, Result]]
"""A generator function that yields once when its preparations are done, and returns the result."""


def measured(measure: Measurement[Result], workload: Workload) -> list[Result]:
    """Results of `measure`, a function of a module, in `workload.cores` fresh processes side by side.

    All processes finish their preparations before the first one goes on. Raises the errors of `measure`, SumoError if a
    process dies, DefectError with the traceback of a defect. All processes end with this call.
    """
    results: list[Any] = []
    with closing(LocalWorkers(pickle.dumps(_TwoPhases(measure, workload)), workload.cores)) as workers:
        for _phase in ("prepare", "measure"):
            results = []
            for number in range(workload.cores):
                workers.begin(number, pickle.dumps(None))
            while len(results) < workload.cores:
                for _, outcome in workers.wait():
                    if isinstance(outcome, WorkerDiedError):
                        where = f"{workload.scenario} with {workload.agents} road users"
                        raise SumoError(f"{where}: the process that measured it died; try fewer, or run `doctor`")
                    if isinstance(outcome, BaseException):
                        raise outcome
                    results.append(outcome)
    return results


class _TwoPhases(Generic[Result]):
    """Work of a process: the first request prepares, the second one measures."""

    def __init__(self, measure: Measurement[Result], workload: Workload) -> None:
        self._measure, self._workload = measure, workload
        self._begun: Generator[None, None, Result] | None = None

    def __call__(self, request: None) -> Result | None:
        if self._begun is None:
            self._begun = self._measure(self._workload)
            return next(self._begun)
        try:
            next(self._begun)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        raise RuntimeError("a measurement yields once")
