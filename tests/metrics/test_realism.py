"""The realism score, on traffic with known answers and on cheats."""

from collections.abc import Sequence

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import Ribbon, Surface, SurfaceShapes
from slrl_sumo.metrics.realism import DISTRIBUTION_SMOOTHING, WINDOW, mean_realism, realism, window_scores

ROAD = SurfaceShapes((Ribbon(Surface.ROAD, np.array([[-50.0, 0.0], [250.0, 0.0]]), 8.0),))
"""8 m wide along x."""


def cars(places: Sequence[tuple[float, float, float]], frames: int = 20) -> Trajectories:
    """Cars of 4 by 2 m that start at x, y and drive along x at a speed."""
    ways = [(x + 0.4 * speed * np.arange(frames), y, 0.0) for x, y, speed in places]
    return make_recording(*ways, length=4.0, width=2.0)


def test_a_window_is_as_likely_as_its_moments_among_all_simulated_ones() -> None:
    # The first road user goes at 1.1 m/s; half of its samples do, the other half at 3.1. The second one is as recorded.
    recorded = np.array([[1.1] * WINDOW, [2.1] * WINDOW])
    simulated = np.array([[[1.1] * WINDOW, [2.1] * WINDOW], [[3.1] * WINDOW, [2.1] * WINDOW]])
    floor = DISTRIBUTION_SMOOTHING / 50
    found = window_scores({"speed": recorded}, {"speed": simulated})["speed"]
    assert found == pytest.approx(
        [((1 - DISTRIBUTION_SMOOTHING) / 2 + floor) / (1 - DISTRIBUTION_SMOOTHING + floor), 1.0]
    )
    # Of an event it counts in how many samples it happens at any moment.
    event, never = np.zeros((1, WINDOW)), np.zeros((4, 1, WINDOW))
    never[0, 0, 3] = 1.0
    found = window_scores({"overlap": event}, {"overlap": never})["overlap"]
    assert found == pytest.approx([((1 - DISTRIBUTION_SMOOTHING) * 0.75 + 0.05) / (1 - DISTRIBUTION_SMOOTHING + 0.05)])


def test_more_samples_of_the_same_prediction_change_nothing() -> None:
    random = np.random.default_rng(1)
    recorded, one = random.uniform(0, 3, (5, WINDOW)), random.uniform(0, 3, (1, 5, WINDOW))
    few, many = (window_scores({"speed": recorded}, {"speed": np.repeat(one, n, 0)})["speed"] for n in (1, 20))
    assert few == pytest.approx(many)
    assert (few < 1.0).all()


def test_groups_and_the_score_are_means_of_geometric_means() -> None:
    found = mean_realism({"speed": np.array([0.2, 0.4]), "standing": np.array([1.0, 1.0]), "ttc": np.array([0.5, 0.5])})
    assert found.windows == 2
    assert found.features == pytest.approx({"speed": 0.3, "standing": 1.0, "ttc": 0.5})
    assert found.groups == pytest.approx({"kinematic": (0.2**0.5 + 0.4**0.5) / 2, "interactive": 0.5})
    assert found.score == pytest.approx(((0.2 * 0.5) ** (1 / 3) + (0.4 * 0.5) ** (1 / 3)) / 2)


def test_the_same_traffic_is_wholly_realistic() -> None:
    t = cars([(0, 0, 8), (20, 0, 3)])
    found = realism(simulated=t, reference=t, shapes=ROAD)
    assert list(found) == ["car"]
    assert found["car"].score == pytest.approx(1.0)
    assert found["car"].groups == pytest.approx({"kinematic": 1.0, "interactive": 1.0, "map": 1.0})
    assert "map" not in realism(simulated=t, reference=t)["car"].groups


def test_traffic_is_compared_in_alike_situations() -> None:
    # Half of the cars stand. Where all stand, the mean speed of cars that begin to move is wrong, not that of all.
    t = cars([(0, 0, 5), (100, 0, 0), (0, 30, 5), (100, 30, 0)])
    slow = cars([(0, 0, 0), (100, 0, 0), (0, 30, 0), (100, 30, 0)])
    swapped = cars([(0, 0, 0), (100, 0, 5), (0, 30, 0), (100, 30, 5)])
    assert realism(simulated=swapped, reference=t)["car"].features["speed"] == pytest.approx(1.0)
    stands = realism(simulated=slow, reference=t)["car"]
    assert stands.features["standing"] < 0.6
    assert stands.score < 0.75


def test_overlaps_that_were_not_recorded_lower_the_interactive_score() -> None:
    reference = cars([(0, 0, 5), (20, 0, 5), (60, 0, 5), (80, 0, 5)])
    simulated = cars([(0, 0, 5), (20, 0, 5), (60, 0, 5), (61, 0, 5)])
    found = realism(simulated=simulated, reference=reference)["car"]
    assert found.features["overlap"] < 0.8
    assert found.features["speed"] == pytest.approx(1.0)


def test_off_surface_lowers_the_map_score_only() -> None:
    inside, outside = cars([(0, 0, 5)]), cars([(0, 12, 5)])
    found = realism(simulated=outside, reference=inside, shapes=ROAD)["car"]
    assert found.features["off_surface"] < 0.06
    assert found.groups["kinematic"] == pytest.approx(1.0)
    assert found.groups["interactive"] == pytest.approx(1.0)
    assert found.score < 0.8


def test_road_users_that_do_not_count_are_still_seen() -> None:
    t = cars([(0, 0, 8), (20, 0, 3)])
    apart = realism(simulated=t, reference=t, tracks=np.array([True, False]), reference_tracks=np.array([False, True]))
    assert apart["car"].features["speed"] < 0.1
    assert apart["car"].features["ttc"] == pytest.approx(1.0)


def test_short_tracks_have_no_score() -> None:
    t = cars([(0, 0, 8), (20, 0, 3)], frames=WINDOW + 1)
    assert realism(simulated=t, reference=t) == {}
