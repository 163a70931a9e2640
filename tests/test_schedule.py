"""The simulated schedule of a cluster, by hand."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture(scope="module")
def schedule() -> ModuleType:
    file = Path(__file__).parents[1] / "tools" / "schedule.py"
    spec = importlib.util.spec_from_file_location("schedule", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_whoever_is_free_takes_the_next(schedule: ModuleType) -> None:
    # One core does 3, the other 1, 1, 1; then 2 is left for one of them.
    seconds, waiting = schedule.study(np.array([3.0, 1.0, 1.0, 1.0, 2.0]), 2, driver=0.0, start=10.0, ahead=0.0)
    assert seconds == 15.0
    assert waiting == pytest.approx(2.0 / 10.0)


def test_a_driver_that_is_slower_than_its_cores_decides_the_rate(schedule: ModuleType) -> None:
    seconds, waiting = schedule.study(np.full(100, 1.0), 10, driver=0.5, start=0.0, ahead=0.2)
    assert seconds == pytest.approx(1.0 + 100 * 0.5)
    assert waiting > 0.7


def test_cores_do_not_wait_for_a_quick_driver_that_hands_out_more_than_there_are_cores(schedule: ModuleType) -> None:
    durations = np.random.default_rng(1).uniform(0.5, 1.5, 2000)
    _, without = schedule.study(durations, 10, driver=0.05, start=0.0, ahead=0.0)
    _, ahead = schedule.study(durations, 10, driver=0.05, start=0.0, ahead=0.5)
    assert ahead < 0.5 * without


def test_an_iteration_of_training_is_the_sum_of_its_parts(schedule: ModuleType) -> None:
    rollouts = np.array([[1.0, 3.0], [2.0, 2.0]])
    parts = schedule.training(rollouts, 0.5, 1e6, 1e7, 1e9, 2e9, 1)
    assert parts == pytest.approx({"broadcast": 0.002, "rollout": 2.0, "slowest": 0.5, "receive": 0.03, "update": 1.0})
