"""Paths by hand: straight ones, circles, a corner, and what lies beyond their ends."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_routes

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import AHEAD, BEHIND, HERE, POINTS, SPACING, RouteAhead, beside, on_path


def paths(*points: tuple[Floats, Floats]) -> RouteAhead:
    x, y = (np.array(column) for column in zip(*points, strict=True))
    return make_routes(x, y)


def straight(heading: float, x: float = 0.0, y: float = 0.0) -> tuple[Floats, Floats]:
    return x + ALONG * np.cos(heading), y + ALONG * np.sin(heading)


def circle(radius: float) -> tuple[Floats, Floats]:
    """Eastwards through the origin; radius > 0: to the left."""
    return radius * np.sin(ALONG / radius), radius - radius * np.cos(ALONG / radius)


def corner(turn: float, after: float = 10.0) -> tuple[Floats, Floats]:
    """Eastwards, and `after` m on by `turn` to the left."""
    beyond = np.maximum(ALONG - after, 0.0)
    return np.minimum(ALONG, after) + beyond * np.cos(turn), beyond * np.sin(turn)


def test_the_points_reach_as_far_as_they_say() -> None:
    assert (ALONG[0], ALONG[HERE], ALONG[-1]) == (-BEHIND, 0.0, AHEAD)


def test_beside_a_straight_path_and_beyond_its_ends() -> None:
    # North-east; (3, -1) lies 2 / sqrt(2) along and 4 / sqrt(2) to the right. The ends are 8 m behind and 40 m ahead.
    route = paths(straight(np.pi / 4), straight(np.pi, x=100.0, y=7.0))
    x = np.array([[3.0, 45.0, -10.0], [97.0, 50.0, 115.0]])
    y = np.array([[-1.0, 45.0, -10.0], [8.0, 7.0, 5.0]])
    along, aside, heading = on_path(route, x, y)
    root = np.sqrt(2.0)
    assert along[0] == pytest.approx([2 / root, 45 * root, -10 * root])
    assert aside[0] == pytest.approx([-4 / root, 0.0, 0.0], abs=1e-9)
    # Westwards, left is south.
    assert along[1] == pytest.approx([3.0, 50.0, -15.0])
    assert aside[1] == pytest.approx([-1.0, 0.0, 2.0], abs=1e-9)
    assert heading[0] == pytest.approx(np.pi / 4)
    assert np.abs(heading[1]) == pytest.approx(np.pi)


@pytest.mark.parametrize("radius", [20.0, -20.0])
@pytest.mark.parametrize("place", [-5.0, 15.0, 36.0])
def test_beside_a_circle(radius: float, place: float) -> None:
    route = paths(circle(radius))
    # The place by angle; 2 m nearer to the middle, and 3 m away from it.
    turned = place / radius
    x = (radius - np.array([[0.0, 2.0, -3.0]])) * np.sin(turned)
    y = radius - (radius - np.array([[0.0, 2.0, -3.0]])) * np.cos(turned)
    along, aside, heading = on_path(route, x, y)
    # Pieces of 1 m are 6 mm away from the circle in their middle, and turn 0.05 rad from one to the next: places 3 m
    # outside of a point that two of them share are up to 0.08 m apart.
    assert along[0] == pytest.approx([place, place, place], abs=0.08)
    assert aside[0] == pytest.approx([0.0, 2.0, -3.0], abs=0.01)
    assert heading[0] == pytest.approx(turned, abs=0.005)


def test_directions_change_without_jumps_round_a_corner() -> None:
    route = paths(corner(np.pi / 2))
    for place, turn in ((8.0, 0.0), (12.0, np.pi / 2)):
        along, aside, heading = on_path(route, np.array([[min(place, 10.0)]]), np.array([[max(place - 10.0, 0.0)]]))
        assert (along[0, 0], aside[0, 0]) == (pytest.approx(place), pytest.approx(0.0, abs=1e-9))
        assert heading[0, 0] == pytest.approx(turn)
    places = np.linspace(5.0, 15.0, 201)[None]
    _, _, headings = on_path(route, np.minimum(places, 10.0), np.maximum(places - 10.0, 0.0))
    # From one to the other direction within 2 m, at most 0.05 m a time.
    assert np.diff(headings).min() >= -1e-9
    assert np.diff(headings).max() < 0.05 * np.pi / 2
    # Inside of the corner is left.
    assert on_path(route, np.array([[8.0]]), np.array([[1.5]]))[1][0, 0] == pytest.approx(1.5)


def test_directions_at_points_are_those_from_the_one_before_to_the_one_after() -> None:
    route = paths(straight(-2.5), circle(20.0))
    _, aside, headings = on_path(route, route.x, route.y)
    assert aside == pytest.approx(0.0, abs=1e-9)
    assert headings[0] == pytest.approx(-2.5)
    assert headings[1, 1:-1] == pytest.approx(ALONG[1:-1] / 20.0, abs=1e-6)


def test_places_are_beside_the_piece_at_the_nearest_of_all_points() -> None:
    rng = np.random.default_rng(3)
    # Crooked paths that cross themselves, and places all over them.
    turned = rng.normal(0.0, 0.4, (8, POINTS)).cumsum(axis=1)
    route = paths(*zip(np.cos(turned).cumsum(axis=1), np.sin(turned).cumsum(axis=1), strict=True))
    x, y = rng.uniform(-25.0, 25.0, (2, 8, 60))
    along, aside, heading = on_path(route, x, y)
    corners = 0
    for i, j in np.ndindex(x.shape):
        path, place = route.x[i] + 1j * route.y[i], complex(x[i, j], y[i, j])
        nearest = int(np.clip(np.abs(path - place).argmin(), 1, POINTS - 2))
        onward = ((place - path[nearest]) * (path[nearest + 1] - path[nearest]).conjugate()).real > 0.0
        begin = nearest if onward else nearest - 1
        piece = path[begin + 1] - path[begin]
        seen = (place - path[begin]) * piece.conjugate() / abs(piece)
        outside_of_corner = not onward and seen.real > abs(piece)
        corners += outside_of_corner
        if outside_of_corner:
            left = ((path[nearest + 1] - path[nearest]) / piece).imag < 0.0
            seen = abs(piece) + (1j if left else -1j) * abs(place - path[nearest])
        assert along[i, j] == pytest.approx(ALONG[begin] + seen.real)
        assert aside[i, j] == pytest.approx(seen.imag)
        ends = np.angle(path[[begin + 1, min(begin + 2, POINTS - 1)]] - path[[max(begin - 1, 0), begin]])
        turn = np.angle(np.exp(1j * (ends[1] - ends[0])))
        blended = ends[0] + np.clip(seen.real / abs(piece), 0.0, 1.0) * turn
        assert np.angle(np.exp(1j * (heading[i, j] - blended))) == pytest.approx(0.0, abs=1e-9)
    assert corners > 20


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_straight_on_at_a_corner_is_off_the_path(side: float) -> None:
    route = paths(corner(side * 0.5 * np.pi, after=0.0))
    along, aside, heading = on_path(route, np.array([[-2.0, 3.0, 3.0]]), np.array([[0.0, -0.1 * side, 0.1 * side]]))
    assert along[0].tolist() == pytest.approx([-2.0, 0.0, 0.1])
    assert aside[0].tolist() == pytest.approx([0.0, -side * np.hypot(3.0, 0.1), -side * 3.0])
    assert heading[0].tolist() == pytest.approx([0.0, side * 0.25 * np.pi, side * 0.25 * np.pi], abs=0.1)


def test_rows_can_be_taken() -> None:
    route = replace(paths(straight(0.0), circle(9.0), circle(-5.0)), stop=np.array([1.0, 2.0, 3.0]))
    some = route.take(np.array([2, 0]))
    assert len(some) == 2
    assert some.stop.tolist() == [3.0, 1.0]
    np.testing.assert_array_equal(some.y, route.y[[2, 0]])
    none = RouteAhead.unknown(2)
    assert not none.known.any()
    assert np.isinf(np.stack([none.stop, none.line, none.keep_clear_exit, none.remaining_distance])).all()


def test_places_far_from_the_origin_are_those_near_it() -> None:
    rng = np.random.default_rng(6)
    near = paths(straight(0.3), circle(12.0), corner(1.2))
    far = replace(near, x=near.x + 1e5, y=near.y - 1e5)
    x, y = rng.uniform(-15.0, 40.0, (2, 3, 500))
    rows = np.array([2, 0, 1])
    for found, expected in zip(on_path(far, x + 1e5, y - 1e5, rows), on_path(near, x, y, rows), strict=True):
        assert np.allclose(found, expected, atol=1e-6)
    # Row i of the result belongs to path rows[i].
    for row, path in enumerate(rows):
        alone = on_path(near.take(np.array([path])), x[row : row + 1], y[row : row + 1])
        assert all(np.allclose(a[row], b[0]) for a, b in zip(on_path(near, x, y, rows), alone, strict=True))


def test_places_that_do_not_fit_the_paths_are_refused() -> None:
    route = paths(straight(0.0), circle(20.0))
    for x, y in (((2, 3), (2, 1)), ((2, 3), (2, 4)), ((3, 2), (3, 2)), ((1, 2), (1, 2))):
        with pytest.raises(ValueError, match="2 paths, but points"):
            on_path(route, np.zeros(x), np.zeros(y))
    with pytest.raises(ValueError, match="1 paths, but points"):
        on_path(route, np.zeros((2, 1)), np.zeros((2, 1)), np.array([1]))


def test_places_beside_paths_with_other_spacings_are_the_same() -> None:
    # A circle of radius 400 m with points every metre, and every 4 m.
    turn = SPACING * np.arange(-HERE, POINTS - HERE) / 400.0
    fine, coarse = (paths((400.0 * np.sin(k * turn), 400.0 * (1.0 - np.cos(k * turn)))) for k in (1, 4))
    coarse.spacing[:] = 4.0
    x, y = np.array([[3.0, 30.0]]), np.array([[1.0, 4.0]])
    for one, other in zip(on_path(fine, x, y), on_path(coarse, x, y), strict=True):
        assert other == pytest.approx(one, abs=0.02)
    follower, seen = beside(
        coarse, np.array([1.0]), np.array([0.0, 120.0]), np.array([0.0, 18.4]), np.array([2.5, 2.5])
    )
    assert (follower.tolist(), seen.tolist()) == ([0], [1])
