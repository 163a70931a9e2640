"""Selectors in trips, compared by pairs."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_routes, make_world

from benchmarks.measure_trips import GROUPS, IN_GROUP, SITUATIONS, SUMS, Play, compared, situations, spoil
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.route_context import route_context


def sums(reward: float, contacts: float = 0.0) -> dict[str, float]:
    every = dict.fromkeys(SUMS, 0.0) | {"steps": 100.0, "reward": reward, "contacts": contacts}
    for group in GROUPS:
        every |= {f"{what}_{group}": 0.0 if group == "pedestrian" else 10.0 for what in IN_GROUP}
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


def test_situations_of_road_users() -> None:
    # A car that starts, one that is free, one behind it, one before a line, one inside, one beside its path, a person.
    n, far = 7, np.inf
    users = make_world(np.arange(n), np.zeros(n), speed=[0.0, 9.0, 9.0, 9.0, 5.0, 9.0, 1.0], type=[0, 0, 0, 0, 0, 0, 2])
    route = replace(
        make_routes(np.zeros((n, 1)), known=True), junction_entry_time=np.array([far, far, far, far, 3.0, far, far])
    )
    context = replace(
        route_context(route, users),
        leader_gap=np.array([20.0, 60.0, 12.0, 30.0, far, 60.0, 2.0]),
        stop_distance=np.array([far, far, far, 10.0, far, far, far]),
        lateral_offset=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.7, 0.0]),
    )
    found = situations(context, users)
    assert tuple(found) == SITUATIONS
    assert [np.flatnonzero(rows).tolist() for rows in found.values()] == [[0], [1, 5], [2], [3], [4], [5], [6]]


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
