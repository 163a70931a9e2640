"""Queues, in hand-made traffic."""

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.metrics.traffic.queues import find_queues

STOP = np.concatenate([np.arange(0.0, 20.0, 4.0), np.full(40, 20.0)])
"""x of a vehicle that stands from frame 5 on, for 16 s."""


def test_queues_have_place_time_length_and_the_longest_wait() -> None:
    later = np.concatenate([np.arange(0.0, 20.0, 4.0) - 60.0, np.arange(-40.0, 8.0, 4.0), np.full(20, 12.0)])
    passing = np.arange(0.0, 90.0, 4.0)
    short = np.concatenate([np.arange(100.0, 112.0, 4.0), np.full(8, 112.0), np.arange(116.0, 140.0, 4.0)])
    t = make_recording(
        (STOP, 0.0, 0.0), (later, 0.0, 0.0), (passing, 3.0, 0.0), (short, 0.0, 0.0), (STOP + 200.0, 0.0, 0.0),
        ids=("a", "b", "c", "d", "e#1"),
    )  # fmt: skip
    first, second = find_queues(t)
    assert (first.longest, first.first_id) == (2, "a")
    assert first.first_s == pytest.approx(40 * 0.4, abs=0.5)
    assert first.waited_s == pytest.approx(60 * 0.4, abs=1.0)
    assert 12.0 <= first.x <= 20.0
    assert first.begin == pytest.approx(t.t0 + 5 * 0.4, abs=0.5)
    assert (second.longest, second.first_id, second.x) == (1, "e", pytest.approx(220.0))


def test_pedestrians_and_short_stops_are_no_queue() -> None:
    assert find_queues(make_recording((STOP, 0.0, 0.0), type=2)) == []
    assert find_queues(make_recording((np.arange(0.0, 80.0, 4.0), 0.0, 0.0))) == []
