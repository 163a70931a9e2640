"""The busiest corridor and positions along it, in hand-made traffic."""

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.metrics.traffic.corridor import along, busiest

Ways = list[tuple[np.ndarray, np.ndarray, float]]


def traffic(ways: Ways, kinds: list[int] | None = None) -> Trajectories:
    return make_recording(*ways, type=kinds or 0, length=4.0, width=2.0)


EAST = np.arange(1.0, 100.0, 4.0)
NORTH = np.arange(1.0, 180.0, 6.0)


def test_the_busiest_way_is_that_with_the_most_metres_not_the_longest() -> None:
    t = traffic([(EAST, 0 * EAST + y, 0.0) for y in (1.0, 2.0, 3.0)] + [(0 * NORTH + 50.0, NORTH, np.pi / 2)])
    corridor = busiest(t)
    assert corridor is not None
    assert len(corridor.points) == 96
    assert np.abs(corridor.direction).max() < 1e-9
    place = along(corridor, t)
    assert place[: len(EAST)] == pytest.approx(EAST - 1.0)
    # A road user that crosses is not on it, although it is there for a moment.
    assert np.isnan(place[3 * len(EAST) :]).all()


def test_road_users_beside_before_or_against_it_are_not_on_it() -> None:
    t = traffic([(EAST, 0 * EAST, 0.0), (EAST, 0 * EAST + 1, 0.0)])
    corridor = busiest(t)
    assert corridor is not None
    here = np.array([50.4])
    others = traffic([(here, np.array([y]), heading) for y, heading in ((3.0, 0.1), (6.0, 0.0), (0.0, np.pi))])
    place = along(corridor, others)
    assert place[0] == pytest.approx(49.4)
    assert np.isnan(place[1:]).all()
    outside = traffic([(np.array([-2.0]), np.array([0.0]), 0.0), (np.array([103.0]), np.array([0.0]), 0.0)])
    assert np.isnan(along(corridor, outside)).all()


def test_a_way_round_a_bend_is_measured_along_it() -> None:
    angle = np.linspace(-np.pi / 2, 0.0, 40)
    t = traffic([(30 * np.cos(angle), 30 + 30 * np.sin(angle), 0.0)])
    corridor = busiest(t)
    assert corridor is not None
    assert len(corridor.points) == pytest.approx(15 * np.pi, abs=1.0)
    half = traffic([(np.array([30 * np.cos(np.pi / 4)]), np.array([30 - 30 * np.sin(np.pi / 4)]), np.pi / 4)])
    assert along(corridor, half)[0] == pytest.approx(7.5 * np.pi, abs=0.3)


def test_pedestrians_have_ways_where_there_are_no_vehicles() -> None:
    walk = (EAST, 0 * EAST, 0.0)
    ride = (NORTH * 0 + 5, NORTH, np.pi / 2)
    alone, both = busiest(traffic([walk], [2])), busiest(traffic([walk, walk, walk, ride], [2, 2, 2, 0]))
    assert alone is not None
    assert both is not None
    assert np.ptp(alone.points[:, 0]) > 90
    assert np.ptp(both.points[:, 1]) > 90


def test_where_no_road_user_goes_far_there_is_no_corridor() -> None:
    still = np.zeros(5)
    assert busiest(traffic([(still, still, 0.0)])) is None
    assert busiest(make_recording()) is None
