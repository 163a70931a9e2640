"""The vector of a road user against brute force."""

from collections.abc import Callable

import numpy as np
import pytest
from builders import make_crowd

from slrl_sumo.perception.features import CLOSENESS, FEATURES, NEAR, NEAR_FIRST, NEAREST, STATES, features, state
from slrl_sumo.perception.past_motion import PAST
from slrl_sumo.scene.state import WorldState

CAR, BICYCLE, PEDESTRIAN = 0, 1, 2


def counts(world: WorldState, row: int) -> list[int]:
    """One road user at a time, one other at a time."""
    found = [0] * 6
    for other in range(len(world)):
        distance = np.hypot(world.x[other] - world.x[row], world.y[other] - world.y[row])
        for k, radius in enumerate((5.0, 10.0, 20.0)):
            if other != row and distance <= radius:
                found[k + (3 if world.type[other] == CAR else 0)] += 1
    return found


def test_columns(place: Callable[..., WorldState]) -> None:
    world = place([(CAR, 0, 0, 0.1), (BICYCLE, 100, 0, -3.0), (PEDESTRIAN, 200, 0, 3.0), (PEDESTRIAN, 203, 0, 3.0)])
    table = features(world, np.array([2, 0, 1]))
    assert table.dtype == np.float32
    by_name = {name: table[:, k].tolist() for k, name in enumerate(FEATURES)}
    assert len(by_name) == 12
    assert by_name["speed"] == [2.5, 0.5, 1.5]
    assert by_name["acceleration"] == [-1.25, -3.25, -2.25]
    assert by_name["heading"] == pytest.approx([3.0, 0.1, -3.0])
    assert (by_name["car"], by_name["bicycle"], by_name["pedestrian"]) == ([0, 1, 0], [0, 0, 1], [1, 0, 0])
    assert (by_name["vru_5"], by_name["vru_20"], by_name["other_20"]) == ([1, 0, 0], [1, 0, 0], [0, 0, 0])


