"""Ways of persons across walking areas."""

import math

import numpy as np
import pytest

from slrl_sumo.routing.walking.walking_area import back_from, distance_to, way_across

SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])
CORNER = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 2.0), (2.0, 2.0), (2.0, 10.0), (0.0, 10.0)])
PINCHED = np.array(
    [(10.0, 0.0), (10.0, 2.0), (2.3, 2.0), (2.0, 2.3), (2.0, 10.0), (0.0, 10.0), (0.0, 5.0), (2.2, 2.1), (5.0, 0.0)]
)
"""A corner that cuts through itself: within half a metre nothing is inside."""


@pytest.mark.parametrize(
    ("place", "expected"),
    [((2.0, 2.0), -2.0), ((3.5, 1.0), -0.5), ((5.0, 2.0), 1.0), ((2.0, -3.0), 3.0), ((7.0, 8.0), 5.0)],
)
@pytest.mark.parametrize("order", [1, -1])
def test_distances_are_negative_inside(place: tuple[float, float], expected: float, order: int) -> None:
    assert distance_to(SQUARE[::order], np.array([place]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("place", "expected"),
    [((2.0, 1.0), None), ((2.0, 0.2), (2.0, 0.5)), ((2.0, -3.0), (2.0, 0.5)), ((5.0, 2.0), (3.5, 2.0))],
)
@pytest.mark.parametrize("order", [1, -1])
def test_places_lie_behind_the_kerb(
    place: tuple[float, float], expected: tuple[float, float] | None, order: int
) -> None:
    assert back_from(SQUARE[::order], *place) == (expected if expected is None else pytest.approx(expected))


def test_the_way_is_straight_where_that_is_inside() -> None:
    assert way_across(SQUARE, (0.0, 1.0), (4.0, 3.0), 0.3) == []
    # Along the outline, on which sidewalks end.
    assert way_across(SQUARE, (0.0, 0.0), (4.0, 0.0), 0.3) == []


@pytest.mark.parametrize("order", [1, -1])
def test_the_way_bends_around_a_corner(order: int) -> None:
    ((x, y),) = way_across(CORNER[::order], (1.0, 10.0), (10.0, 1.0), 0.3)
    assert (x, y) == pytest.approx((1.7, 1.7))


def test_there_is_a_way_through_an_outline_that_cuts_through_itself() -> None:
    way = [(1.0, 10.0), *way_across(PINCHED, (1.0, 10.0), (10.0, 1.0), 0.3), (10.0, 1.0)]
    assert len(way) > 2
    # Not the straight way, which leaves the outline by 6 m.
    assert max(math.dist(place, (5.5, 5.5)) for place in way[1:-1]) > 4.0
