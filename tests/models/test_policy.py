"""The policy begins as the prior, looks at the image, and survives its files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import ModelBundle, load_bundle, tensors
from slrl_sumo.models.policy import Policy, PolicyConfig, policy_logits
from slrl_sumo.models.selector import PolicySelector
from slrl_sumo.perception.observation import Observation


@pytest.fixture
def policy(bundle: ModelBundle) -> Policy:
    torch.manual_seed(5)
    return Policy(PolicyConfig(modes=bundle.config.modes, hidden=32, head=16, lookahead=False))


def _with_images(seen: Observation) -> Observation:
    image = np.random.default_rng(2).integers(0, 256, (len(seen), 20, 40, 3)).astype(np.uint8)
    return replace(seen, image=image, vector=np.abs(seen.vector))  # counts are not negative


def _disturb(policy: Policy) -> None:
    generator = torch.Generator().manual_seed(3)
    for parameter in policy.parameters():
        parameter.data += 0.3 * torch.randn(parameter.shape, generator=generator)


def test_an_untrained_policy_is_the_prior(bundle: ModelBundle, seen: Observation, policy: Policy) -> None:
    vector, image, kind = _arguments(_with_images(seen))
    logits, _ = policy_logits(policy, bundle.prior, vector, image, kind)
    known = torch.log_softmax(bundle.prior.logits(vector, kind), -1).clamp_min(-4.0)
    torch.testing.assert_close(logits, torch.log_softmax(known, -1))


def test_choices_depend_on_image_and_type_and_not_on_the_heading(
    bundle: ModelBundle, seen: Observation, policy: Policy
) -> None:
    _disturb(policy)
    vector, image, kind = _arguments(_with_images(seen))
    before, value = policy(vector, image, kind)
    turned = vector.clone()
    turned[:, 5] += 1.0
    torch.testing.assert_close(policy(turned, image, kind)[0], before)
    assert not torch.allclose(policy(vector, 255 - image, kind)[0], before)
    other, other_value = policy(vector, image, (kind + 1) % 3)
    assert not torch.allclose(other, before)
    assert not torch.allclose(other_value, value)


def test_greedy_takes_the_most_probable_mode_and_sampled_draws(
    bundle: ModelBundle, seen: Observation, policy: Policy
) -> None:
    _disturb(policy)
    trained = replace(bundle, policy=policy)
    looked = _with_images(seen)
    assert looked.image is not None
    logits, _ = policy_logits(policy, bundle.prior, *_arguments(looked))
    greedy = PolicySelector(trained, 1, sample=False).choose(looked)
    np.testing.assert_array_equal(greedy, logits.argmax(-1).numpy())
    draws = PolicySelector(trained, 1, sample=True)
    counts = np.zeros(logits.shape)
    for _ in range(400):
        counts[np.arange(len(looked)), draws.choose(looked)] += 1
    np.testing.assert_allclose(counts / 400, logits.exp().detach().numpy(), atol=0.12)


def _arguments(seen: Observation) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    vector, kind = tensors(seen)
    return vector, torch.from_numpy(seen.image), kind


def test_a_bundle_keeps_its_policy(bundle: ModelBundle, seen: Observation, policy: Policy, tmp_path: Path) -> None:
    _disturb(policy)
    looked = _with_images(seen)
    trained = replace(bundle, policy=policy, policy_training={"seed": 4})
    trained.save(tmp_path / "b")
    again = load_bundle(tmp_path / "b")
    assert again.policy_training == {"seed": 4}
    chosen = PolicySelector(trained, 1, sample=False).choose(looked)
    np.testing.assert_array_equal(PolicySelector(again, 1, sample=False).choose(looked), chosen)
    trained.save(tmp_path / "b")  # in place of itself
    replace(trained, policy=None).save(tmp_path / "b")
    assert load_bundle(tmp_path / "b").policy is None


@pytest.mark.parametrize("file", ["selector.json", "selector.safetensors"])
def test_half_a_selector_is_damage(bundle: ModelBundle, policy: Policy, tmp_path: Path, file: str) -> None:
    replace(bundle, policy=policy).save(tmp_path / "b")
    (tmp_path / "b" / file).write_bytes((tmp_path / "b" / file).read_bytes()[:40])
    with pytest.raises(InputError, match="its selector is damaged"):
        load_bundle(tmp_path / "b")
    (tmp_path / "b" / file).unlink()
    with pytest.raises(InputError, match=f"{file} missing"):
        load_bundle(tmp_path / "b")


def test_without_a_trained_policy_it_says_so(bundle: ModelBundle) -> None:
    with pytest.raises(InputError, match="it has no trained selector; use --selector prior"):
        PolicySelector(bundle, 1, sample=True)
