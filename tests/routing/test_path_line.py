"""Lines along lanes, by hand."""

from functools import partial

import numpy as np
import pytest

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.path_line import SIDEWAYS, VIEW, path_line
from slrl_sumo.sumo.network.lanes import Lane
from tests.builders import make_lane

LIMIT = 25.0
BEFORE = [(-10.0, 0.0)]


lane = partial(make_lane, max_speed=LIMIT)

ROAD = lane("in_0", (0.0, 0.0), (100.0, 0.0))
ASIDE = lane(":j_0_0", (100.0, 0.0), (103.0, -3.2))
EXIT, THROUGH = lane("out_0", (103.0, -3.2), (303.0, -3.2)), lane("out_1", (103.0, 0.0), (303.0, 0.0))


def heights(lanes: list[Lane], *others: Lane, at: list[float]) -> list[float]:
    """y of the line of `lanes` at m along it from the begin of the first one, in a network with `others`."""
    line, ends = path_line(lanes, BEFORE, {one.id: one for one in (*lanes, *others)})
    begin = ends[0] - lanes[0].length
    assert line.end == pytest.approx(ends[-1] + VIEW)
    return [line.at(begin + s)[1] for s in at]


def test_an_exit_beside_the_road_is_reached_as_in_a_lane_change() -> None:
    # SUMO goes 3.2 m aside within 3 m; at 25 m/s, 1.5 m/s sideways take 53 m.
    way = 3.2 / SIDEWAYS * LIMIT
    found = heights([ROAD, ASIDE, EXIT], THROUGH, at=[50.0, 100.0, 100.0 + 0.5 * way, 100.0 + way + 1.0, 250.0])
    assert found == pytest.approx([0.0, 0.0, -1.6, -3.2, -3.2], abs=0.05)
    # The same where the path begins on the exit, and its rear is still on the road.
    line, ends = path_line([EXIT], [(90.0, 0.0), (103.0, 0.0)], {one.id: one for one in (EXIT, THROUGH)})
    assert line.at(13.0 + 0.5 * way)[1] == pytest.approx(-1.6, abs=0.05)
    assert ends[0] == pytest.approx(13.0 + 200.0, abs=0.2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shift_by_two_lanes_is_spread_as_well(side: float) -> None:
    """Where lanes for turns are added, SUMO's lanes go 6.4 m aside within 8 m: cars braked from 16.7 to 4.4 m/s."""
    aside = lane(":j_4_0", (100.0, 0.0), (108.0, -6.4 * side))
    exits = [lane(f"out_{k}", (108.0, side * (3.2 * k - 6.4)), (308.0, side * (3.2 * k - 6.4))) for k in range(3)]
    first, *others = exits
    found = heights([ROAD, aside, first], *others, at=[100.0, 154.0, 215.0])
    assert [side * y for y in found] == pytest.approx([0.0, -3.2, -6.4], abs=0.3)
    assert heights([ROAD, aside, first], others[1], at=[112.0]) == pytest.approx([-6.4 * side], abs=0.2)


def test_where_no_lane_lies_beside_it_sumo_s_way_is_kept() -> None:
    sidewalk = lane("out_1", (103.0, 0.0), (303.0, 0.0), surface=Surface.SIDEWALK)
    for others in ([], [sidewalk], [lane("out_2", (103.0, 3.2), (303.0, 3.2))]):
        assert heights([ROAD, ASIDE, EXIT], *others, at=[100.0, 105.0, 120.0]) == pytest.approx(
            [0.0, -3.2, -3.2], abs=0.2
        )


def test_a_line_does_not_ease_outside_the_carriageway() -> None:
    """A place to the right of the rightmost lane: a line led 4 m beside the lane (Leeds)."""
    outer = lane("out_0", (103.0, 3.2), (303.0, 3.2))
    aside = lane(":j_0_0", (100.0, 0.0), (103.0, 3.2))
    inner = lane("out_1", (103.0, 6.4), (303.0, 6.4))
    assert heights([ROAD, aside, outer], inner, at=[100.0, 106.0, 120.0]) == pytest.approx([0.0, 3.2, 3.2], abs=0.2)


def test_lanes_that_shift_together_are_eased_alike() -> None:
    """Else two cars side by side meet: the way of the outer lane would lead beside the carriageway (Leeds)."""
    beside = [lane(":j_0_1", (100.0, 3.2), (103.0, 0.0)), THROUGH]
    found = heights([ROAD, ASIDE, EXIT], *beside, at=[100.0, 105.0, 120.0])
    assert found == pytest.approx([0.0, -3.2, -3.2], abs=0.2)
    bent = lane(":j_0_1>0", *ASIDE.points)
    assert heights([ROAD, bent, EXIT], *beside, at=[105.0]) == pytest.approx([-0.3], abs=0.1)
    # With room for both, as where a lane is added on the left.
    third = lane("out_2", (103.0, 3.2), (303.0, 3.2))
    for path in ([ROAD, ASIDE, EXIT], [lane("in_1", (0.0, 3.2), (100.0, 3.2)), *beside]):
        before = [(-10.0, path[0].points[0][1])]
        line, _ = path_line(path, before, {one.id: one for one in (ASIDE, EXIT, *beside, third)})
        begin, middle = line.at(110.0)[1], line.at(110.0 + 0.5 * 3.2 / SIDEWAYS * LIMIT)[1]
        assert begin - middle == pytest.approx(1.6, abs=0.1)


def test_ways_through_junctions_are_kept() -> None:
    # A turn, a gentle shift across a wide junction, and a far one.
    turn = [lane(":j_1_0", (100.0, 0.0), (108.0, 8.0)), lane("up_0", (108.0, 8.0), (108.0, 99.0))]
    shift = [lane(":j_2_0", (100.0, 0.0), (120.0, -3.2)), lane("out_0", (120.0, -3.2), (220.0, -3.2))]
    far = [lane(":j_3_0", (100.0, 0.0), (108.0, -8.0)), lane("out_0", (108.0, -8.0), (208.0, -8.0))]
    for lanes in (turn, shift, far):
        line, ends = path_line([ROAD, *lanes], BEFORE, {"out_1": THROUGH, "up_1": THROUGH})
        drawn = np.concatenate([BEFORE, *[one.shape for one in (ROAD, *lanes)]])
        for x, y in drawn:
            assert line.place(x, y, -np.inf, np.inf)[2] < 1e-9
        assert ends[-1] == pytest.approx(10.0 + sum(one.length for one in (ROAD, *lanes)))
