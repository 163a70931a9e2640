"""The features of realism, on scenes with known answers."""

from collections.abc import Sequence

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import Ribbon, Surface, SurfaceShapes
from slrl_sumo.metrics.realism_features import FEATURES, features, nearest_distance, shortest_ttc
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


def test_features_of_some_rows_see_all_road_users() -> None:
    t = cars([(0, 0, 8), (20, 0, 3), (20, 9, 0)], frames=5)
    whole, some = features(t, ROAD), features(t, ROAD, np.array([1, 7]))
    assert set(whole) == set(FEATURES)
    assert set(features(t)) == set(FEATURES) - {"road_edge", "off_surface"}
    for name, values in whole.items():
        assert some[name] == pytest.approx(values[[1, 7]]), name
    assert whole["standing"].tolist() == [0.0] * 10 + [1.0] * 5
