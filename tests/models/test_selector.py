import numpy as np
import pytest
import torch

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.selector import HOLD, PriorSelector
from slrl_sumo.perception.observation import Observation


def test_same_seed_same_modes_and_another_seed_others(bundle: ModelBundle, seen: Observation) -> None:
    one, same, other = (PriorSelector(bundle, seed) for seed in (5, 5, 6))
    first = one.choose(seen)
    second = one.choose(seen)
    assert first.dtype == np.int64
    assert first.shape == (300,)
    np.testing.assert_array_equal(first, same.choose(seen))
    np.testing.assert_array_equal(second, same.choose(seen))
    assert (first != second).any()
    assert (first != other.choose(seen)).any()


def test_selector_leaves_global_random_states_alone(bundle: ModelBundle, seen: Observation) -> None:
    before = torch.get_rng_state()
    expected = PriorSelector(bundle, 5).choose(seen)
    np.random.seed(0)  # noqa: NPY002 - what others do to the global state must not matter
    torch.manual_seed(1)
    np.testing.assert_array_equal(PriorSelector(bundle, 5).choose(seen), expected)
    torch.set_rng_state(before)


def test_modes_are_drawn_as_often_as_the_prior_says(bundle: ModelBundle, seen: Observation) -> None:
    times = 40_000
    for one in range(3):
        many = Observation(np.repeat(seen.vector[one : one + 1], times, 0), None, np.repeat(seen.type[one], times))
        drawn = np.bincount(PriorSelector(bundle, 1).choose(many), minlength=20) / times
        vector, kind = tensors(many)
        probability = torch.softmax(bundle.prior.logits(vector[:1], kind[:1]), -1)[0].numpy()
        np.testing.assert_allclose(drawn, probability, atol=4 * np.sqrt(0.25 / times))


def test_a_drawn_mode_is_held_by_its_road_user_for_as_long_as_chance_says(
    bundle: ModelBundle, seen: Observation
) -> None:
    times = 4000
    ids = [f"u{i}" for i in range(times)]
    # Two modes that are equally likely: who draws anew gets the other one every second time.
    bundle.prior.networks.weight[-1].zero_()
    bundle.prior.networks.bias[-1].fill_(-100.0)
    bundle.prior.networks.bias[-1][..., [3, 8]] = 0.0
    many = Observation(np.repeat(seen.vector[:1], times, 0), None, np.repeat(seen.type[:1], times))
    selector = PriorSelector(bundle, 1)
    first = selector.choose(many, ids)
    assert set(first.tolist()) == {3, 8}
    order = np.random.default_rng(0).permutation(times)
    second = selector.choose(many, [ids[i] for i in order])  # by name, not by row
    assert np.mean(second != first[order]) == pytest.approx(0.5 / HOLD, abs=0.015)
    stranger = selector.choose(many, [f"v{i}" for i in range(times)])
    assert np.mean(stranger != second) == pytest.approx(0.5, abs=0.04)
    assert np.mean(selector.choose(many, ids) != first) == pytest.approx(0.5, abs=0.04)  # who was away is forgotten


def test_without_sampling_the_most_central_mode_is_taken(bundle: ModelBundle, seen: Observation) -> None:
    modes = PriorSelector(bundle, 1, sample=False).choose(seen, ["x"] * 300)
    vector, kind = tensors(seen)
    probability = torch.softmax(bundle.prior.logits(vector, kind).double(), -1).numpy()
    for i in range(0, 300, 7):
        centres = bundle.mode_centres[kind[i]]
        expected = [np.hypot(*(centres - centre).T) @ probability[i] for centre in centres]
        assert modes[i] == np.argmin(expected)
    assert len(set(modes.tolist())) > 3


def test_prior_reads_the_networks_of_the_type(bundle: ModelBundle, seen: Observation) -> None:
    vector, kind = tensors(seen)
    logits = bundle.prior.logits(vector, kind)
    networks = bundle.prior.networks
    for i in range(0, 300, 11):
        t = int(kind[i])
        x = torch.clamp((vector[i] - networks.mean[t]) * networks.scale[t], -5, 5)
        for layer in range(3):
            x = torch.tanh(x) if layer else x
            x = x @ networks.weight[layer][t, 0] + networks.bias[layer][t, 0, 0]
        torch.testing.assert_close(logits[i], x, rtol=1e-4, atol=1e-4)


def test_nobody_gets_no_modes(bundle: ModelBundle) -> None:
    nobody = Observation(np.zeros((0, 12), np.float32), None, np.zeros(0, np.int8))
    for sample in (True, False):
        assert PriorSelector(bundle, 1, sample=sample).choose(nobody).shape == (0,)
