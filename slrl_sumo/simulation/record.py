"""Recording of plain SUMO traffic as trajectories: training data of the supervised models."""

import pickle
from collections.abc import Generator, Iterator

from slrl_sumo.errors import SumoError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_builder import TrajectoryBuilder
from slrl_sumo.jobs.process import WorkerDiedError, WorkerProcess
from slrl_sumo.scene.jumps import jumped
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from slrl_sumo.sumo.session import SumoSession


def record(
    scenario: Scenario, *, seconds: float, seed: int, step_length: float | None = None
) -> Iterator[float | Trajectories]:
    """Run `scenario` without learned road users and record all road users every 0.4 s.

    Yields the completed share (0 to 1) after each interval, and finally the Trajectories.
    """
    builder = TrajectoryBuilder(source=f"SUMO traffic of scenario {scenario.name}, seed {seed}", licence="")
    with SumoSession(scenario, seed=seed, step_length=step_length) as session:
        intervals = max(1, round(seconds / DECISION_INTERVAL))
        before: WorldState | None = None
        for k in range(intervals):
            for _ in range(session.substeps):
                session.step()
            world = background_world(session.reader.read(), session.time, frozenset())
            builder.append(world, jumped(before, world) if before is not None else ())
            before = world
            yield (k + 1) / intervals
    yield builder.build()


def record_isolated(
    scenario: str, *, seconds: float, seed: int, step_length: float | None
) -> Generator[float | Trajectories, None, None]:
    """Like `record` for a scenario by name, in a child process. Raises SumoError if the process dies."""
    process = WorkerProcess(pickle.dumps(_recorded))
    process.send(pickle.dumps((scenario, seconds, seed, step_length)))
    try:
        while (item := pickle.loads(process.receive())) is not None:
            if isinstance(item, BaseException):
                raise item
            yield item
    except WorkerDiedError as death:
        raise SumoError(f"SUMO died: {death}; no output was written") from None
    finally:
        process.close()


def _recorded(job: tuple[str, float, int, float | None]) -> Iterator[float | Trajectories]:
    """The recording of the child process."""
    scenario, seconds, seed, step_length = job
    yield from record(find_scenario(scenario), seconds=seconds, seed=seed, step_length=step_length)


def recorded_whole(scenario: str, seconds: float, step_length: float | None, seed: int) -> Trajectories:
    """The Trajectories of `record` for a scenario by name."""
    for item in record(find_scenario(scenario), seconds=seconds, seed=seed, step_length=step_length):
        if not isinstance(item, float):
            return item
    raise AssertionError("a recording ends with trajectories")
