"""Plain SUMO traffic as trajectories: the teacher data of the supervised models."""

from collections.abc import Iterator

import numpy as np

from slrl_sumo.formats.trajectories import Trajectories, TrajectoryBuilder
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from slrl_sumo.sumo.session import SumoSession

# SUMO places road users on lanes, so those that change lane or walking direction at once jump sideways or turn on the
# spot. What a type cannot do within 0.4 s is a jump of the model, not a motion to learn: the track is split there.
MAX_SPEED = np.array([60.0, 15.0, 5.0])
"""m/s per RoadUserType."""
MAX_TURN = np.array([0.8, 1.6, 3.2])
"""rad in one interval per RoadUserType."""
MAX_SIDESTEP = np.array([1.5, 1.0, 5.0])
"""m across the heading in one interval per RoadUserType."""


def record(
    scenario: Scenario, *, seconds: float, seed: int, step_length: float | None = None
) -> Iterator[float | Trajectories]:
    """Run `scenario` without learned road users and record all road users every 0.4 s.

    Yields the share that is done after each interval (0 to 1), and last of all the Trajectories.
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


def recorded_whole(scenario: str, seconds: float, step_length: float | None, seed: int) -> Trajectories:
    """The Trajectories of `record` for a scenario by name."""
    for item in record(find_scenario(scenario), seconds=seconds, seed=seed, step_length=step_length):
        if not isinstance(item, float):
            return item
    raise AssertionError("a recording ends with trajectories")


def jumped(before: WorldState, after: WorldState) -> list[str]:
    """Ids in both worlds (0.4 s apart) whose motion between them is more than their type can do."""
    row_before = {road_user: i for i, road_user in enumerate(before.ids)}
    rows = np.array([i for i, road_user in enumerate(after.ids) if road_user in row_before], np.intp)
    old = np.array([row_before[after.ids[i]] for i in rows], np.intp)
    dx, dy = after.x[rows] - before.x[old], after.y[rows] - before.y[old]
    kind = after.type[rows]
    turn = np.abs(wrap_angle(after.heading[rows] - before.heading[old]))
    middle = before.heading[old] + 0.5 * wrap_angle(after.heading[rows] - before.heading[old])
    aside = np.abs(np.cos(middle) * dy - np.sin(middle) * dx)
    odd = np.hypot(dx, dy) > MAX_SPEED[kind] * DECISION_INTERVAL
    odd |= (turn > MAX_TURN[kind]) | (aside > MAX_SIDESTEP[kind])
    return [after.ids[i] for i in rows[odd]]
