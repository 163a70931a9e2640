"""One measurement in a process of its own: with its own peak of memory, and its own simulation."""

import multiprocessing
import tempfile
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Barrier
from typing import Any, TypeVar

from slrl_sumo.errors import SlrlError, SumoError
from slrl_sumo.jobs.process import deaf_to_interrupts, settle_in

Result = TypeVar("Result")
Ready = Callable[[], object]


@dataclass(frozen=True)
class Workload:
    """What is measured."""

    scenario: str
    agents: int
    cores: int
    """So many simulations side by side, each in one thread: more threads in one of them only wait for each other."""
    mix: str
    bundle: str
    selector: str | None
    """None: the bundle's usual one."""
    steps: int
    """Decisions that count."""
    seed: int


class DoesNotFit(Exception):  # noqa: N818 (an outcome of a measurement, not a fault)
    """So many road users find no place in this scenario."""


def measured(measure: Callable[[Workload, Ready], Result], work: Workload) -> list[Result]:
    """What `measure`, a function of a module, returns for `work`, in `work.cores` fresh processes side by side.

    It gets `work` and a function to call when its preparations are done, which waits for all the others. Raises what
    it raises, SumoError where a process dies, RuntimeError with the traceback of a bug. All processes end with this
    call, however that ends.
    """
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(work.cores)
    results = []
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder, ExitStack() as stack:
        pipes = []
        with deaf_to_interrupts():
            for _ in range(work.cores):
                receiver, sender = context.Pipe(duplex=False)
                process = context.Process(target=_serve, args=(sender, measure, work, barrier, folder), daemon=True)
                process.start()
                stack.callback(_end, process)
                sender.close()
                pipes.append(receiver)
        while pipes:
            # The first to answer is looked at first: where one has died the others wait for it in vain.
            for pipe in wait(pipes):
                assert isinstance(pipe, Connection)
                pipes.remove(pipe)
                results.append(_received(pipe, work))
    return results


def _end(process: SpawnProcess) -> None:
    process.kill()
    process.join()


def _received(pipe: Connection, work: Workload) -> Any:
    try:
        message = pipe.recv()
    except (EOFError, OSError):
        where = f"{work.scenario} with {work.agents} road users"
        raise SumoError(f"{where}: the process that measured it died; try fewer, or look at `doctor`") from None
    if isinstance(message, SlrlError | DoesNotFit):
        raise message
    if isinstance(message, str):
        raise RuntimeError(f"a measurement failed by a bug:\n{message}")
    return message


def _serve(
    sender: Connection, measure: Callable[[Workload, Ready], object], work: Workload, barrier: Barrier, folder: str
) -> None:
    """The child."""
    settle_in(folder)
    answer: object
    try:
        answer = measure(work, barrier.wait)
    except (SlrlError, DoesNotFit) as error:
        answer = error
    except Exception:
        answer = traceback.format_exc()
    sender.send(answer)
