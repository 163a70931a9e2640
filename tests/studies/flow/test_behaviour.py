"""Braking, jerk, lane keeping and standing from traces that are known."""

import numpy as np
import pytest

from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.flow.behaviour import behaviour_figures, changes, long_stands
from slrl_sumo.studies.flow.trace import TraceBuilder, on_lanes
from tests.builders import make_world
from tests.studies.flow.test_figures import driven
from tests.studies.flow.test_trace import lane

ROAD = [lane("road", (0.0, 0.0), (500.0, 0.0))]


def test_hard_braking_counts_once_for_learned_and_background_apart() -> None:
    builder = TraceBuilder()
    # 5 m/s² twice in a row; then 4.5 m/s²; the other one stands.
    for step, speed in enumerate((12.0, 10.0, 8.0, 6.2)):
        builder.add(make_world(x=[10.0 * step, 400.0], speed=[speed, 0.0], learned=[True, False], time=0.4 * step))
    trace = builder.build()
    found = behaviour_figures(trace, on_lanes(trace, ROAD))
    assert found["hard_brakes_learned"] == pytest.approx(3600.0 / (4 * DECISION_INTERVAL), abs=0.01)
    assert found["hard_brakes_background"] == 0.0


def test_changes_are_unknown_where_a_vehicle_begins() -> None:
    acceleration, jerk = changes(driven([0.0, 1.0, 2.0, 2.0], [5.0, 5.0]))
    assert acceleration == pytest.approx([np.nan, 2.5, 2.5, 0.0, np.nan, 0.0], nan_ok=True)
    assert jerk == pytest.approx([np.nan, np.nan, 0.0, -6.25, np.nan, np.nan], nan_ok=True)


def test_lateral_offsets_are_those_at_town_speed_and_steps_off_the_lanes_those_of_the_centre() -> None:
    builder = TraceBuilder()
    builder.add(
        make_world(
            x=[10.0, 50.0, 90.0, 130.0], y=[0.3, 1.5, 1.6 + 1.2, -1.6 - 3.1], speed=[12.0, 5.0, 12.0, 12.0], length=5.0
        )
    )
    trace = builder.build()
    found = behaviour_figures(trace, on_lanes(trace, ROAD))
    assert found["lateral_offset"] == pytest.approx(0.3)
    assert found["off_lane"] == 50.0
    assert found["far_off_lane"] == 1


def test_a_car_that_stands_for_a_minute_counts_unless_something_is_before_it() -> None:
    builder = TraceBuilder()
    for step in range(200):
        moving = step in (20, 100)
        # Behind another one; free, but it moves after 8 s and 32 s; free; at the end of the lane.
        builder.add(
            make_world(
                x=[80.0, 87.0, 200.0, 300.0, 496.0],
                speed=[0.0, 5.0, float(moving), 0.0, 0.0],
                length=5.0,
                time=0.4 * step,
            )
        )
    trace = builder.build()
    assert long_stands(trace, on_lanes(trace, ROAD)) == 1
    empty = TraceBuilder().build()
    assert long_stands(empty, on_lanes(empty, ROAD)) == 0
