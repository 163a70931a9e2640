"""Selectors in trips, compared by pairs."""

import numpy as np
import pytest

from benchmarks.measure_trips import BY_TYPE, SUMS, Play, compared, spoil
from slrl_sumo.perception.observation import Observation


def sums(reward: float, contacts: float = 0.0) -> dict[str, float]:
    every = dict.fromkeys(SUMS, 0.0) | {"steps": 100.0, "reward": reward, "contacts": contacts}
    for kind, number in (("car", 10.0), ("bicycle", 10.0), ("pedestrian", 0.0)):
        every |= {f"{what}_{kind}": number for what in BY_TYPE}
    return every


def test_differences_are_those_of_pairs() -> None:
    plays = {
        Play("town", 1, "rule"): sums(80.0),
        Play("town", 1, "greedy"): sums(90.0, contacts=1.0),
        Play("town", 2, "rule"): sums(20.0),
        Play("town", 2, "greedy"): sums(40.0, contacts=3.0),
        Play("town", 3, "rule"): sums(50.0),  # played by one selector: it does not count
    }
    rows = {(row["selector"], row["figure"]): row for row in compared(plays, ["rule", "greedy"])}
    reward = rows["greedy", "reward per step"]
    assert (reward["networks"], reward["mean"], reward["difference"]) == (2, pytest.approx(0.65), pytest.approx(0.15))
    assert reward["half_interval"] == pytest.approx(1.96 * np.std([0.1, 0.2], ddof=1) / np.sqrt(2))
    assert rows["greedy", "contacts per 1,000 steps"]["mean"] == pytest.approx(20.0)
    assert rows["greedy", "clean_car"]["mean"] == 1.0
    assert ("greedy", "speed_pedestrian") not in rows


def test_images_are_spoilt_and_nothing_else() -> None:
    image = np.arange(2 * 4 * 4 * 3, dtype=np.uint8).reshape(2, 4, 4, 3)
    seen = Observation(np.ones((2, 12), np.float32), image, np.zeros(2, np.int8))
    assert spoil(seen, "") is seen
    black = spoil(seen, "black")
    assert black.image is not None
    assert not black.image.any()
    assert black.vector is seen.vector
    swapped = spoil(seen, "swapped")
    assert swapped.image is not None
    np.testing.assert_array_equal(swapped.image, image[::-1])
