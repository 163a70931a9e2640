"""The last 2 s of motion, in a simulation and in a recording."""

from dataclasses import replace

import numpy as np
from builders import make_bundle, make_recording

from slrl_sumo.agent.decide import Agent, consider
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.agent.selectors import PriorSelector
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.learning.supervised.windows import windows
from slrl_sumo.perception.past_motion import PAST, PastMotion, recorded_past


def recording() -> Trajectories:
    """Two tracks that speed up and turn; the second begins 3 frames later and ends earlier."""
    random = np.random.default_rng(2)
    ways = []
    for rows in (12, 6):
        heading = np.cumsum(random.uniform(-0.1, 0.1, rows))
        z = np.cumsum(random.uniform(0.2, 1.0, rows) * np.exp(1j * heading))
        ways.append((z.real, z.imag, heading))
    return make_recording(*ways, first=[0, 3], type=2, ids=("a", "b"))


def test_a_simulation_remembers_what_a_recording_has() -> None:
    made, memory = recording(), PastMotion()
    for frame in range(12):
        world, rows = made.world(frame), made.rows_at(frame)
        past = memory.of(world, len(world))
        # Of the first row of a track a simulation knows the speed, as the recording has it.
        np.testing.assert_allclose(past, recorded_past(made, rows))
        np.testing.assert_allclose(memory.of(world, 1), past[:1])  # asked again


def test_memory_begins_anew_where_a_road_user_was_away_or_time_goes_back() -> None:
    made, memory = recording(), PastMotion()
    for frame in (3, 4, 5):
        memory.of(made.world(frame), 2)
    memory.of(made.world(6), 1)  # only the first one is learned
    both = made.world(7)
    past = memory.of(both, 2)
    np.testing.assert_allclose(past[0], recorded_past(made, made.rows_at(7))[0])
    np.testing.assert_allclose(past[1], [[both.speed[1], 0.0]] * PAST)
    again = memory.of(replace(made.world(3), time=-100.0), 2)
    np.testing.assert_allclose(again[:, :, 1], 0.0)


def test_a_run_decides_from_the_vector_that_windows_have() -> None:
    """The driver of a simulation, led along a recording, perceives what a fit learns from."""
    made, bundle = recording(), make_bundle("history")
    agent = Agent(bundle, PriorSelector(bundle, np.random.default_rng(1).random))
    driver, ground = ModelDriver(agent), everywhere_road(made.x, made.y)
    every = windows([made], 1, "history", future=4)
    assert len(every) == 12 - 2 - 4
    for frame in range(12):
        world = made.world(frame)
        seen = consider(driver.scene(world, len(world), ground), agent).observation.vector
        rows = made.rows_at(frame)
        for window in np.flatnonzero(every.frame == frame):
            place = int(np.flatnonzero(made.track[rows] == every.track[window])[0])
            np.testing.assert_allclose(seen[place], every.vector[window], rtol=1e-5, atol=1e-6)
