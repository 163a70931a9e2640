"""The realism score and its features, on scenes with known answers."""

from collections.abc import Sequence

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import Ribbon, Surface, SurfaceShapes
from slrl_sumo.metrics.realism import FEATURES, SMOOTHING, features, nearest_distance, realism, shortest_ttc
from slrl_sumo.metrics.road_edge import edge_distance

ROAD = SurfaceShapes((Ribbon(Surface.ROAD, np.array([[-50.0, 0.0], [150.0, 0.0]]), 8.0),))
"""8 m wide along x."""


def cars(places: Sequence[tuple[float, float, float]], frames: int = 12) -> Trajectories:
    """Cars of 4 by 2 m that start at x, y and drive along x at a speed."""
    ways = [(x + 0.4 * speed * np.arange(frames), y, 0.0) for x, y, speed in places]
    return make_recording(*ways, length=4.0, width=2.0)


def test_weights_are_a_whole() -> None:
    assert sum(feature.weight for feature in FEATURES.values()) == pytest.approx(1.0)


def test_distance_to_the_nearest_and_time_to_collision() -> None:
    # The first follows at 8 m/s, 20 m behind, the second at 3 m/s; the third stands beside, 9 m to the left.
    t = cars([(0, 0, 8), (20, 0, 3), (20, 9, 0)], frames=5)
    nearest = nearest_distance(t)
    assert nearest[:2] == pytest.approx([16.0, 14.0])
    # From now on the third is nearer, over the corner.
    assert nearest[4] == pytest.approx(np.hypot(18.0 - 14.8, 7.0))
    # The second's nearest: the follower, or the third, 7 m beside it as long as their boxes are side by side.
    assert nearest[5] == pytest.approx(7.0)
    assert nearest[9] == pytest.approx(np.hypot(7.0, 4.8 - 4.0))
    ttc = shortest_ttc(t)
    assert ttc[:5] == pytest.approx((16.0 - 2.0 * np.arange(5)) / 5.0)
    assert ttc[5:10] == pytest.approx(ttc[:5])
    assert ttc[10:] == pytest.approx(5.0)


def test_a_road_user_alone_has_its_nearest_far_away() -> None:
    assert nearest_distance(cars([(0, 0, 5)])) == pytest.approx(40.0)
    assert nearest_distance(cars([(0, 0, 0), (300, 0, 0)])) == pytest.approx(40.0)


def test_distance_to_the_edge_of_the_road() -> None:
    x = np.zeros(5)
    y = np.array([0.0, 3.0, 4.5, 9.0, -3.0])
    found = edge_distance(shapes=ROAD, x=x, y=y, kind=np.zeros(5, np.int8))
    assert found == pytest.approx([-4.0, -1.0, 0.5, 5.0, -1.0], abs=0.26)


def test_where_the_whole_view_is_road_or_none_of_it_the_edge_is_far() -> None:
    wide = SurfaceShapes((Ribbon(Surface.ROAD, np.array([[-500.0, 0.0], [500.0, 0.0]]), 500.0),))
    none = SurfaceShapes((Ribbon(Surface.SIDEWALK, np.array([[-500.0, 0.0], [500.0, 0.0]]), 500.0),))
    at = {"x": np.zeros(1), "y": np.zeros(1), "kind": np.zeros(1, np.int8)}
    assert edge_distance(shapes=wide, **at)[0] <= -9.0
    assert edge_distance(shapes=none, **at)[0] >= 9.0


def test_the_same_traffic_is_wholly_realistic() -> None:
    t = cars([(0, 0, 8), (20, 0, 3)])
    found = realism(simulated=t, reference=t, shapes=ROAD)
    assert list(found) == ["car"]
    assert found["car"].score == pytest.approx(1.0)
    assert found["car"].groups == pytest.approx({"kinematic": 1.0, "interactive": 1.0, "map": 1.0})
    assert "map" not in realism(simulated=t, reference=t)["car"].groups


def test_the_score_of_overlaps_is_the_likelihood_of_the_reference() -> None:
    # One pair of four cars overlaps: half of all moments, and none in the reference.
    reference = cars([(0, 0, 5), (20, 0, 5), (60, 0, 5), (80, 0, 5)])
    simulated = cars([(0, 0, 5), (20, 0, 5), (60, 0, 5), (61, 0, 5)])
    n = 4 * 12
    p = np.array([n + SMOOTHING, SMOOTHING]) / (n + 2 * SMOOTHING)
    q = np.array([n / 2 + SMOOTHING, n / 2 + SMOOTHING]) / (n + 2 * SMOOTHING)
    found = realism(simulated=simulated, reference=reference)["car"].features
    assert found["overlap"] == pytest.approx(np.exp((p * np.log(q / p)).sum()))
    assert found["speed"] == pytest.approx(1.0)
    assert found["nearest"] < 0.6


def test_off_surface_lowers_the_map_score_only() -> None:
    inside, outside = cars([(0, 0, 5)]), cars([(0, 12, 5)])
    found = realism(simulated=outside, reference=inside, shapes=ROAD)["car"]
    assert found.features["off_surface"] < 0.05
    assert found.groups["kinematic"] == pytest.approx(1.0)
    assert found.groups["interactive"] == pytest.approx(1.0)
    assert found.score < 0.7


def test_features_without_the_ground() -> None:
    assert set(features(cars([(0, 0, 5)]), None)) == set(FEATURES) - {"road_edge", "off_surface"}


def test_road_users_that_do_not_count_are_still_seen() -> None:
    t = cars([(0, 0, 8), (20, 0, 3)])
    whole, first = features(t, None), features(t, None, np.array([True, False]))
    assert len(first["ttc"][0]) == 11
    assert first["ttc"][0].tolist() == whole["ttc"][0][:11].tolist()
    apart = realism(simulated=t, reference=t, tracks=np.array([True, False]), reference_tracks=np.array([False, True]))
    assert apart["car"].features["speed"] < 0.1
    assert apart["car"].features["ttc"] == pytest.approx(1.0)
