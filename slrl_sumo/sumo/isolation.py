"""SUMO in a child process: a crash of SUMO ends only that process."""

import pickle
import signal
from collections.abc import Callable
from typing import TypeVar

from slrl_sumo.errors import InputError, SlrlError, SumoError
from slrl_sumo.jobs.process import WorkerDiedError, WorkerProcess

Argument = TypeVar("Argument")
Answer = TypeVar("Answer")


def isolated(work: Callable[[Argument], Answer], argument: Argument, where: object) -> Answer:
    """`work(argument)` in a child process, for work that loads SUMO and does not simulate; both must be picklable.

    `where` names the scenario or network in messages. Raises what `work` raises, and InputError if SUMO crashes.
    """
    process = WorkerProcess(pickle.dumps(work))
    try:
        process.send(pickle.dumps(argument))
        answer = pickle.loads(process.receive())
    except WorkerDiedError as death:
        raise loading_error(where, death) from None
    finally:
        process.close()
    if isinstance(answer, SlrlError):
        raise answer
    return answer  # type: ignore[no-any-return]


def loading_error(where: object, death: WorkerDiedError) -> SlrlError:
    """The error for the death of a process that was loading the scenario or network `where`."""
    if death.exitcode in (-signal.SIGSEGV, -signal.SIGABRT):
        # Some invalid networks cause such crashes.
        name = signal.Signals(-death.exitcode).name
        return InputError(
            f"{where}: SUMO crashes while loading it or in its first step ({name}); check that network and demand are "
            "complete, and whether it runs in SUMO alone"
        )
    return SumoError(death_message(death, "while it was loading"))


def death_message(death: WorkerDiedError, when: str) -> str:
    """A one-line message on the death of a process with SUMO; `when`: time or activity of the process at that time."""
    cause = f"exit code {death.exitcode}"
    if death.exitcode is not None and death.exitcode < 0:
        cause = signal.Signals(-death.exitcode).name
        if death.exitcode == -signal.SIGKILL:
            cause += ": it was killed, or it took too much memory"
    return f"SUMO died {when} ({cause}){': ' + death.printed_error if death.printed_error else ''}"
