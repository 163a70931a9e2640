"""A run in a process of its own: when SUMO dies, its process dies alone."""

import multiprocessing
import os
import shutil
import signal
import tempfile
import traceback
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

from slrl_sumo.errors import InputError, SlrlError, SumoError
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.jobs.process import PRINTED, deaf_to_interrupts, settle_in
from slrl_sumo.simulation.events import Decision, Event, RunSettings, Started

GRACE = 5.0
"""s that a process may take to end by itself."""


def run_contained(
    settings: RunSettings, views_at: frozenset[int] = frozenset(), *, with_surfaces: bool = False
) -> Generator[Event, None, None]:
    """The same events as `slrl_sumo.simulation.run.run`, from a child process; Started.surfaces are left empty unless
    `with_surfaces`: those of a city take 80 MiB in each of the two processes.

    Raises what `run` raises, InputError when SUMO crashes on loading, SumoError when the child dies later (segmentation
    fault, kill): the message says of what and at which simulation time, and RuntimeError with the child's traceback
    where it fails by a bug. Closing the generator ends the child, and so does the death of this process.
    """
    _open_closed_streams()
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    try:
        folder = Path(tempfile.mkdtemp(prefix="slrl_sumo_"))
    except OSError as error:
        raise InputError(f"no place for temporary files ({error.strerror}); make room, or set TMPDIR") from None
    child = context.Process(target=_serve, args=(sender, settings, views_at, with_surfaces, str(folder)), daemon=True)
    with deaf_to_interrupts():
        child.start()
    sender.close()
    time = None
    try:
        while True:
            try:
                message = receiver.recv()
            except (EOFError, OSError):
                child.join(GRACE)
                if time is None and child.exitcode in (-signal.SIGSEGV, -signal.SIGABRT):
                    # Some broken networks do that.
                    raise InputError(
                        f"{settings.scenario}: SUMO crashes while loading it "
                        f"({signal.Signals(-child.exitcode).name}); check that network and demand are whole"
                    ) from None
                raise SumoError(_epitaph(child.exitcode, time, folder)) from None
            if message is None:
                break
            if isinstance(message, SlrlError):
                raise message
            if isinstance(message, str):
                raise RuntimeError(f"the simulation process failed:\n{message}")
            if isinstance(message, Started):
                time = message.step.time
            elif isinstance(message, Decision):
                time = message.steps[-1].time
            yield message
    finally:
        # The child notices when it sends its next event, and closes SUMO properly; while it loads it sends nothing.
        receiver.close()
        if time is None:
            child.terminate()
        child.join(GRACE)
        if child.is_alive():
            child.kill()
            child.join()
        shutil.rmtree(folder, ignore_errors=True)


def _serve(
    sender: Connection, settings: RunSettings, views_at: frozenset[int], with_surfaces: bool, folder: str
) -> None:
    """The child: sends every event, then None; or the error that ended the run, or the traceback of a bug."""
    settle_in(folder)
    try:
        sender.send(_send_events(sender, settings, views_at, with_surfaces))
    except BrokenPipeError:
        # The parent has gone or wants no more; if it was killed, nobody else clears up.
        shutil.rmtree(folder, ignore_errors=True)


def _send_events(
    sender: Connection, settings: RunSettings, views_at: frozenset[int], with_surfaces: bool
) -> SlrlError | str | None:
    """Send every event; returns what is to be said in the end."""
    try:
        from slrl_sumo.simulation.run import run

        with closing(run(settings, views_at)) as events:
            for event in events:
                if isinstance(event, Started) and not with_surfaces:
                    event = replace(event, surfaces=SurfaceShapes(()))
                sender.send(event)
    except SlrlError as error:
        return error
    except BrokenPipeError:
        raise
    except Exception:
        return traceback.format_exc()
    return None


def _open_closed_streams() -> None:
    """Put standard streams that the user has closed on /dev/null: else the next files that are opened take their place,
    and what is printed ends in them."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _epitaph(exitcode: int | None, time: float | None, folder: Path) -> str:
    """One line on how the child died."""
    when = "while it was loading" if time is None else f"after {time:g} s of simulation time"
    how = f"exit code {exitcode}"
    if exitcode is not None and exitcode < 0:
        how = signal.Signals(-exitcode).name
        if exitcode == -signal.SIGKILL:
            how += ": somebody killed it, or it took too much memory"
    try:
        printed = (folder / PRINTED).read_text(errors="replace").splitlines()
    except OSError:
        printed = []
    words = [line.removeprefix("Error:").strip() for line in printed if line.startswith("Error:")]
    return f"SUMO died {when} ({how}){': ' + words[-1] if words else ''}"
