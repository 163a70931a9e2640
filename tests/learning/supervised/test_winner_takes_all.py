"""Modes that compete for whole paths, and models that read the last 2 s."""

import numpy as np
import pytest
import torch
from builders import make_bundle, make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.learning.supervised.fit import fit
from slrl_sumo.learning.supervised.network_training import HEADING, rolled
from slrl_sumo.learning.supervised.windows import mirrored, windows
from slrl_sumo.learning.supervised.winner_takes_all import mode_errors, prior_rows, responsibilities
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.features import PAST_SPEED, PAST_YAW_RATE, STATES, YAW_RATE
from slrl_sumo.studies.prediction.predictors import held_mode
from slrl_sumo.studies.prediction.rollout import STEPS, cast_of, rollout


@pytest.fixture(scope="module")
def walkers() -> Trajectories:
    """Pedestrians far from each other that go straight for 4 s, then turn left, right or not, or stop."""
    random = np.random.default_rng(4)
    tracks = []
    for k in range(24):
        turn = np.repeat([0.0, (-0.15, 0.0, 0.15)[k % 3]], [10, 30])
        speed = random.uniform(1.0, 1.6) * np.repeat([1.0, 0.0 if k % 4 == 0 else 1.0], [15, 25])
        heading = np.cumsum(turn)
        z = 50.0 * k + np.cumsum(0.4 * speed * np.exp(1j * (heading - 0.5 * turn)))
        tracks.append((z.real, z.imag, np.angle(np.exp(1j * heading))))
    return make_recording(*tracks, type=2)


@pytest.fixture(scope="module")
def learned(walkers: Trajectories) -> ModelBundle:
    return fit([walkers], name="paths", seed=1, epochs=6)


def test_windows_have_the_past_and_mirror_it(walkers: Trajectories) -> None:
    every = windows([walkers], 1, "history", STEPS)
    assert every.vector.shape[1] == len(STATES["history"])
    assert every.path.shape[1:] == (STEPS, 2)
    turning = every.take((every.track == 2) & (every.frame == 14))  # it turns left since frame 10
    names = dict(zip(STATES["history"], turning.vector[0].tolist(), strict=True))
    assert [names[f"yaw_rate_{k}"] for k in (1, 2, 3, 4)] == pytest.approx([0.375] * 4, abs=1e-5)
    other = mirrored(turning).vector
    np.testing.assert_allclose(other[:, [YAW_RATE, PAST_YAW_RATE]], -turning.vector[:, [YAW_RATE, PAST_YAW_RATE]])
    np.testing.assert_allclose(other[:, PAST_SPEED], turning.vector[:, PAST_SPEED])


def test_training_rolls_out_as_a_rollout_does() -> None:
    """Alone, a road user has the same path in training, where torch moves its past, and on a recording."""
    trained = make_bundle("history")
    trained.displacement.networks.scale[:, HEADING] = 0.0  # as `fit` has it: in training the heading stays
    heading = 0.05 * np.arange(40)
    z = np.cumsum(0.6 * np.exp(1j * (heading - 0.025)))
    made = make_recording((z.real, z.imag, np.angle(np.exp(1j * heading))), type=2)
    every = windows([made], 1, "history", STEPS)
    row = int(np.flatnonzero(every.frame == 8)[0])
    vector = torch.from_numpy(every.vector[row : row + 1])[:, None]
    path = rolled(trained.displacement, vector, torch.tensor([2]), torch.tensor([5]), STEPS)[0][0, 0]
    error = rollout(made, cast_of(made, np.array([8])), held_mode(trained, everywhere_road(made.x, made.y), 5)).error
    np.testing.assert_allclose((path - torch.from_numpy(every.path[row])).norm(dim=-1).numpy(), error[0], atol=1e-3)


def test_each_mode_learns_what_it_predicts_best(walkers: Trajectories, learned: ModelBundle) -> None:
    record = learned.training
    assert (record["modes_by"], learned.config.preset) == ("paths", "history")
    every = windows([walkers], 1, "history", STEPS)
    mode = mode_errors(learned.displacement, every, STEPS).argmin(-1)
    assert len(np.unique(mode)) > 5
    clusters = fit([walkers], name="clusters", seed=1, epochs=6, modes="relative", preset="paper")

    def best(bundle: ModelBundle) -> float:
        seen = windows([walkers], 1, bundle.config.preset, STEPS)
        kind = torch.full((20,), 2)
        path = rolled(
            bundle.displacement, torch.from_numpy(seen.vector).expand(20, -1, -1), kind, torch.arange(20), STEPS
        )[0]
        return float((path - torch.from_numpy(seen.path).float()).norm(dim=-1).mean(-1).amin(0).mean())

    with torch.inference_mode():
        assert best(learned) < best(clusters)