@pytest.mark.parametrize(("n", "side"), [(2, 10.0), (60, 40.0), (300, 120.0)])
def test_counts_agree_with_brute_force(n: int, side: float) -> None:
    for seed in range(4):
        world = make_crowd(n, seed, side, -side / 2)
        rows = np.random.default_rng(seed).permutation(n)[: max(1, n // 2)]
        assert features(world, rows)[:, 6:].tolist() == [counts(world, row) for row in rows]


def test_radii_are_inclusive(place: Callable[..., WorldState]) -> None:
    # Pythagorean triples have exact distances; a hair farther is outside.
    world = place(
        [
            (CAR, 0, 0, 0),
            (PEDESTRIAN, 3, 4, 0),
            (CAR, -6, 8, 0),
            (BICYCLE, 12, -16, 0),
            (CAR, 0, -20.0001, 0),
            (CAR, 5.0001, 0, 0),
        ]
    )
    assert features(world, np.array([0]))[0, 6:].tolist() == [1, 1, 2, 0, 2, 2]


def test_coincident_road_users_count_each_other_but_not_themselves(place: Callable[..., WorldState]) -> None:
    world = place([(CAR, 7, 7, 0), (PEDESTRIAN, 7, 7, 1), (PEDESTRIAN, 7, 7, 2)])
    assert features(world, np.arange(3))[:, 6:].tolist() == [[2, 2, 2, 0, 0, 0], [1, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]]


def test_a_road_user_asked_for_twice_is_still_itself(place: Callable[..., WorldState]) -> None:
    world = place([(CAR, 0, 0, 0), (CAR, 3, 0, 0)])
    assert features(world, np.array([0, 0]))[:, 6:].tolist() == [[0, 0, 0, 1, 1, 1]] * 2


def test_background_traffic_counts_as_well(place: Callable[..., WorldState]) -> None:
    world = place([(CAR, 0, 0, 0), (CAR, 3, 0, 0)])
    assert world.learned.tolist() == [True, False]
    assert features(world, np.array([0]))[0, 9] == 1


def test_scenes_do_not_see_each_other() -> None:
    world, scene = make_crowd(90, 4, 30.0, -15.0), np.random.default_rng(4).integers(0, 3, 90)
    found = features(world, np.arange(90), scene)
    for one in range(3):
        rows = np.flatnonzero(scene == one)
        assert np.array_equal(found[rows], features(world.take(rows), np.arange(len(rows))))
    assert found[:, 6:].any()
    assert (found != features(world, np.arange(90))).any()


def test_one_alone_and_none(place: Callable[..., WorldState]) -> None:
    world = place([(BICYCLE, 0, 0, 0)])
    assert features(world, np.array([0]))[0].tolist() == [0.5, -3.25, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0]
    assert features(world, np.zeros(0, np.intp)).shape == (0, 12)
    assert features(place([]), np.zeros(0, np.intp)).shape == (0, 12)


def test_the_order_of_the_world_does_not_matter() -> None:
    world = make_crowd(80, 9, 50.0, -25.0)
    order = np.random.default_rng(0).permutation(80)
    assert np.array_equal(features(world.take(order), np.arange(80)), features(world, order))


def test_rows_outside_the_world_are_refused() -> None:
    with pytest.raises(IndexError, match="index 5"):
        features(make_crowd(5, 1, 10.0, -5.0), np.array([0, 5]))


def nearest(world: WorldState, row: int) -> list[float]:
    """One other road user at a time."""
    turn = np.exp(-1j * world.heading[row])
    place = (world.x - world.x[row] + 1j * (world.y - world.y[row])) * turn
    velocity = (world.speed * np.exp(1j * world.heading) - world.speed[row] * np.exp(1j * world.heading[row])) * turn
    found: list[float] = []
    for other in np.argsort(np.abs(place), kind="stable")[1 : 1 + NEAREST]:
        far = abs(place[other])
        if far < NEAR:
            parts = np.exp(-far / CLOSENESS) * np.array([place[other] / far, velocity[other]])
            found += [value for part in parts for value in (part.real, part.imag)]
    return found + [0.0] * (4 * NEAREST - len(found))


@pytest.mark.parametrize(("n", "side"), [(2, 10.0), (60, 40.0), (200, 300.0)])
def test_nearest_road_users_agree_with_brute_force(n: int, side: float) -> None:
    world = make_crowd(n, 3, side, -side / 2)
    rows = np.random.default_rng(5).permutation(n)[: max(1, n // 2)]
    table = state(world, rows, None, None, "history")
    assert table.shape == (len(rows), len(STATES["history"]))
    np.testing.assert_array_equal(table[:, :12], features(world, rows))
    np.testing.assert_allclose(table[:, NEAR_FIRST:], [nearest(world, row) for row in rows], atol=1e-5)
    # Road users of other scenes are not perceived.
    alone = state(world, rows, np.arange(n), None, "history")
    assert not alone[:, NEAR_FIRST:].any()


def test_the_past_has_its_columns(place: Callable[..., WorldState]) -> None:
    world = place([(CAR, 0, 0, 0), (BICYCLE, 100, 0, 0)])
    past = np.arange(2 * PAST * 2, dtype=np.float64).reshape(2, PAST, 2)
    table = dict(zip(STATES["history"], state(world, np.array([1]), None, past, "history")[0].tolist(), strict=True))
    assert [table[f"speed_{k}"] for k in (1, 2, 3, 4)] == [8, 10, 12, 14]
    assert [table[f"yaw_rate_{k}"] for k in (1, 2, 3, 4)] == [9, 11, 13, 15]
    assert table["yaw_rate"] == world.yaw_rate[1]
    # Unknown pasts are straight, at the present speed.
    table = dict(zip(STATES["history"], state(world, np.array([1]), None, None, "history")[0].tolist(), strict=True))
    assert {table[f"speed_{k}"] for k in (1, 2, 3, 4)} == {table["speed"]}
    assert {table[f"yaw_rate_{k}"] for k in (1, 2, 3, 4)} == {0.0}
