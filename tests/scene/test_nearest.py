"""The nearest of many points, against all distances."""

import numpy as np

from slrl_sumo.scene.nearest import PointIndex


def test_as_by_all_distances() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-50.0, 50.0, (2, 400))
    places = rng.uniform(-80.0, 80.0, (2, 60))
    rows, distance = PointIndex(x, y).nearest(*places, 7)
    apart = np.hypot(places[0][:, None] - x, places[1][:, None] - y)
    expected = np.argsort(apart, axis=1)[:, :7]
    assert (rows == expected).all()
    assert np.allclose(distance, np.take_along_axis(apart, expected, axis=1), atol=1e-12)


def test_of_points_at_one_distance_those_of_the_lowest_index() -> None:
    x, y = np.array([1.0, 0.0, -1.0, 0.0, 3.0]), np.array([0.0, 1.0, 0.0, -1.0, 0.0])
    index = PointIndex(x, y)
    assert index.nearest(np.zeros(1), np.zeros(1), 3)[0].tolist() == [[0, 1, 2]]
    assert index.nearest(np.zeros(1), np.zeros(1), 5)[0].tolist() == [[0, 1, 2, 3, 4]]


def test_no_points() -> None:
    rows, distance = PointIndex(np.zeros(0), np.zeros(0)).nearest(np.zeros(2), np.zeros(2), 0)
    assert rows.shape == distance.shape == (2, 0)


def test_points_farther_away_are_left_out() -> None:
    index = PointIndex(np.array([0.0, 3.0, 1.0]), np.array([0.0, 0.0, 5.0]))
    rows, distance = index.nearest(np.array([1.0, 40.0]), np.zeros(2), 3, within=2.5)
    assert rows.tolist() == [[0, 1, -1], [-1, -1, -1]]
    assert distance.tolist() == [[1.0, 2.0, np.inf], [np.inf] * 3]
