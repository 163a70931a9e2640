"""Points along lanes."""

import libsumo
import numpy as np
import pytest

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.sumo.network.lanes import Lane, LanePoints
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def lane(name: str, points: list[tuple[float, float]], length: float | None = None, width: float = 3.2) -> Lane:
    shape = np.array(points, np.float64)
    drawn = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    return Lane(
        id=name,
        edge=name,
        shape=shape,
        width=width,
        length=drawn if length is None else length,
        max_speed=13.9,
        allowed=frozenset({"passenger"}),
        internal=False,
        surface=Surface.ROAD,
    )


def test_points_lie_evenly_on_the_centre_line_and_away_from_its_ends() -> None:
    points = LanePoints([lane("east", [(0, 0), (10, 0)])], spacing=2.0)
    assert points.x.tolist() == pytest.approx([1, 3, 5, 7, 9])
    assert points.y.tolist() == [0] * 5
    assert points.heading.tolist() == [0] * 5
    assert points.offset.tolist() == pytest.approx([1, 3, 5, 7, 9])
    assert points.lane.tolist() == [0] * 5


def test_a_bend_turns_the_heading_and_the_offset_goes_on() -> None:
    points = LanePoints([lane("bend", [(0, 0), (6, 0), (6, 6)])], spacing=4.0)
    assert np.column_stack([points.x, points.y]).tolist() == pytest.approx(np.array([(2, 0), (6, 0), (6, 4)]))
    assert points.heading[[0, 2]].tolist() == pytest.approx([0.0, np.pi / 2])
    assert points.offset.tolist() == pytest.approx([2, 6, 10])


def test_offsets_are_in_sumos_measure_where_the_drawing_has_another_length() -> None:
    points = LanePoints([lane("drawn short", [(0, 0), (10, 0)], length=20.0)], spacing=5.0)
    assert points.x.tolist() == pytest.approx([2.5, 7.5])
    assert points.offset.tolist() == pytest.approx([5, 15])


def test_a_short_lane_has_its_middle_and_one_without_extent_has_nothing() -> None:
    points = LanePoints([lane("dot", [(5, 5), (5, 5)]), lane("short", [(0, 0), (1, 0)])], spacing=4.0)
    assert len(points) == 1
    assert (points.x[0], points.y[0], points.lane[0]) == (0.5, 0.0, 1)


def test_no_lanes_are_no_points() -> None:
    points = LanePoints([], spacing=2.0)
    assert len(points) == 0
    assert points.nearest(np.zeros(3), np.zeros(3), 2).shape == (3, 0)
    assert points.lanes_under(np.zeros(3), np.zeros(3)).tolist() == [-1, -1, -1]


def test_nearest_points_come_nearest_first() -> None:
    points = LanePoints([lane("a", [(0, 0), (10, 0)]), lane("b", [(10, 8), (0, 8)])], spacing=2.0)
    rows = points.nearest(np.array([3.2, 9.0]), np.array([0.5, 7.0]), 3)
    assert rows.shape == (2, 3)
    assert np.column_stack([points.x, points.y])[rows[0]].tolist() == pytest.approx(np.array([(3, 0), (5, 0), (1, 0)]))
    assert points.lane[rows[1]].tolist() == [1, 1, 1]
    assert points.nearest(np.zeros(1), np.zeros(1), 99).shape == (1, 10)


def test_the_lane_under_a_place_is_known_up_to_its_edge() -> None:
    points = LanePoints([lane("a", [(0, 0), (50, 0)]), lane("b", [(0, 4), (50, 4)], width=2.0)], spacing=0.5)
    x = np.full(5, 25.0)
    assert points.lanes_under(x, np.array([0.0, 1.5, 3.2, 4.9, 6.0])).tolist() == [0, 0, 1, 1, -1]


def test_points_of_a_real_network_are_where_sumo_says() -> None:
    with SumoSession(find_scenario("district")) as session:
        lanes = [each for each in session.network.lanes if not each.internal]
        points = LanePoints(lanes, spacing=7.0)
        for row in range(0, len(points), 9):
            of = points.lanes[points.lane[row]]
            there = libsumo.simulation.convert2D(of.edge, points.offset[row], int(of.id.rsplit("_", 1)[1]))
            assert np.hypot(points.x[row] - there[0], points.y[row] - there[1]) < 0.15
    assert set(points.lane) == set(range(len(lanes)))
