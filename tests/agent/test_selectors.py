from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from slrl_sumo.agent.selection import Selector, drawn
from slrl_sumo.agent.selectors import HOLD, PolicySelector, PriorSelector
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.observation import Observation


def prior(bundle: ModelBundle, seed: int, *, sample: bool = True) -> PriorSelector:
    return PriorSelector(bundle, np.random.default_rng(seed).random, sample=sample)


def chosen(
    selector: Selector, seen: Observation, ids: Sequence[str] | None = None, allowed: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """The mode of each road user, under the mask if there is one."""
    every = selector.choose(seen, None, ids, [] if allowed is None else [allowed])
    assert len(every) == 1 + (allowed is not None)
    return every[-1]


def test_same_seed_same_modes_and_another_seed_others(bundle: ModelBundle, seen: Observation) -> None:
    one, same, other = (prior(bundle, seed) for seed in (5, 5, 6))
    first = chosen(one, seen)
    second = chosen(one, seen)
    assert first.dtype == np.int64
    assert first.shape == (300,)
    np.testing.assert_array_equal(first, chosen(same, seen))
    np.testing.assert_array_equal(second, chosen(same, seen))
    assert (first != second).any()
    assert (first != chosen(other, seen)).any()


def test_selector_leaves_global_random_states_alone(bundle: ModelBundle, seen: Observation) -> None:
    before = torch.get_rng_state()
    expected = chosen(prior(bundle, 5), seen)
    np.random.seed(0)  # noqa: NPY002 - what others do to the global state must not matter
    torch.manual_seed(1)
    np.testing.assert_array_equal(chosen(prior(bundle, 5), seen), expected)
    torch.set_rng_state(before)


def test_modes_are_drawn_as_often_as_the_prior_says(bundle: ModelBundle, seen: Observation) -> None:
    times = 40_000
    for one in range(3):
        many = Observation(np.repeat(seen.vector[one : one + 1], times, 0), None, np.repeat(seen.type[one], times))
        drawn = np.bincount(chosen(prior(bundle, 1), many), minlength=20) / times
        vector, kind = tensors(many)
        probability = torch.softmax(bundle.prior.logits(vector[:1], kind[:1]), -1)[0].numpy()
        np.testing.assert_allclose(drawn, probability, atol=4 * np.sqrt(0.25 / times))


def test_a_drawn_mode_is_held_by_its_road_user_for_as_long_as_chance_says(
    bundle: ModelBundle, seen: Observation
) -> None:
    times = 4000
    ids = [f"u{i}" for i in range(times)]
    # Two modes that are equally likely: a new draw gives the other one every second time.
    bundle.prior.networks.weight[-1].zero_()
    bundle.prior.networks.bias[-1].fill_(-100.0)
    bundle.prior.networks.bias[-1][..., [3, 8]] = 0.0
    many = Observation(np.repeat(seen.vector[:1], times, 0), None, np.repeat(seen.type[:1], times))
    selector = prior(bundle, 1)
    first = chosen(selector, many, ids)
    assert set(first.tolist()) == {3, 8}
    order = np.random.default_rng(0).permutation(times)
    second = chosen(selector, many, [ids[i] for i in order])  # by name, not by row
    assert np.mean(second != first[order]) == pytest.approx(0.5 / HOLD, abs=0.015)
    stranger = chosen(selector, many, [f"v{i}" for i in range(times)])
    assert np.mean(stranger != second) == pytest.approx(0.5, abs=0.04)
    assert np.mean(chosen(selector, many, ids) != first) == pytest.approx(
        0.5, abs=0.04
    )  # absent road users are forgotten


def test_without_sampling_the_most_central_mode_is_taken(bundle: ModelBundle, seen: Observation) -> None:
    modes = chosen(prior(bundle, 1, sample=False), seen, ["x"] * 300)
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


def test_no_road_users_get_no_modes(bundle: ModelBundle) -> None:
    no_users = Observation(np.zeros((0, 12), np.float32), None, np.zeros(0, np.int8))
    for sample in (True, False):
        assert chosen(prior(bundle, 1, sample=sample), no_users).shape == (0,)


SELECTORS = ("prior", "central", "greedy", "sampled")


def _selector(name: str, bundle: ModelBundle) -> Selector:
    if name in ("prior", "central"):
        return prior(bundle, 1, sample=name == "prior")
    torch.manual_seed(1)
    policy = Policy(PolicyConfig(modes=20, hidden=16, head=8, lookahead=False))
    for parameter in policy.parameters():
        parameter.data += 0.3 * torch.randn(parameter.shape)
    uniform = np.random.default_rng(1).random if name == "sampled" else None
    return PolicySelector(replace(bundle, policy=policy), uniform)


def _looked(seen: Observation) -> Observation:
    image = np.random.default_rng(2).integers(0, 256, (len(seen), 20, 40, 3)).astype(np.uint8)
    return replace(seen, image=image, vector=np.abs(seen.vector))


@pytest.mark.parametrize("name", SELECTORS)
def test_modes_that_are_not_allowed_are_never_chosen(bundle: ModelBundle, seen: Observation, name: str) -> None:
    looked, ids = _looked(seen), [str(i) for i in range(len(seen))]
    random = np.random.default_rng(3)
    free = chosen(_selector(name, bundle), looked, ids)
    selector = _selector(name, bundle)
    all_users = np.arange(len(seen))
    for share in (0.5, 0.1, 0.0):
        allowed = random.random((len(seen), 20)) < share
        allowed[all_users, random.integers(0, 20, len(seen))] = True
        for _ in range(10):
            modes = chosen(selector, looked, ids, allowed)
            assert allowed[all_users, modes].all()
        if share == 0.0:
            np.testing.assert_array_equal(modes, allowed.argmax(axis=1))
    # The first choice is masked for all: each takes another one.
    allowed = np.ones((len(seen), 20), np.bool_)
    allowed[all_users, free] = False
    assert (chosen(_selector(name, bundle), looked, ids, allowed) != free).all()


@pytest.mark.parametrize("name", SELECTORS)
def test_with_all_modes_allowed_choices_stay_the_same(bundle: ModelBundle, seen: Observation, name: str) -> None:
    looked, ids = _looked(seen), [str(i) for i in range(len(seen))]
    free, masked = _selector(name, bundle), _selector(name, bundle)
    for _ in range(5):
        np.testing.assert_array_equal(
            chosen(masked, looked, ids, np.ones((len(seen), 20), np.bool_)), chosen(free, looked, ids)
        )


def test_of_what_is_allowed_the_most_probable_is_taken(bundle: ModelBundle, seen: Observation) -> None:
    looked = _looked(seen)
    first = chosen(_selector("greedy", bundle), looked)
    allowed = np.ones((len(seen), 20), np.bool_)
    allowed[np.arange(len(seen)), first] = False
    second = chosen(_selector("greedy", bundle), looked, None, allowed)
    # Whoever may take only the first or the second takes the first again.
    both = np.zeros_like(allowed)
    both[np.arange(len(seen)), first] = both[np.arange(len(seen)), second] = True
    np.testing.assert_array_equal(chosen(_selector("greedy", bundle), looked, None, both), first)
    others = ~both
    third = chosen(_selector("greedy", bundle), looked, None, others)
    pair = np.zeros_like(allowed)
    pair[np.arange(len(seen)), second] = pair[np.arange(len(seen)), third] = True
    np.testing.assert_array_equal(chosen(_selector("greedy", bundle), looked, None, pair), second)


def test_a_held_mode_is_drawn_anew_only_where_it_is_no_longer_allowed(bundle: ModelBundle, seen: Observation) -> None:
    times = 2000
    ids = [str(i) for i in range(times)]
    many = Observation(np.repeat(seen.vector[:1], times, 0), None, np.repeat(seen.type[:1], times))
    selector = prior(bundle, 1)
    first = chosen(selector, many, ids)
    allowed = np.ones((times, 20), np.bool_)
    gone = np.arange(times) < times // 2
    allowed[np.flatnonzero(gone), first[gone]] = False
    second = chosen(selector, many, ids, allowed)
    assert (second[gone] != first[gone]).all()
    assert np.mean(second[~gone] == first[~gone]) > 1 - 1.5 / HOLD
    # The new one is held as the old one was, even where that is allowed again.
    third = chosen(selector, many, ids)
    assert np.mean(third[gone] == second[gone]) > 1 - 1.5 / HOLD


def test_rounding_never_leads_to_a_mode_that_cannot_be() -> None:
    # The sum is a hair below 1, and the draw lies above it.
    probability = np.array([[0.0, 0.25, 0.7499999, 0.0, 0.0]])
    assert drawn(probability, np.array([1.0 - 1e-12])).tolist() == [2]
    assert drawn(probability, np.array([0.0])).tolist() == [1]


@pytest.mark.parametrize("name", SELECTORS)
def test_masks_one_after_the_other_are_choices_of_the_same_moment(
    bundle: ModelBundle, seen: Observation, name: str
) -> None:
    looked, ids = _looked(seen), [str(i) for i in range(len(seen))]
    random = np.random.default_rng(3)
    first = random.random((len(seen), 20)) < 0.5
    first[:, 3] = True
    second = first & (random.random((len(seen), 20)) < 0.5)
    second[:, 3] = True
    every = _selector(name, bundle).choose(looked, None, ids, [first, second])
    for masks, modes in zip(([], [first], [second]), every, strict=True):
        np.testing.assert_array_equal(_selector(name, bundle).choose(looked, None, ids, masks)[-1], modes)
