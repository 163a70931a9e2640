import numpy as np
import torch

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.selector import PriorSelector
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


def test_without_sampling_the_most_probable_mode_is_taken(bundle: ModelBundle, seen: Observation) -> None:
    modes = PriorSelector(bundle, 1, sample=False).choose(seen)
    np.testing.assert_array_equal(modes, bundle.prior.logits(*tensors(seen)).argmax(-1).numpy())
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