def test_modes_differ_in_biases_and_the_last_layer_only(learned: ModelBundle) -> None:
    *shared, last = learned.displacement.networks.weight
    for weight in shared:
        torch.testing.assert_close(weight[2], weight[2, :1].expand_as(weight[2]))
    assert float(last[2].std(0).max()) > 0.01
    assert float(learned.displacement.networks.bias[0][2].std(0).max()) > 0.001


def test_fast_road_users_need_not_slow_down(walkers: Trajectories, learned: ModelBundle) -> None:
    """A jogger is in less than 1 % of the moments; the models reach its speed, and the card says so."""
    jogger = make_recording((1.0 * np.arange(26), np.zeros(26), np.zeros(26)), type=2)
    bundle = fit([*[walkers] * 3, jogger], name="jogger", seed=1, epochs=1)
    clusters = fit([*[walkers] * 3, jogger], name="jogger", seed=1, epochs=1, modes="relative", preset="paper")
    assert clusters.max_speed[2] < 1.7  # as the walkers
    assert bundle.max_speed[2] == pytest.approx(2.5, abs=0.01)
    assert "99.9th percentile" in bundle.card
    assert "99.9th percentile" not in clusters.card


def test_modes_that_predict_a_path_nearly_as_well_share_it() -> None:
    errors = np.array([[1.0, 1.0, 3.0], [3.0, 5.0, 3.0], [0.5, 0.1, 0.1]])
    found = responsibilities(errors, np.array([0, 0, 2]))
    likely = np.exp([0.0, 0.0, -1.0])  # in units of 2 m, the mean of the best of the first two
    assert found[0] == pytest.approx(likely / likely.sum())
    assert found[1] == pytest.approx(np.exp([0.0, -1.0, 0.0]) / (2.0 + np.exp(-1.0)))
    assert found[2] == pytest.approx(np.exp([-4.0, 0.0, 0.0]) / (2.0 + np.exp(-4.0)))


def test_the_prior_has_enough_steps_for_few_windows_and_a_bound_for_many() -> None:
    assert prior_rows(30_000) == 32  # 117 steps of 8 blocks
    assert prior_rows(96_000) == 100
    assert prior_rows(1_000_000) == 576
    assert prior_rows(10) == 32


def test_the_prior_tells_those_that_stand_from_those_that_walk(walkers: Trajectories, learned: ModelBundle) -> None:
    """Its probabilities let the central path stand where road users stand, after the few epochs of this fit."""
    every = windows([walkers], 1, "history", STEPS)
    stands = every.take((every.vector[:, 0] < 0.01) & (every.frame > 20))
    goes = every.take((every.vector[:, 0] > 1.0) & (every.frame > 20))
    far = []
    with torch.inference_mode():
        for some in (stands, goes):
            vector, kind = torch.from_numpy(some.vector), torch.full((20,), 2)
            path = rolled(learned.displacement, vector.expand(20, -1, -1), kind, torch.arange(20), STEPS)[0]
            likely = torch.softmax(learned.prior.logits(vector, kind[:1].expand(len(some))), -1)
            far.append(float((likely.T * path[:, :, -1].norm(dim=-1)).sum(0).mean()))
    assert far[0] < 0.5 < 4.0 < far[1]


def test_paths_do_not_depend_on_company(learned: ModelBundle) -> None:
    # What a few recordings tell of company holds there only.
    names = STATES["history"]
    company = [k for k, name in enumerate(names) if name.startswith(("vru_", "other_", "near_"))]
    own = [k for k, name in enumerate(names) if name.startswith(("speed", "yaw_rate"))]
    for networks in (learned.prior.networks, learned.displacement.networks):
        assert (networks.scale[2, company] == 0.0).all()
        assert (networks.scale[2, own] > 0.0).all()


def test_a_bundle_that_reads_the_past_is_saved_and_read(
    learned: ModelBundle, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("bundle") / "paths"
    learned.save(folder)
    again = load_bundle(folder)
    assert again.config == learned.config
    assert again.config.features == STATES["history"]
    vector, kind = torch.rand(7, len(STATES["history"])), torch.full((7,), 2)
    torch.testing.assert_close(again.prior.logits(vector, kind), learned.prior.logits(vector, kind))
    assert "6.4 s" in again.card
