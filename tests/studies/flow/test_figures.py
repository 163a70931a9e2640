"""Figures of the flow benchmark from traces and trips that are known."""

import numpy as np
import pytest

from slrl_sumo.metrics.traffic.trips import Trip
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.studies.flow.figures import start_figures, time_headways, trip_figures
from slrl_sumo.studies.flow.trace import Trace, TraceBuilder, on_lanes
from tests.builders import make_world
from tests.studies.flow.test_trace import lane


def driven(*speeds: list[float]) -> Trace:
    """A vehicle for each list of speeds, one every 0.4 s."""
    builder = TraceBuilder()
    for step in range(max(map(len, speeds))):
        ids = [str(k) for k, own in enumerate(speeds) if step < len(own)]
        builder.add(make_world(speed=[speeds[int(k)][step] for k in ids], learned=False, ids=ids, time=0.4 * step))
    return builder.build()


def test_of_a_learned_vehicle_only_the_learned_part_is_measured() -> None:
    builder = TraceBuilder()
    for step, (speed, learned) in enumerate([(0.0, False), (5.0, True), (9.0, True), (10.0, False), (10.0, False)]):
        builder.add(make_world(speed=speed, learned=learned, time=0.4 * step))
    assert start_figures(builder.build(), 10.0) == {"start": None, "held": None}


def test_a_start_is_the_time_to_95_percent_and_the_speed_is_held_after_it() -> None:
    slow = [0.0] * 10
    trace = driven([0.0, 5.0, 9.5, 10.0, 10.0, 9.0], [0.0, 9.6, 9.9, 10.2, 10.4], slow)
    found = start_figures(trace, 10.0)
    assert found["start"] == pytest.approx(0.8)
    assert found["held"] == pytest.approx(100.0 * 4 / 8)
    assert start_figures(driven(slow, slow, [10.0]), 10.0)["start"] is None


def test_time_headways_are_from_front_to_front_on_the_own_lane() -> None:
    builder = TraceBuilder()
    builder.add(make_world(x=[80.0, 60.0, 40.0, 70.0], y=[0.0, 0.0, 0.0, 3.2], speed=[10.0, 10.0, 4.0, 10.0]))
    lanes = [lane("right", (0.0, 0.0), (100.0, 0.0)), lane("left", (0.0, 3.2), (100.0, 3.2))]
    trace = builder.build()
    # The third is too slow to follow, the fourth is alone.
    assert time_headways(trace, on_lanes(trace, lanes)) == pytest.approx([2.0])


def test_trips_count_until_they_arrive() -> None:
    car, walker = RoadUserType.CAR, RoadUserType.PEDESTRIAN
    trips = {
        "a": Trip(car, "car", 0.0, 0.0, arrived=50.0, stops=1, distance=500.0),
        "b": Trip(car, "car", 10.0, 0.0, arrived=None, stops=2, distance=300.0),
        "c": Trip(walker, "walker", 0.0, 0.0, arrived=100.0),
    }
    found = trip_figures(trips, 130.0)
    assert {name: found[name] for name in ("departed", "finished", "walkers_finished", "under_way")} == {
        "departed": 2,
        "finished": 1,
        "walkers_finished": 1,
        "under_way": 1,
    }
    assert found["under_way_by_minute"] == [1, 1]
    assert found["stops"] == 1.5
    assert found["speed"] == pytest.approx(800.0 / 170.0, abs=1e-4)
    nothing = trip_figures({}, 60.0)
    assert nothing["finished"] == 0
    assert nothing["speed"] is None
    assert np.isfinite(nothing["under_way"])
