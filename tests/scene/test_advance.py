"""Motion of one interval against hand computation."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.scene.advance import HALT, INTENT, advance, halting
from slrl_sumo.scene.state import WorldState, empty_world

DT = 0.4


def one(speed: float = 0.0, heading: float = 0.0, x: float = 0.0, y: float = 0.0) -> WorldState:
    return make_world(x, y, heading, speed, acceleration=7.0, yaw_rate=7.0, ids=("u",), time=10.0)


def move(state: WorldState, acceleration: float = 0.0, yaw_rate: float = 0.0, max_speed: float = 50.0) -> WorldState:
    return advance(state, np.array([acceleration]), np.array([yaw_rate]), np.array([max_speed]), DT)


def test_straight_on() -> None:
    after = move(one(speed=5.0, heading=np.pi / 2, x=1.0, y=2.0), acceleration=2.5)
    # 5 + 2.5 x 0.4 = 6 m/s, 2.4 m northwards
    assert after.time == pytest.approx(10.4)
    assert (after.x[0], after.y[0]) == (pytest.approx(1.0), pytest.approx(4.4))
    assert after.speed[0] == pytest.approx(6.0)
    assert after.acceleration[0] == pytest.approx(2.5)
    assert after.yaw_rate[0] == 0.0
    assert after.heading[0] == pytest.approx(np.pi / 2)


def test_a_circle_closes() -> None:
    # 50 intervals of 2 pi / 50 each: the chords make a regular polygon of 50 sides.
    state = start = one(speed=5.0)
    reached = []
    for _ in range(50):
        state = move(state, yaw_rate=2 * np.pi / 50 / DT)
        reached.append((state.x[0], state.y[0]))
    assert (state.x[0], state.y[0]) == (pytest.approx(start.x[0], abs=1e-9), pytest.approx(start.y[0], abs=1e-9))
    assert np.abs(state.heading[0]) == pytest.approx(0.0, abs=1e-9)
    # Sides of 5 m/s x 0.4 s = 2 m; the centre lies straight to the left of the start.
    centre = np.mean(reached, axis=0)
    assert centre == pytest.approx([0.0, 1.0 / np.sin(np.pi / 50)], abs=1e-9)
    assert np.hypot(*(np.array(reached) - centre).T) == pytest.approx(1.0 / np.sin(np.pi / 50))


def test_braking_ends_at_a_standstill() -> None:
    after = move(one(speed=1.0, x=3.0), acceleration=-9.0)
    assert after.speed[0] == 0.0
    assert after.x[0] == 3.0
    assert after.acceleration[0] == pytest.approx(-2.5)  # what was carried out: from 1 m/s to 0 in 0.4 s


def test_speed_is_kept_below_the_maximum() -> None:
    after = move(one(speed=13.0), acceleration=9.0, max_speed=13.4)
    assert after.speed[0] == pytest.approx(13.4)
    assert after.acceleration[0] == pytest.approx(1.0)
    assert after.x[0] == pytest.approx(13.4 * DT)


def test_heading_wraps_at_pi() -> None:
    after = move(one(speed=1.0, heading=np.pi - 0.1), yaw_rate=0.5)
    assert after.heading[0] == pytest.approx(-np.pi + 0.1)
    assert after.yaw_rate[0] == 0.5


def test_road_users_do_not_influence_each_other_and_the_state_before_stays() -> None:
    before = one(speed=5.0).join(replace(one(speed=2.0, heading=1.0, x=9.0), ids=("v",)))
    after = advance(before, np.array([1.0, -1.0]), np.array([0.2, 0.0]), np.array([50.0, 50.0]), DT)
    for i, (acceleration, yaw_rate) in enumerate([(1.0, 0.2), (-1.0, 0.0)]):
        alone = move(before.take(np.array([i])), acceleration, yaw_rate)
        assert (after.x[i], after.y[i], after.speed[i]) == (alone.x[0], alone.y[0], alone.speed[0])
    assert before.speed.tolist() == [5.0, 2.0]
    assert before.x.tolist() == [0.0, 9.0]


def test_an_empty_world_only_gets_older() -> None:
    none = np.zeros(0)
    after = advance(empty_world(1.0), none, none, none, DT)
    assert len(after) == 0
    assert after.time == pytest.approx(1.4)


def test_a_crawling_vehicle_that_does_not_accelerate_stops() -> None:
    # Speeds after 0.4 s: 0.4, 0.6, 0.4, 0.4, 0.0; the third speeds up, and so means to drive on.
    speed = np.array([[0.6, 1.0, 0.3, 0.36, 0.0]])
    acceleration = np.array([[-0.5, -1.0, 0.25, 0.1, 0.0]])
    felt = halting(speed, acceleration, DT)
    assert felt.tolist() == [[pytest.approx(-1.5), -1.0, 0.25, pytest.approx(-0.9), 0.0]]
    assert (speed + felt * DT)[0] == pytest.approx([0.0, 0.6, 0.4, 0.0, 0.0])
    # Exactly at the limits none is stopped.
    assert halting(np.array([HALT]), np.array([0.0]), DT).tolist() == [0.0]
    assert halting(np.array([0.0]), np.array([INTENT]), DT).tolist() == [INTENT]


def test_arrays_of_other_lengths_are_refused() -> None:
    users = one(speed=5.0).join(one(speed=7.0)).join(one(speed=9.0))
    same = advance(users, np.array([1.0]), np.zeros(3), np.full(3, 20.0), DT)
    assert same.speed.tolist() == pytest.approx([5.4, 7.4, 9.4])
    with pytest.raises(ValueError, match="broadcast"):
        advance(users, np.zeros(2), np.zeros(3), np.full(3, 20.0), DT)


def test_what_it_is_given_stays_the_callers() -> None:
    turning = np.array([0.5])
    after = advance(one(speed=5.0), np.zeros(1), turning, np.full(1, 9.0), DT)
    after.yaw_rate[0] = 9.0  # may be written to, as all other columns
    assert turning[0] == 0.5
