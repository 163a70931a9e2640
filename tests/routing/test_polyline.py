"""Lines by hand: where places lie beside them, and points drawn along them."""

import math

import numpy as np
import pytest

from slrl_sumo.routing.polyline import Polyline, line_through


@pytest.fixture
def corner() -> Polyline:
    """10 m east, then 6 m north."""
    line, along = line_through([(0, 0), (4, 0), (10, 0), (10, 0.01), (10, 6)])
    assert along == [0.0, 4.0, 10.0, 10.0, 16.0]
    return line


def drawn(line: Polyline, begin: float, spacing: float, many: int) -> tuple[list[float], list[float]]:
    x, y = np.full((3, many), np.nan), np.full((3, many), np.nan)
    line.draw(begin, spacing, x, y, 1)
    assert np.isnan(np.concatenate([x[[0, 2]], y[[0, 2]]])).all()
    return x[1].tolist(), y[1].tolist()


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ((3.0, 2.0), (3.0, 2.0, 2.0)),
        ((3.0, -2.0), (3.0, -2.0, 2.0)),
        ((9.0, 5.0), (15.0, 1.0, 1.0)),
        ((12.0, 3.0), (13.0, -2.0, 2.0)),
        # Before the begin and beyond the end it is seen from there, beside the first and the last piece.
        ((-3.0, 4.0), (0.0, 4.0, 5.0)),
        ((13.0, 10.0), (16.0, -3.0, 5.0)),
    ],
)
def test_the_nearest_place(corner: Polyline, place: tuple[float, float], found: tuple[float, float, float]) -> None:
    assert corner.place(*place, -math.inf, math.inf) == pytest.approx(found)
    assert corner.nearest(*place) == pytest.approx(found[:2])


def test_only_what_lies_between_counts(corner: Polyline) -> None:
    # Nearest of all is (10, 3): 13 m along.
    assert corner.place(9.0, 3.0, 2.0, 10.0) == pytest.approx((9.0, 3.0, 3.0))
    assert corner.place(9.0, 3.0, 2.0, 7.0) == pytest.approx((7.0, 3.0, math.hypot(2.0, 3.0)))
    assert corner.place(9.0, 3.0, 14.5, math.inf) == pytest.approx((14.5, 1.0, math.hypot(1.0, 1.5)))
    # Nothing of the line lies there.
    assert corner.place(9.0, 3.0, 17.0, 20.0) == (17.0, 0.0, math.inf)


def test_the_nearest_place_of_crooked_lines_against_many_points_on_them() -> None:
    rng = np.random.default_rng(4)
    for _ in range(30):
        line, _ = line_through(rng.uniform(0.0, 50.0, (12, 2)).tolist())
        x, y = rng.uniform(0.0, 50.0, 2).tolist()
        begin, end = sorted(rng.uniform(0.0, line.end, 2).tolist())
        along = np.linspace(begin, end, 20_001)
        apart = np.hypot(np.interp(along, line.s, line.x) - x, np.interp(along, line.s, line.y) - y)
        place, beside, distance = line.place(x, y, begin, end)
        assert distance == pytest.approx(apart.min(), abs=0.02)
        assert begin <= place <= end
        assert math.dist(line.at(place)[:2], (x, y)) == pytest.approx(distance, abs=1e-9)
        assert abs(beside) <= distance + 1e-9


def test_points_along_a_line_and_straight_on_beyond_its_ends(corner: Polyline) -> None:
    x, y = drawn(corner, -2.5, 2.5, 9)
    assert x == pytest.approx([-2.5, 0.0, 2.5, 5.0, 7.5, 10.0, 10.0, 10.0, 10.0])
    assert y == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.5, 5.0, 7.5])
    # All before the begin, all beyond the end.
    assert drawn(corner, -9.0, 1.0, 3)[0] == pytest.approx([-9.0, -8.0, -7.0])
    assert drawn(corner, 20.0, 1.0, 3)[1] == pytest.approx([10.0, 11.0, 12.0])
