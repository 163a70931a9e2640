"""The simulated schedule of a cluster, by hand."""

import numpy as np
import pytest

from benchmarks import schedule


def test_a_free_core_takes_the_next_job() -> None:
    # One core does 3, the other 1, 1, 1; then 2 is left for one of them.
    seconds, waiting = schedule.study(np.array([3.0, 1.0, 1.0, 1.0, 2.0]), 2, driver=0.0, start=10.0, ahead=0.0)
    assert seconds == 15.0
    assert waiting == pytest.approx(2.0 / 10.0)


def test_a_driver_that_is_slower_than_its_cores_decides_the_rate() -> None:
    seconds, waiting = schedule.study(np.full(100, 1.0), 10, driver=0.5, start=0.0, ahead=0.2)
    assert seconds == pytest.approx(1.0 + 100 * 0.5)
    assert waiting > 0.7


def test_cores_do_not_wait_for_a_quick_driver_that_hands_out_more_than_there_are_cores() -> None:
    durations = np.random.default_rng(1).uniform(0.5, 1.5, 2000)
    _, without = schedule.study(durations, 10, driver=0.05, start=0.0, ahead=0.0)
    _, ahead = schedule.study(durations, 10, driver=0.05, start=0.0, ahead=0.5)
    assert ahead < 0.5 * without


def test_an_iteration_of_training_is_the_sum_of_its_parts() -> None:
    rollouts = np.array([[1.0, 3.0], [2.0, 2.0]])
    parts = schedule.training(rollouts, 0.5, 1e6, 1e7, 1e9, 2e9, 1)
    assert parts == pytest.approx({"broadcast": 0.002, "rollout": 2.0, "slowest": 0.5, "receive": 0.03, "update": 1.0})
