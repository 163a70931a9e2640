"""Places on different levels, by hand."""

import math

import pytest
from builders import make_levels

from slrl_sumo.scene import kernels, levels
from slrl_sumo.scene.levels import ALIGNED, FLAT, LANE_REACH

EAST, NORTH = (1.0, 0.0), (0.0, 1.0)


@pytest.mark.parametrize(("a", "b", "apart"), [
    ((0.0, 0.0, *EAST), (0.0, 0.0, *NORTH), True),
    ((0.0, 0.0, -1.0, 0.0), (0.0, 0.0, 0.0, -1.0), True),  # in the other direction
    ((-15.0, 0.0, *EAST), (1.0, 15.0, *NORTH), True),
    ((0.0, 0.0, *EAST), (5.0, 0.0, *EAST), False),  # on one street
    ((0.0, 0.0, *EAST), (0.0, 0.0, *EAST), False),
    ((-30.0, 0.0, *EAST), (0.0, 0.0, *NORTH), False),  # far from the crossing: nothing is known
    ((0.0, LANE_REACH + 0.5, *EAST), (0.0, 0.0, *NORTH), False),  # beside the street
    ((0.0, 0.0, math.cos(0.4), math.sin(0.4)), (0.0, 0.0, *NORTH), True),  # while it changes lanes
    ((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), (0.0, 0.0, *NORTH), False),  # along neither street
])  # fmt: skip
def test_places_are_apart_where_each_has_a_level_by_its_direction(
    a: tuple[float, ...], b: tuple[float, ...], apart: bool
) -> None:
    assert math.sin(0.4) < ALIGNED < math.sqrt(0.5)
    for function in (levels.apart, kernels.apart):
        assert function(make_levels(), *a, *b) is apart
        assert function(make_levels(), *b, *a) is apart
        assert function(FLAT, *a, *b) is False
