"""Surrogate safety of two boxes, against answers worked out by hand and against simulating them in small steps."""

import numpy as np
import pytest

from slrl_sumo.metrics.surrogate_safety import (
    box_distance,
    deceleration_to_avoid_crash,
    post_encroachment_time,
    time_to_collision,
)
from slrl_sumo.scene.geometry import boxes_overlap

CAR = (4.0, 2.0)
NORTH, WEST = 0.5 * np.pi, np.pi


def ttc(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Of two cars given as x, y, heading, vx, vy."""
    boxes = [np.array([[*car[:3], *CAR]]) for car in (a, b)]
    speeds = [np.array([car[3:]], np.float64) for car in (a, b)]
    (value,) = time_to_collision(a=boxes[0], b=boxes[1], velocity_a=speeds[0], velocity_b=speeds[1])
    return float(value)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        # 20 m between centres are 16 m between bumpers; together 10 + 6 m/s.
        pytest.param((0, 0, 0, 10, 0), (20, 0, WEST, -6, 0), 1.0, id="head-on"),
        pytest.param((0, 0, 0, 10, 0), (20, 0, 0, 6, 0), 4.0, id="following a slower one"),
        pytest.param((0, 0, 0, 6, 0), (20, 0, 0, 10, 0), np.inf, id="following a faster one"),
        # The front (x = 2) reaches the flank (x = 9) after 0.7 s, when the other is at y = 0: it is within 2 + 1 m.
        pytest.param((0, 0, 0, 10, 0), (10, -7, NORTH, 0, 10), 0.7, id="crossing"),
        # The second one is far past when the first one arrives.
        pytest.param((0, 0, 0, 10, 0), (10, 0, NORTH, 0, 20), np.inf, id="crossing, through in time"),
        pytest.param((0, 0, 0, 10, 0), (0, 2.5, 0, 15, 0), np.inf, id="parallel"),
        pytest.param((0, 0, 0, 10, 0), (30, 2.5, WEST, -10, 0), np.inf, id="oncoming on the other lane"),
        # 0.5 m between their sides, at 1 m/s.
        pytest.param((0, 0, 0, 10, 0), (0, 2.5, 0, 10, -1), 0.5, id="changing into the other's lane"),
        pytest.param((0, 0, 0, 0, 0), (3, 0, 0, 5, 0), 0.0, id="overlapping from the start"),
        pytest.param((0, 0, 0, 0, 0), (10, 0, 0, 0, 0), np.inf, id="standing"),
        pytest.param((0, 0, 0, 0, 0), (-16, 0, 0, 4, 0), 3.0, id="towards a standing one"),
        pytest.param((0, 0, 0, 5, 0), (-10, 0, WEST, -5, 0), np.inf, id="away from each other"),
    ],
)
def test_time_to_collision(a: tuple[float, ...], b: tuple[float, ...], expected: float) -> None:
    assert ttc(a, b) == pytest.approx(expected)
    assert ttc(b, a) == pytest.approx(expected)


def test_time_to_collision_is_when_boxes_that_are_moved_in_small_steps_first_overlap() -> None:
    rng = np.random.default_rng(3)
    n, step = 400, 0.01
    a, b = (
        np.column_stack([rng.uniform(-12, 12, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(0.2, 8, (n, 2))])
        for _ in range(2)
    )
    speeds = rng.uniform(-8, 8, (2, n, 2))
    found = time_to_collision(a=a, b=b, velocity_a=speeds[0], velocity_b=speeds[1])
    first = np.full(n, np.inf)
    for k in range(400):
        now = [np.column_stack([box[:, :2] + k * step * v, box[:, 2:]]) for box, v in zip((a, b), speeds, strict=True)]
        first[np.isinf(first) & boxes_overlap(*now)] = k * step
    assert 50 < np.isinf(first).sum() < 350
    soon = found < 3.9
    # A corner that is only grazed may be touched between two steps.
    grazed = soon & np.isinf(first)
    assert grazed.sum() < 5
    assert np.isinf(first[found > 4.1]).all()
    apart = first[soon & ~grazed] - found[soon & ~grazed]
    assert apart.min() > -1e-9
    assert np.percentile(apart, 98) <= step + 1e-9


def test_deceleration_of_a_follower_is_that_of_cooper_and_ferguson() -> None:
    # A gap of 16 m at 10 against 6 m/s: (10 - 6)² / (2 x 16) = 0.5 m/s².
    found = deceleration_to_avoid_crash(ttc=np.array([4.0, np.inf, 0.0]), closing=np.array([4.0, 4.0, 4.0]))
    assert found.tolist() == [0.5, 0.0, np.inf]


def path(start: tuple[float, float], heading: float, speed: float, times: np.ndarray) -> np.ndarray:
    way = np.array(start) + speed * times[:, None] * [np.cos(heading), np.sin(heading)]
    return np.column_stack([way, np.full(len(times), heading), np.tile(CAR, (len(times), 1))])


def test_post_encroachment_time_of_crossing_ways() -> None:
    times = np.arange(0.0, 8.0, 0.01)
    first = path((-20.0, 0.0), 0.0, 10.0, times)
    # The first one's back leaves the other's way (x = 1) at x = 3: after 2.3 s. The second one's front (y0 + 2) reaches
    # y = -1 after (-1 - y0 - 2) / 5 s.
    second = path((0.0, -18.0), NORTH, 5.0, times)
    pet, when = post_encroachment_time(a=first, b=second, times_a=times, times_b=times) or (None, None)
    assert pet == pytest.approx(3.0 - 2.3, abs=0.021)
    assert when == pytest.approx(3.0, abs=0.02)
    assert post_encroachment_time(a=second, b=first, times_a=times, times_b=times) == (pet, when)


def test_post_encroachment_time_of_ways_without_a_common_place_and_of_a_crash() -> None:
    times = np.arange(0.0, 4.0, 0.02)
    way = path((0.0, 0.0), 0.0, 10.0, times)
    assert post_encroachment_time(a=way, b=path((0, 2.5), 0.0, 10.0, times), times_a=times, times_b=times) is None
    crash = post_encroachment_time(a=way, b=path((20.0, -20.0), NORTH, 10.0, times), times_a=times, times_b=times)
    # The first one's front (x = 2) reaches the other's flank (x = 19) after 1.7 s.
    assert crash == (0.0, pytest.approx(1.7, abs=0.021))


@pytest.mark.parametrize(
    ("b", "expected"),
    [
        ((10.0, 0.0, 0.0), 6.0),
        ((0.0, 5.0, 0.0), 3.0),
        ((7.0, 6.0, 0.0), 5.0),  # from corner to corner: 3 and 4 m
        ((8.0, 0.0, NORTH), 5.0),
        ((3.5, 0.0, 0.0), -0.5),
        ((0.0, 0.0, 0.0), -2.0),
        # Its corner is 5 - sqrt(5) away from x = 0 towards the first one's front at x = 2.
        ((2.0 + 3.0 / np.sqrt(2.0) + 1.0, 0.0, np.pi / 4), 1.0),
    ],
)
def test_distance_between_boxes(b: tuple[float, float, float], expected: float) -> None:
    boxes = [np.array([[*pose, *CAR]]) for pose in ((0.0, 0.0, 0.0), b)]
    assert box_distance(a=boxes[0], b=boxes[1]) == pytest.approx(expected)
    assert box_distance(a=boxes[1], b=boxes[0]) == pytest.approx(expected)
