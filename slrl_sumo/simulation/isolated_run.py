"""A run in a child process: a crash of SUMO ends only that process."""

import pickle
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace

from slrl_sumo.errors import SumoError
from slrl_sumo.jobs.process import EXIT_S, WorkerDiedError, WorkerProcess
from slrl_sumo.simulation.events import Decision, Event, Started
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.isolation import death_message, loading_error


def run_isolated(
    settings: RunSettings,
    views_at: frozenset[int] = frozenset(),
    *,
    with_surfaces: bool = False,
    traced: bool = False,
) -> Generator[Event, None, None]:
    """The same events as `slrl_sumo.simulation.run.run`, from a child process.

    Started.surfaces have no shapes unless `with_surfaces`: the shapes of a city take 80 MiB in each of the two
    processes.

    Raises the errors of `run`, InputError if SUMO crashes on loading, SumoError if the child dies later (segmentation
    fault, kill), with the cause and the simulation time, and DefectError with the child's traceback if it fails by
    a defect of this package. Closing the generator ends the child, and so does the death of this process.
    """
    process = WorkerProcess(pickle.dumps(_events))
    process.send(pickle.dumps((settings, views_at, with_surfaces, traced)))
    time = None
    exit_s = 0.0
    try:
        while (event := pickle.loads(process.receive())) is not None:
            if isinstance(event, BaseException):
                raise event
            if isinstance(event, Started):
                time, exit_s = event.step.time, EXIT_S
            elif isinstance(event, Decision):
                time = event.steps[-1].time
            yield event
        exit_s = 0.0
    except WorkerDiedError as death:
        if time is None:
            raise loading_error(settings.where, death) from None
        raise SumoError(death_message(death, f"after {time:g} s of simulation time")) from None
    finally:
        # A child that simulates notices the closed pipe when it sends its next event, and then closes SUMO properly. A
        # child that is loading would notice too late, and after the last event SUMO is already closed: kill it.
        process.close(exit_s)


def _events(job: tuple[RunSettings, frozenset[int], bool, bool]) -> Generator[Event, None, None]:
    """The run of the child process."""
    from slrl_sumo.simulation.run import run

    settings, views_at, with_surfaces, traced = job
    with closing(run(settings, views_at, traced=traced)) as events:
        for event in events:
            if isinstance(event, Started) and not with_surfaces:
                event = replace(event, surfaces=replace(event.surfaces, shapes=()))
            yield event
