"""Distances of distributions that can be worked out by hand."""

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.metrics.distributions import jensen_shannon_distance, kinematic_distances, kinematics

EDGES = np.array([0.0, 1.0, 2.0, 3.0])


def walker(speed: float, kind: int = 2, parked: bool = False) -> Trajectories:
    return make_recording((0.4 * speed * np.arange(10), 0.0, 0.0), type=kind, parked=np.array([parked]))


def test_distance_of_the_same_and_of_disjoint_samples() -> None:
    some = np.array([0.5, 0.5, 1.5])
    assert jensen_shannon_distance(a=some, b=np.tile(some, 7), edges=EDGES) == 0.0
    assert jensen_shannon_distance(a=some, b=np.array([2.5]), edges=EDGES) == pytest.approx(1.0)


def test_distance_of_a_half_that_moved() -> None:
    # p = (1, 0), q = (1/2, 1/2): m = (3/4, 1/4).
    expected = 0.5 * np.log2(4 / 3) + 0.5 * (0.5 * np.log2(2 / 3) + 0.5 * np.log2(2))
    found = jensen_shannon_distance(a=np.array([0.2, 0.3]), b=np.array([0.1, 1.9]), edges=EDGES)
    assert found == pytest.approx(np.sqrt(expected))


def test_values_beyond_the_edges_count_in_the_outer_bins() -> None:
    assert jensen_shannon_distance(a=np.array([-9.0, 99.0]), b=np.array([0.5, 2.5]), edges=EDGES) == 0.0


def test_nothing_has_no_distribution() -> None:
    with pytest.raises(ValueError, match="an empty sample has no distribution"):
        jensen_shannon_distance(a=np.zeros(0), b=np.ones(1), edges=EDGES)


def test_only_what_is_known_counts_and_parked_ones_do_not() -> None:
    found = kinematics(walker(1.5))
    assert [len(found[name][2]) for name in ("speed", "acceleration", "yaw_rate")] == [9, 8, 9]
    assert found["speed"][2] == pytest.approx(np.full(9, 1.5))
    assert len(found["speed"][0]) == 0
    assert len(kinematics(walker(1.5, parked=True))["speed"][2]) == 0
    assert len(kinematics(walker(1.5), np.array([False]))["speed"][2]) == 0


def test_distances_by_type() -> None:
    found = kinematic_distances(kinematics(walker(1.5)), kinematics(walker(0.5)))
    assert found["pedestrian"] == {"speed": pytest.approx(1.0), "acceleration": 0.0, "yaw_rate": 0.0}
    assert found["car"] == dict.fromkeys(("speed", "acceleration", "yaw_rate"))
