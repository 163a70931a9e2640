"""One prediction out of many."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_bundle, make_recording

from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.studies.prediction.central_path import central_path
from slrl_sumo.studies.prediction.predictors import PriorRanked
from slrl_sumo.studies.prediction.rollout import STEPS, cast_of, rollout
from slrl_sumo.studies.prediction.rollout_realism import recorded
from slrl_sumo.studies.prediction.selector_rollouts import SAMPLES, selector_rollouts


def test_the_central_path_is_nearest_to_all_samples() -> None:
    random = np.random.default_rng(2)
    paths, weight = random.normal(0.0, 3.0, (9, 4, 5, 2)), random.random((9, 4))
    found = central_path(paths, weight)

    def expected(centre: np.ndarray) -> np.ndarray:
        return (np.hypot(*(paths - centre).transpose(3, 0, 1, 2)) * weight[:, :, None]).sum(0)

    assert (expected(found) <= expected((paths * weight[:, :, None, None]).sum(0) / weight.sum(0)[:, None, None])).all()
    for angle in np.arange(8) * np.pi / 4:
        assert (expected(found) <= expected(found + 0.05 * np.array([np.cos(angle), np.sin(angle)])) + 1e-4).all()


def test_one_sample_far_away_does_not_draw_the_median() -> None:
    paths = np.zeros((5, 1, 1, 2))
    paths[4] = 100.0
    assert central_path(paths, np.ones((5, 1))) == pytest.approx(0.0, abs=0.01)


def test_whole_paths_are_predicted_by_their_central_one() -> None:
    """Also of road users that enter later; other bundles choose anew at each step."""
    bundle = make_bundle()
    made = make_recording(
        (0.5 * np.arange(40), 0.0, 0.0), (4.0, 0.4 * np.arange(30), np.pi / 2), first=[0, 6], type=[2, 1]
    )
    ground, starts = everywhere_road(made.x, made.y), np.array([5, 12])
    cast = cast_of(made, starts)
    found = {
        by: selector_rollouts(
            recorded(made), cast, starts, "prior", replace(bundle, training={"modes_by": by}), ground, 1
        )
        for by in ("relative", "paths")
    }
    assert found["relative"].best_mean == pytest.approx(found["paths"].best_mean)
    samples, weights = [], []
    for rank in range(SAMPLES):
        move = PriorRanked(bundle, ground, np.full(len(cast), rank))
        samples.append(rollout(made, cast, move).path[..., :2])
        weights.append(move.probability)
    assert np.sum(weights, 0) == pytest.approx(1.0)
    middle = central_path(np.stack(samples), np.stack(weights))
    assert (cast.enters > 0).any()
    for user in range(len(cast)):
        ahead = np.arange(cast.enters[user] + 1, cast.leaves[user] + 1)
        row = cast.row[user] + ahead
        error = np.hypot(middle[user, ahead, 0] - made.x[row], middle[user, ahead, 1] - made.y[row])
        assert found["paths"].error[user, : len(ahead)] == pytest.approx(error, abs=1e-2)
        assert (found["paths"].error[user, len(ahead) :] == 0.0).all()
    whole = found["paths"].steps == STEPS
    assert np.abs(found["paths"].error - found["relative"].error)[whole].max() > 0.1
