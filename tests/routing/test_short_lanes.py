"""Curves over short lanes, by hand: the lanes of junctions 30624890 and 3214665956 of RESCO's ingolstadt21."""

import math

import numpy as np
import pytest

from slrl_sumo.routing.path_line import path_line
from slrl_sumo.routing.short_lanes import SMOOTH, curve_over, is_short, zigzag
from slrl_sumo.sumo.network.lanes import Lane
from tests.builders import make_lane

IN = make_lane("in_2", (-23.4, 33.8), (-3.4, 6.4))
ACROSS = make_lane(":a_3_1", (-3.4, 6.4), (-2.0, 5.3), (-0.7, 5.0), (0.7, 4.7), (2.0, 3.6))
SHORT_LANE = make_lane("short_2", (2.0, 3.6), (2.1, 3.4))
BACK = make_lane(":b_2_1", (2.1, 3.4), (0.0, 0.9))
OUT = make_lane("out_2", (0.0, 0.9), (11.6, -15.9))


def turning_within(lanes: list[Lane], length: float) -> float:
    """Greatest change of direction (rad) of the line along `lanes` within a `length` (m)."""
    line, _ = path_line(lanes, [], {one.id: one for one in lanes})
    directions = [line.at(s)[2] for s in np.arange(0.0, line.end, 0.5)]
    step = int(length / 0.5)
    return max(abs(math.remainder(b - a, math.tau)) for a, b in zip(directions, directions[step:], strict=False))


def test_a_curve_takes_the_place_of_lanes_that_lead_aside_and_backwards() -> None:
    lanes = [IN, ACROSS, SHORT_LANE, BACK, OUT]
    curve = curve_over(lanes, 1)
    assert curve is not None
    assert curve.after == 4
    assert curve.points[-1] == curve.rest[0]
    assert zigzag([*IN.points, *curve.points, *curve.rest[1:]]) < SMOOTH
    assert turning_within(lanes, 3.0) < 0.2
    line, ends = path_line(lanes, [], {one.id: one for one in lanes})
    assert list(ends) == sorted(ends)
    assert line.at(ends[0])[:2] == pytest.approx(IN.points[-1])
    assert line.at(ends[-1])[:2] == pytest.approx(OUT.points[-1])
    assert 4.0 < ends[3] - ends[0] < 14.0
    # Vehicles stop beside SUMO's lines: up to 3 m past one, they counted as past the signal (The Hague).
    for lane, begin, end in zip(lanes[1:4], ends, ends[1:4], strict=False):
        assert line.place(*lane.points[-1], begin, math.inf)[0] == pytest.approx(end, abs=0.05)


def test_lanes_that_a_vehicle_can_follow_are_kept() -> None:
    ways = [(-50.0, 0.0), (0.0, 0.0), (6.0, -0.5), (6.2, -0.5), (12.0, -1.0), (60.0, -1.0)]
    names = ["in_0", ":a_0_0", "short_0", ":b_0_0", "out_0"]
    lanes = [make_lane(name, *pair) for name, *pair in zip(names, ways, ways[1:], strict=False)]
    assert curve_over(lanes, 1) is None
    # Without a short lane it is a change of lane inside one junction, of which `path_line` takes care.
    assert curve_over([IN, ACROSS, BACK, OUT], 1) is None


def test_a_mini_roundabout_is_kept() -> None:
    """Of Brussels (junctions 4992104350 and 4945754181): the curve led over its island."""
    lanes = [
        make_lane("in_0", (20.0, 14.4), (6.8, 7.6)),
        make_lane(":a_0_0", (6.8, 7.6), (5.0, 6.2), (3.5, 5.3), (2.2, 4.8), (1.2, 4.7)),
        make_lane("short_0", (1.2, 4.7), (1.0, 4.7)),
        make_lane(":b_1_0", (1.0, 4.7), (-0.6, 4.7), (-2.3, 4.2), (-3.8, 3.3), (-5.3, 1.9)),
        make_lane("ring_0", (-5.3, 1.9), (-6.2, 1.0)),
        make_lane(":c_0_0", (-6.2, 1.0), (-7.0, -0.5), (-7.2, -2.0), (-7.0, -4.0), (-7.5, -6.0)),
        make_lane("out_0", (-7.5, -6.0), (-12.0, -18.0)),
    ]
    assert all(curve_over(lanes, k) is None for k in range(len(lanes)))


def test_a_path_may_begin_or_end_on_a_short_lane() -> None:
    assert curve_over([SHORT_LANE, BACK, OUT], 0) is None
    assert curve_over([IN, ACROSS, SHORT_LANE], 1) is None
    assert is_short(SHORT_LANE)
    assert not is_short(ACROSS)
    assert not is_short(OUT)


def test_zigzag_is_what_a_line_turns_to_both_sides() -> None:
    assert zigzag([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) == pytest.approx(0.0)
    assert zigzag([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.0, 1.0)]) == pytest.approx(math.pi)


def test_a_curve_is_the_same_wherever_on_a_path_its_lanes_are() -> None:
    before = make_lane("far_0", (-40.0, 60.0), (-30.0, 42.0))
    inside = make_lane(":c_0_0", (-30.0, 42.0), (-23.4, 33.8))
    short, long = (
        curve_over([IN, ACROSS, SHORT_LANE, BACK, OUT], 1),
        [before, inside, IN, ACROSS, SHORT_LANE, BACK, OUT],
    )
    found = curve_over(long, 3)
    assert short is not None
    assert found == short._replace(after=short.after + 2)
