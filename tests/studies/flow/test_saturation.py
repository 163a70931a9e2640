"""Saturation flow: only vehicles that queued, from the fifth on, at the stop line."""

import numpy as np
import pytest

from slrl_sumo.studies.flow.saturation import crossing_times, discharge_headways
from slrl_sumo.studies.flow.trace import OnLanes, Trace, TraceBuilder, on_lanes
from tests.builders import make_world
from tests.studies.flow.test_trace import lane

HEADWAY = 1.9


def queue(count: int, *, missing: int | None = None) -> tuple[Trace, OnLanes]:
    """Cars that stand every 7.5 m before a stop line at 200 m until 10 s; the k-th crosses it at 12 s + k HEADWAY,
    with 10 m/s. The car `missing` never moves."""
    builder = TraceBuilder()
    places = 200.0 - 7.5 * np.arange(count)
    leave = 12.0 + HEADWAY * np.arange(count) - (200.0 - places) / 10.0
    if missing is not None:
        leave[missing] = np.inf
    for time in 0.4 * np.arange(150):
        moving = time > leave
        fronts = places + 10.0 * np.where(moving, time - np.where(moving, leave, 0.0), 0.0)
        there = fronts < 260.0
        speed = np.where(moving, 10.0, 0.0)[there]
        ids = [str(k) for k in np.flatnonzero(there)]
        if ids:
            builder.add(make_world(x=fronts[there] - 2.5, y=0.0, speed=speed, length=5.0, ids=ids, time=time))
    trace = builder.build()
    return trace, on_lanes(trace, [lane("in", (0.0, 0.0), (200.0, 0.0)), lane("out", (210.0, 0.0), (260.0, 0.0))])


def test_headways_are_those_at_the_stop_line_from_the_fifth_vehicle_on() -> None:
    trace, on = queue(12)
    crossed = crossing_times(trace, on, 0)
    assert [crossed[k] for k in range(1, 12)] == pytest.approx([12.0 + HEADWAY * k for k in range(1, 12)], abs=0.05)
    headways = discharge_headways(trace, on, {"in": [10.0]})
    assert len(headways) == 12 - 4
    assert headways == pytest.approx(HEADWAY, abs=0.1)
    assert headways.mean() == pytest.approx(HEADWAY, abs=0.02)


def test_a_queue_ends_before_a_vehicle_that_does_not_follow_and_before_the_next_green() -> None:
    trace, on = queue(12, missing=8)
    assert len(discharge_headways(trace, on, {"in": [10.0]})) == 8 - 4
    trace, on = queue(12)
    until = 12.0 + HEADWAY * 6.5
    assert len(discharge_headways(trace, on, {"in": [10.0, until]})) == 7 - 4
    assert len(discharge_headways(trace, on, {"out": [10.0], "elsewhere": [10.0], "in": []})) == 0
