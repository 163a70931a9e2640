"""Baselines that learn paths from the last 2 s."""

import numpy as np
import pytest
from builders import make_recording

from benchmarks.prediction.baselines import BASELINES, SAMPLES
from benchmarks.prediction.measure import measured, split, worse_than_prior
from benchmarks.prediction.moments import PAST, Moments, has_past, mirrored, moments_at, usable_rows
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.studies.prediction.rollout import STEPS


@pytest.fixture(scope="module")
def circles() -> Trajectories:
    """Cyclists that go round circles of different sharpness, to the left and to the right."""
    tracks = []
    for k, turn in enumerate(np.linspace(-0.12, 0.12, 24)):
        heading = turn * np.arange(45)
        steps = 1.2 * np.exp(1j * (heading[:-1] + 0.5 * turn))
        z = np.r_[0, np.cumsum(steps)] + 1000j * k
        tracks.append((z.real, z.imag, np.angle(np.exp(1j * heading))))
    return make_recording(*tracks, type=1)


@pytest.fixture(scope="module")
def moments(circles: Trajectories) -> Moments:
    return moments_at(circles, usable_rows(circles))


def error(moments: Moments, name: str) -> float:
    paths = BASELINES[name](moments, moments, 1)
    assert paths.shape == (SAMPLES if "20" in name or "winner" in name else 1, len(moments), STEPS, 2)
    return float(np.hypot(*(paths - moments.path).transpose(3, 0, 1, 2)).mean(-1).min(0).mean())


def test_moments_have_their_past_and_future_in_the_ego_frame(circles: Trajectories, moments: Moments) -> None:
    assert len(moments) == 24 * (45 - PAST - STEPS)
    np.testing.assert_allclose(np.hypot(*(moments.path[:, 0]).T), 1.2, rtol=1e-9)
    np.testing.assert_allclose(np.hypot(*(moments.past[:, 0]).T), 1.2, rtol=1e-9)
    assert (moments.past[:, :, 0] < 0).all()
    # A turn to the left comes from the left behind and goes to the left.
    left = moments.yaw_rate > 0.01
    assert (moments.path[left, -1, 1] > 0).all()
    assert (moments.past[left, -1, 1] > 0).all()
    both = mirrored(moments)
    np.testing.assert_allclose(both.path[len(moments) :, :, 1], -moments.path[..., 1])
    assert has_past(circles, np.array([0, 4, 5, 44, 45, 50])).tolist() == [False, False, True, True, False, True]


def test_baselines_learn_circles_from_the_past(moments: Moments) -> None:
    still = error(moments, "constant velocity")
    assert error(moments, "damped turn") < 1e-6  # a share of 1 is among those tried
    assert error(moments, "ridge") < 0.3 * still
    assert error(moments, "MLP") < 0.5 * still
    assert error(moments, "20 K-Means paths") < 0.2 * still
    assert error(moments, "winner-takes-all MLP") < error(moments, "20 K-Means paths")


def test_the_package_is_measured_at_the_same_moments(circles: Trajectories, bundle: ModelBundle) -> None:
    train, test = split({"a1": circles, "a2": circles, "b1": circles}, ":b")
    assert (list(train), list(test)) == (["a1", "a2"], ["b1"])
    row = measured([circles], [circles], bundle, 1)[1]
    assert row["n"] == 24 * len(range(5, 45 - STEPS, 5))
    assert row["windows"] == 24 * (45 - PAST - STEPS)
    assert row["best of SL"] == pytest.approx(row["best of one mode held"], rel=1e-3)
    assert row["best of SL"] < row["single of SL"]
    with pytest.raises(SystemExit, match="--fold c:b"):
        split({"a1": circles, "b1": circles}, "c:b")


def test_the_gate_names_types_that_a_selector_predicts_worse() -> None:
    rows = {
        ("D2", "car"): {"single of SL": 2.0, "single of SL+RL": 2.5},
        ("D2", "pedestrian"): {"single of SL": 0.6, "single of SL+RL": 0.6},
    }
    assert worse_than_prior(rows) == ["car on D2 (2.50 instead of 2.00 m)"]
    with pytest.raises(SystemExit, match="--selector"):
        worse_than_prior({("D2", "car"): {"single of SL": 2.0}})
