"""Contacts: by hand, and against a check of every pair."""

from itertools import combinations

import numpy as np
import pytest
from builders import make_world
from numpy.typing import NDArray

from slrl_sumo.scene import contacts
from slrl_sumo.scene.contacts import FEW, close_pairs, colliding_pairs, contact_pairs, pairs_in_reach
from slrl_sumo.scene.state import WorldState, empty_world

Floats = NDArray[np.float64]


def world(rows: list[tuple[float, float, float, float, float]] | Floats) -> WorldState:
    """Rows of x, y, heading, length, width."""
    x, y, heading, length, width = np.array(rows, np.float64).reshape(-1, 5).T
    return make_world(x, y, heading, length=length, width=width)


def corners(row: Floats) -> Floats:
    x, y, heading, length, width = row
    along = 0.5 * length * np.array([np.cos(heading), np.sin(heading)])
    across = 0.5 * width * np.array([-np.sin(heading), np.cos(heading)])
    return np.array([x, y]) + np.array([along + across, along - across, -along - across, -along + across])


def clipped_area(a: Floats, b: Floats) -> float:
    """Area that two boxes share, by cutting one at the edges of the other (Sutherland and Hodgman)."""
    polygon = corners(a)
    edges = corners(b)
    centre = edges.mean(axis=0)
    for p, q in zip(edges, np.roll(edges, -1, axis=0), strict=True):
        normal = np.array([q[1] - p[1], p[0] - q[0]])
        normal *= np.sign((centre - p) @ normal)
        kept = []
        for s, t in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            ds, dt = (s - p) @ normal, (t - p) @ normal
            if ds >= 0:
                kept.append(s)
            if ds * dt < 0:
                kept.append(s + (t - s) * ds / (ds - dt))
        if len(kept) < 3:
            return 0.0
        polygon = np.array(kept)
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def crowd(seed: int, n: int, side: float) -> Floats:
    """Cars, bicycles and pedestrians, and a bus and a tram among them."""
    rng = np.random.default_rng(seed)
    sizes = np.array([(5.0, 1.8), (1.6, 0.65), (0.215, 0.478)])[rng.integers(0, 3, n)]
    sizes[0], sizes[1] = (18.0, 2.5), (42.0, 2.65)
    return np.column_stack([rng.uniform(0, side, (n, 2)), rng.uniform(-np.pi, np.pi, n), sizes])


def listed(pairs: NDArray[np.intp]) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in pairs]


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_road_users_have_no_contacts(count: int) -> None:
    alone = empty_world() if count == 0 else world([(0, 0, 0, 5, 2)])
    for pairs in (colliding_pairs(alone), contact_pairs(alone)[1], close_pairs(alone, 100.0)):
        assert pairs.shape == (0, 2)


def test_a_collision_is_less_than_half_a_metre_between_centres() -> None:
    small = (0.0, 0.2, 0.4)
    rows = [(0.0, 0.0, *small), (0.49, 0.0, *small), (0.0, 0.5, *small), (-0.3, -0.41, *small)]
    assert listed(colliding_pairs(world(rows))) == [(0, 1)]
    assert listed(close_pairs(world(rows), 0.51)) == [(0, 1), (0, 2), (0, 3)]


def test_boxes_overlap_by_their_size_and_heading() -> None:
    car = (5.0, 1.8)
    behind = world([(0, 0, 0, *car), (4.9, 0, 0, *car)])
    assert listed(contact_pairs(behind)[1]) == [(0, 1)]
    gap = world([(0, 0, 0, *car), (5.1, 0, 0, *car)])
    assert listed(contact_pairs(gap)[1]) == []
    side_by_side = world([(0, 0, 0, *car), (0, 1.9, 0, *car)])
    assert listed(contact_pairs(side_by_side)[1]) == []
    crosswise = world([(0, 0, 0, *car), (0, 1.9, np.pi / 2, *car)])
    assert listed(contact_pairs(crosswise)[1]) == [(0, 1)]
    corner_to_corner = world([(0, 0, 0, *car), (4.0, 2.4, np.pi / 4, *car)])
    assert listed(contact_pairs(corner_to_corner)[1]) == [(0, 1)]


@pytest.fixture(params=["at once", "by search"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The two ways to find pairs: among few road users and among many."""
    monkeypatch.setattr(contacts, "FEW", 1_000 if request.param == "at once" else 0)


@pytest.mark.usefixtures("way")
def test_a_long_bus_reaches_far_and_leaves_the_others_as_they_are() -> None:
    walkers = [
        (8.7, 0.3, 0.0, 0.2, 0.5),
        (9.4, 0.0, 0.0, 0.2, 0.5),
        (-8.9, -1.2, 1.0, 0.2, 0.5),
        (0, 1.7, 0.0, 0.2, 0.5),
    ]
    bus = world([*walkers, (0.0, 0.0, 0.0, 18.0, 2.5)])
    assert listed(contact_pairs(bus)[1]) == [(0, 4), (2, 4)]
    turned = world([*walkers, (0.0, 0.0, np.pi / 2, 18.0, 2.5)])
    assert listed(contact_pairs(turned)[1]) == [(3, 4)]


@pytest.mark.usefixtures("way")
def test_two_long_ones_meet_at_their_ends() -> None:
    ordinary = [(200.0 + 10 * i, 0.0, 0.0, 5.0, 1.8) for i in range(8)]
    trams = [(0.0, 0.0, 0.0, 42.0, 2.65), (41.5, 0.5, 0.0, 42.0, 2.65)]
    assert listed(contact_pairs(world(ordinary + trams))[1]) == [(8, 9)]


@pytest.mark.usefixtures("way")
def test_pairs_are_sorted_with_the_smaller_row_first() -> None:
    rows = crowd(5, 80, 30.0)
    for pairs in (contact_pairs(world(rows))[1], close_pairs(world(rows), 3.0)):
        assert len(pairs) > 20
        assert (pairs[:, 0] < pairs[:, 1]).all()
        assert listed(pairs) == sorted(set(listed(pairs)))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("side", [25.0, 60.0, 300.0])
def test_it_finds_what_looking_at_every_pair_finds(seed: int, side: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = crowd(seed, 120, side)
    all_users = world(rows)
    overlapping, close = [], []
    for i, j in combinations(range(len(rows)), 2):
        distance = np.hypot(*(rows[i, :2] - rows[j, :2]))
        if distance < 2.0:
            close.append((i, j))
        if distance < 45.0 and clipped_area(rows[i], rows[j]) > 1e-9:
            overlapping.append((i, j))
    for few in (0, 1_000):
        monkeypatch.setattr(contacts, "FEW", few)
        assert listed(close_pairs(all_users, 2.0)) == close
        assert listed(contact_pairs(all_users)[1]) == overlapping
    assert len(overlapping) > 0


@pytest.mark.parametrize("count", [FEW - 20, FEW + 60])
def test_pairs_in_reach_are_those_of_a_look_at_all_pairs(count: int) -> None:
    rng = np.random.default_rng(count)
    all_users = make_world(x=rng.uniform(0.0, 120.0, count), y=rng.uniform(0.0, 90.0, count))
    reach = np.where(rng.random(count) < 0.2, rng.uniform(5.0, 20.0, count), 0.8)
    apart = np.hypot(all_users.x[:, None] - all_users.x, all_users.y[:, None] - all_users.y)
    i, j = np.nonzero(np.triu(apart < reach[:, None] + reach, 1))
    assert len(i) > 100
    assert pairs_in_reach(all_users, reach).tolist() == np.stack([i, j], axis=1).tolist()
