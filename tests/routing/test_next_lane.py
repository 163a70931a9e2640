"""Positions along a next lane that is curved, and along the lanes that lead to it."""

import math
from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_world

from slrl_sumo.routing.lane_approaches import LaneApproaches
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.next_lane import FAR_SIGHT, NextLane, lane_positions
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

RADIUS, WIDTH = 25.0, 3.2


def _arc(radius: float, begin: float, end: float) -> Polyline:
    angles = np.linspace(begin, end, 181)
    return line_through(np.column_stack([radius * np.cos(angles), radius * np.sin(angles)]).tolist())[0]


@pytest.mark.parametrize("approaches", [(), (_arc(RADIUS, -1.5, 0.0),)])
def test_positions_follow_the_curve_of_the_lane_and_of_its_approach(approaches: tuple[Polyline, ...]) -> None:
    # Counter-clockwise on the inner lane of a ring at angle 0.4; another car ahead on the outer lane, one behind it.
    angles, radii = np.array([0.4, 1.4, -0.8]), np.array([RADIUS - WIDTH, RADIUS, RADIUS])
    begin = 0.0 if approaches else -1.5
    lane = NextLane(_arc(RADIUS, begin, 3.0), 0.0 if approaches else 37.5, approaches)
    world = make_world(radii * np.cos(angles), radii * np.sin(angles), heading=angles + 0.5 * math.pi)
    ahead, left, direction = lane_positions(lane, world, 0)
    assert ahead == pytest.approx(RADIUS * (angles - 0.4), abs=0.1)
    assert left == pytest.approx([0.0, -WIDTH, -WIDTH], abs=0.01)
    assert direction == pytest.approx(world.heading, abs=0.02)


def test_road_users_beside_no_part_of_the_lane_are_left_out() -> None:
    line = Polyline([0.0, 50.0], [WIDTH, WIDTH], [0.0, 50.0])
    world = make_world([10.0, -4.0, 56.0, 10.0 + FAR_SIGHT + 1.0, 20.0], [0.0, WIDTH, WIDTH, WIDTH, 7.0])
    ahead, left, _ = lane_positions(NextLane(line, 0.0), world, 0)
    assert left == pytest.approx([0.0, math.inf, math.inf, math.inf, 7.0])
    assert ahead[[0, 4]] == pytest.approx([0.0, 10.0])


def test_ways_that_lead_to_a_lane_of_a_ring(tmp_path: Path) -> None:
    with SumoSession(find_scenario(str(SITUATIONS["two-lane-roundabout"].build(tmp_path)))) as session:
        graph = LaneGraph(libsumo, session.network)
        lines = LaneApproaches(graph)("ring1_0")
        begin = graph.lanes["ring1_0"].points[0]
        # On the ring, and from the arm at its begin.
        assert len(lines) == 2
        for line in lines:
            assert line.at(line.end)[:2] == pytest.approx(begin, abs=0.01)
            assert line.end > FAR_SIGHT
        for line, lane in zip(lines, ("ring0_0", "in0_0"), strict=True):
            x, y = graph.lanes[lane].points[0]
            assert line.nearest(x, y)[1] == pytest.approx(0.0, abs=0.01)
        # Nothing leads to the begin of an arm.
        assert LaneApproaches(graph)("in0_0") == ()
