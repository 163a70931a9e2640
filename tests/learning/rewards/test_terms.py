"""Each term of the reward, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.learning.rewards import terms as rewards
from slrl_sumo.learning.rewards.terms import TERMS, RewardWeights, weighted
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CAR, BICYCLE, PEDESTRIAN = RoadUserType


def _at(x: list[float]) -> WorldState:
    return make_world(x, type=PEDESTRIAN)


def test_close_counts_all_within_a_metre_but_only_for_the_learned() -> None:
    np.testing.assert_array_equal(rewards.close(_at([0.0, 0.9, 1.8, 5.0]), 3), [-1, -2, -1])
    np.testing.assert_array_equal(rewards.close(_at([0.0, 1.0]), 1), [0])


def test_cars_belong_on_roads_and_others_dislike_them_slightly() -> None:
    kinds = np.repeat(np.array([CAR, BICYCLE, PEDESTRIAN], np.int8), len(Surface))
    table = rewards.off_surface(kinds, np.tile(np.array(list(Surface), np.uint8), 3)).reshape(3, -1)
    expected = {
        Surface.NONE: (-1, -1, -1),
        Surface.ROAD: (0, -0.1, -0.1),
        Surface.SIDEWALK: (-1, 0, 0),
        Surface.CROSSING: (0, 0, 0),
        Surface.CYCLEWAY: (-1, 0, 0),
    }
    for surface, values in expected.items():
        np.testing.assert_allclose(table[:, surface], values)


def test_speed_terms() -> None:
    speed = np.array([0.0, 0.5, 3.0, 6.0, 12.0, 30.0])
    np.testing.assert_array_equal(rewards.moving(speed), [0, 0, 1, 1, 1, 1])
    np.testing.assert_allclose(rewards.speed_kept(speed, np.full(6, 6.0)), [-1, -11 / 12, -0.5, 0, -1, -1])


def test_against_the_lane_counts_only_on_a_lane_and_beyond_a_right_angle() -> None:
    heading = np.array([np.pi, np.pi, 1.5, 1.7])
    on_lane = np.array([True, False, True, True])
    np.testing.assert_array_equal(rewards.wrong_way(heading, np.zeros(4), on_lane), [-1, 0, 0, -1])


def test_comfort_feels_acceleration_along_and_across() -> None:
    felt = rewards.comfort(np.array([5.0, 5.0, 5.0, 0.0]), np.array([0.0, -1.5, 0.0, 9.0]), np.array([0, 0, 0.3, 0]))
    np.testing.assert_allclose(felt, [0, -0.25, -0.25, -1])


def test_realism_is_the_log_probability_as_a_share_of_the_rarest() -> None:
    np.testing.assert_allclose(rewards.realism(np.array([0.0, -2.0, -8.0, -30.0])), [0, -0.25, -1, -1])


def _cars(x: list[float], speed: list[float], heading: list[float]) -> WorldState:
    n = len(x)
    return replace(
        _at(x),
        type=np.full(n, CAR, np.int8),
        speed=np.array(speed),
        heading=np.array(heading),
        length=np.full(n, 5.0),
        width=np.full(n, 1.8),
    )


def test_danger_grows_with_nearness_and_belongs_to_the_one_that_drives_into_others() -> None:
    # Gaps of 3, 8 and 25 m to a standing car, at 10 m/s: within 0.5 m of it after 0.25, 0.75 and 2.45 s.
    for gap, expected in ((3.0, -1.0), (8.0, -5 / 6), (25.0, 0.0)):
        world = _cars([0.0, 5.0 + gap], [10.0, 0.0], [0.0, 0.0])
        np.testing.assert_allclose(rewards.danger(world, 2), [expected, 0.0])
    # The one behind has to brake; driving away or past is no danger.
    np.testing.assert_allclose(rewards.danger(_cars([0.0, 8.0], [10.0, 5.0], [0.0, 0.0]), 2)[1], 0.0)
    assert rewards.danger(_cars([0.0, 8.0], [10.0, 5.0], [0.0, 0.0]), 2)[0] < 0.0
    np.testing.assert_allclose(rewards.danger(_cars([0.0, 8.0], [5.0, 10.0], [0.0, 0.0]), 2), 0.0)
    beside = replace(_cars([0.0, 8.0], [10.0, 0.0], [0.0, 0.0]), y=np.array([0.0, 3.0]))
    np.testing.assert_allclose(rewards.danger(beside, 2), 0.0)
    # Two that meet head-on are both in danger; only the first is asked for.
    np.testing.assert_array_less(rewards.danger(_cars([0.0, 15.0], [5.0, 5.0], [0.0, np.pi]), 2), 0.0)
    assert len(rewards.danger(_cars([0.0, 15.0], [5.0, 5.0], [0.0, np.pi]), 1)) == 1


def test_progress_is_the_share_of_the_way_that_was_to_be_covered() -> None:
    covered = np.array([4.0, 2.0, 0.0, -2.0, -9.0, 8.0])
    np.testing.assert_allclose(
        rewards.progress(covered, np.full(6, 4.0), np.ones(6, np.bool_)), [1.0, 0.5, 0.0, -0.5, -1.0, 1.0]
    )
    # Standing where required is worth as much as driving, wherever on the path; without a route there is none.
    np.testing.assert_array_equal(
        rewards.progress(np.array([0.0, -0.3, 0.0]), np.array([0.0, 0.19, 0.0]), np.array([True, True, False])),
        [1.0, 1.0, 0.0],
    )
    np.testing.assert_allclose(rewards.progress(np.array([0.1]), np.array([0.2]), np.array([True])), [0.5])


def test_excess_is_what_was_covered_beyond_the_wanted_distance() -> None:
    covered = np.array([4.0, 2.0, -1.0, 5.0, 8.0, 20.0])
    np.testing.assert_allclose(
        rewards.excess(covered, np.full(6, 4.0), np.ones(6, np.bool_)), [0.0, 0.0, 0.0, -0.25, -1.0, -1.0]
    )
    # To go where standing is right costs as much per metre as where 1 m is wanted; without a route nothing does.
    known = np.array([True, True, True, False])
    np.testing.assert_allclose(
        rewards.excess(np.array([0.2, 0.7, 4.0, 4.0]), np.zeros(4), known), [0.0, -0.5, -1.0, 0.0]
    )


def test_a_path_has_a_quarter_of_a_metre_of_room_on_both_sides() -> None:
    aside = np.array([0.0, 0.25, -0.25, 0.5, -0.5, 0.75, 7.0])
    np.testing.assert_allclose(rewards.off_path(aside, np.ones(7, np.bool_)), [0, 0, 0, -0.5, -0.5, -1, -1])
    np.testing.assert_array_equal(rewards.off_path(aside, np.zeros(7, np.bool_)), np.zeros(7))


def test_only_crossing_a_closed_line_is_passing_it() -> None:
    # The last one was beyond it already: its path begins a little behind it.
    before = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.5])
    after = np.array([3.0, 3.0, 3.0, 3.0, 3.0, 0.0, 3.0])
    line = np.array([2.0, 2.0, 4.0, -0.2, np.inf, 0.1, 2.0])
    closed = np.array([True, False, True, True, True, True, True])
    np.testing.assert_array_equal(rewards.passed(before, after, line, closed), [-1, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("name", TERMS)
def test_every_term_counts_by_its_weight_and_zero_switches_it_off(name: str) -> None:
    assert {"progress", "off_path", "red", "priority"} <= set(TERMS)
    terms = {term: np.array([float(k), 1.0]) for k, term in enumerate(TERMS)}
    off = replace(RewardWeights(**dict.fromkeys(TERMS, 0.0)), **{name: 3.0})
    np.testing.assert_allclose(weighted(terms, off), [3.0 * TERMS.index(name), 3.0])


def test_an_arrival_counts_where_there_are_trips() -> None:
    np.testing.assert_array_equal(rewards.arrival(np.array([True, False]), 2), [1.0, 0.0])
    np.testing.assert_array_equal(rewards.arrival(None, 2), [0.0, 0.0])
