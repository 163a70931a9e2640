"""The policy begins as the prior, looks at the image (and in the preset `extended` at the route), and survives its
files."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from slrl_sumo.agent.selectors import PolicySelector, central
from slrl_sumo.errors import InputError
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.route_fit import RouteFit
from slrl_sumo.models.bundle import ModelBundle, load_bundle, tensors
from slrl_sumo.models.policy import IMAGES_AT_ONCE, Policy, choice_logits, policy_logits
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.models.trained_policy import network_of, on_expected_routes
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
    (greedy,) = PolicySelector(trained).choose(looked, None)
    np.testing.assert_array_equal(greedy, logits.argmax(-1).numpy())
    draws = PolicySelector(trained, np.random.default_rng(1).random)
    counts = np.zeros(logits.shape)
    for _ in range(400):
        counts[np.arange(len(looked)), draws.choose(looked, None)[0]] += 1
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
    np.testing.assert_array_equal(*(PolicySelector(one).choose(looked, None)[0] for one in (trained, again)))
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


def test_a_process_that_was_forked_reads_it(bundle: ModelBundle, policy: Policy, tmp_path: Path) -> None:
    """What has threads of OpenMP in the parent may not be computed there: the threads do not exist in the child."""
    replace(bundle, policy=policy).save(tmp_path / "with policy")
    done = subprocess.run(
        [sys.executable, "-c", FORKED, str(tmp_path / "with policy")],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout == "threads\nread\n", done.stderr


FORKED = """
import os, signal, sys
import torch
from slrl_sumo.models.bundle import load_bundle
torch.set_num_threads(4)
before = len(os.listdir("/proc/self/task"))
torch.nn.init.orthogonal_(torch.empty(500, 100))
print("threads" if len(os.listdir("/proc/self/task")) > before else "no threads", flush=True)
child = os.fork()
if child == 0:
    signal.alarm(100)  # ends a child that waits
    policy = load_bundle(sys.argv[1]).policy
    print("read" if torch.equal(policy.with_route, torch.ones(3, 2)) else "damaged", flush=True)
    os._exit(0)
os.waitpid(child, 0)
"""


def test_without_a_trained_policy_it_says_so(bundle: ModelBundle) -> None:
    with pytest.raises(InputError, match="it has no trained selector; use `selector='prior'`"):
        PolicySelector(bundle)


@pytest.fixture
def extended(bundle: ModelBundle) -> Policy:
    torch.manual_seed(6)
    return Policy(PolicyConfig(preset="extended", modes=bundle.config.modes, hidden=32, head=16))


def _on_route(seen: Observation, config: PolicyConfig | None = None) -> Observation:
    """With the columns that a policy reads: default, of the preset `extended`."""
    config = config or PolicyConfig(preset="extended")
    random, looked = np.random.default_rng(5), _with_images(seen)
    route = random.random((len(seen), config.route_columns or 14))
    more = random.random((len(seen), len(config.vector_columns) - looked.vector.shape[1]))
    vector = np.concatenate([looked.vector, more], axis=1, dtype=np.float32)
    return replace(looked, vector=vector, route=route.astype(np.float32))


def _rollouts(n: int) -> ModeRollouts:
    random = np.random.default_rng(4)
    route = RouteFit(*(random.random((n, 20)) for _ in RouteFit._fields))
    return ModeRollouts(*(random.random((n, 20)) for _ in range(6)), route=route)


def _everything(seen: Observation) -> tuple[torch.Tensor, ...]:
    assert seen.route is not None
    columns = _rollouts(len(seen)).columns(PolicyConfig(preset="extended").rollout_features)
    return *_arguments(seen), torch.from_numpy(columns), torch.from_numpy(seen.route)


def test_an_untrained_extended_policy_is_the_prior_too(
    bundle: ModelBundle, seen: Observation, extended: Policy
) -> None:
    vector, image, kind, ahead, route = _everything(_on_route(seen))
    logits, _ = policy_logits(extended, bundle.prior, vector, image, kind, ahead, route)
    known = torch.log_softmax(bundle.prior.logits(vector, kind), -1).clamp_min(-4.0)
    torch.testing.assert_close(logits, torch.log_softmax(known, -1))


def test_choices_depend_on_every_column_of_the_route(seen: Observation, extended: Policy) -> None:
    _disturb(extended)
    vector, image, kind, ahead, route = _everything(_on_route(seen))
    before, value = extended(vector, image, kind, ahead, route)
    for column in range(14):
        other = route.clone()
        other[:, column] += 1.0
        after, other_value = extended(vector, image, kind, ahead, other)
        assert not torch.allclose(after, before)
        assert not torch.allclose(other_value, value)


def test_what_a_mode_leads_to_speaks_for_that_mode_alone(seen: Observation, extended: Policy) -> None:
    _disturb(extended)
    vector, image, kind, ahead, route = _everything(_on_route(seen))
    before, _ = extended(vector, image, kind, ahead, route)
    for column in range(9):
        other = ahead.clone()
        other[:, 5, column] += 1.0
        after, _ = extended(vector, image, kind, other, route)
        changed = (after - before).abs() > 1e-4
        assert changed[:, 5].float().mean() > 0.9
        changed[:, 5] = False
        assert not changed.any()


def test_an_extended_selector_reads_the_route_and_does_without_one(
    bundle: ModelBundle, seen: Observation, extended: Policy
) -> None:
    _disturb(extended)
    trained, looked = replace(bundle, policy=extended), _on_route(seen)
    logits, _ = policy_logits(extended, bundle.prior, *_everything(looked))
    selector, rollouts = PolicySelector(trained), _rollouts(len(seen))
    assert (selector.preset, selector.needs_rollouts) == ("extended", True)
    (chosen,) = selector.choose(looked, rollouts)
    np.testing.assert_array_equal(chosen, logits.argmax(-1).numpy())
    # Recordings know no routes: there all that is about them is zero.
    assert looked.route is not None
    (without,) = selector.choose(replace(looked, route=None), replace(rollouts, route=None))
    zeros = RouteFit(*(np.zeros((len(seen), 20)) for _ in RouteFit._fields))
    nowhere = replace(looked, route=np.zeros_like(looked.route))
    np.testing.assert_array_equal(without, selector.choose(nowhere, replace(rollouts, route=zeros))[0])
    assert (without != chosen).any()
    with pytest.raises(ValueError, match="rollouts"):
        selector.choose(looked, None)


def _without_corrections(policy: Policy, bundle: ModelBundle, seen: Observation) -> tuple[torch.Tensor, ...]:
    """What is seen, and the prior's log probabilities; corrections count for none of those without a route."""
    _disturb(policy)
    vector, image, kind, ahead, route = _everything(_on_route(seen))
    route[:, 0] = torch.arange(len(route)) % 2  # every other one has a route
    before = choice_logits(policy, bundle.prior, vector, image, kind, ahead, route)
    policy.without_route.zero_()
    after = choice_logits(policy, bundle.prior, vector, image, kind, ahead, route)
    torch.testing.assert_close(after[1::2], before[1::2])
    # Nothing but the prior is left, its improbable modes included.
    known = torch.log_softmax(bundle.prior.logits(vector, kind), -1)
    torch.testing.assert_close(after[::2], known[::2])
    return vector, image, kind, ahead, route, known


def test_without_a_route_corrections_count_by_their_shares(
    bundle: ModelBundle, seen: Observation, extended: Policy
) -> None:
    vector, image, kind, ahead, route, known = _without_corrections(extended, bundle, seen)
    heads, scorers = extended.parts(vector, image, kind, ahead, route)
    extended.without_route.copy_(torch.tensor([[0.25, 0.5]] * 3))
    some = choice_logits(extended, bundle.prior, vector, image, kind, ahead, route)
    torch.testing.assert_close(some[::2], torch.log_softmax(known + 0.25 * heads + 0.5 * scorers, -1)[::2])


def test_without_a_route_the_prior_counts_where_it_does_not_with_one(bundle: ModelBundle, seen: Observation) -> None:
    torch.manual_seed(7)
    policy = Policy(PolicyConfig(preset="extended", modes=20, hidden=32, head=16, image=False, prior_logits=False))
    _without_corrections(policy, bundle, seen)


def test_on_expected_routes_corrections_count_by_their_own_shares(
    bundle: ModelBundle, seen: Observation, extended: Policy
) -> None:
    _disturb(extended)
    vector, image, kind, ahead, route = _everything(_on_route(seen))
    route[:, 0] = torch.arange(len(route)) % 2  # every other one has a route
    heads, scorers = extended.parts(vector, image, kind, ahead, route)
    copied = on_expected_routes(extended, {"expected_route": [[0.25, 0.5]] * 3})
    assert copied is not None
    found = choice_logits(copied, bundle.prior, vector, image, kind, ahead, route)
    known = torch.log_softmax(bundle.prior.logits(vector, kind), -1)
    torch.testing.assert_close(found[1::2], torch.log_softmax(known + 0.25 * heads + 0.5 * scorers, -1)[1::2])
    # Without a route, and in runs, as before.
    before = choice_logits(extended, bundle.prior, vector, image, kind, ahead, route)
    torch.testing.assert_close(found[::2], before[::2])
    assert not torch.allclose(found[1::2], before[1::2])


def test_a_policy_that_does_not_count_on_expected_routes_has_none(extended: Policy) -> None:
    assert on_expected_routes(extended, {}) is None
    assert on_expected_routes(extended, {"expected_route": [[0.0, 0.0]] * 3}) is None


def test_a_prediction_takes_the_most_central_mode(bundle: ModelBundle, seen: Observation, policy: Policy) -> None:
    _disturb(policy)
    looked, trained = _with_images(seen), replace(bundle, policy=policy)
    vector, image, kind = _arguments(looked)
    probability = choice_logits(policy, bundle.prior, vector, image, kind).double().exp()
    mask = np.random.default_rng(1).random(probability.shape) < 0.5
    free, allowed = PolicySelector(trained, middle=True).choose(looked, None, masks=[mask])
    np.testing.assert_array_equal(free, central(bundle, probability.detach().numpy(), kind.numpy()))
    assert mask[np.arange(len(allowed)), allowed].all()


def test_masked_modes_have_no_probability_and_leave_the_others_in_proportion(
    bundle: ModelBundle, seen: Observation, policy: Policy
) -> None:
    _disturb(policy)
    vector, image, kind = _arguments(_with_images(seen))
    mask = torch.rand(len(kind), 20, generator=torch.Generator().manual_seed(2)) < 0.5
    mask[:, 4] = True
    free, _ = policy_logits(policy, bundle.prior, vector, image, kind)
    logits, _ = policy_logits(policy, bundle.prior, vector, image, kind, mask=mask)
    expected = torch.softmax(free.double().masked_fill(~mask, -torch.inf), -1)
    torch.testing.assert_close(logits.double().exp(), expected, rtol=1e-4, atol=1e-6)
    explored, _ = policy_logits(policy, bundle.prior, vector, image, kind, mask=mask, explore=0.2)
    uniform = mask / mask.sum(-1, keepdim=True)
    torch.testing.assert_close(explored.double().exp(), 0.8 * expected + 0.2 * uniform, rtol=1e-4, atol=1e-6)
    # Entropies and divergences are finite.
    assert torch.isfinite((explored.exp() * explored).sum(-1)).all()


def test_a_bundle_keeps_its_preset(bundle: ModelBundle, seen: Observation, extended: Policy, tmp_path: Path) -> None:
    _disturb(extended)
    looked, trained = _on_route(seen), replace(bundle, policy=extended)
    trained.save(tmp_path / "b")
    again = load_bundle(tmp_path / "b")
    assert again.policy is not None
    assert again.policy.config == extended.config
    rollouts = _rollouts(len(seen))
    np.testing.assert_array_equal(*(PolicySelector(one).choose(looked, rollouts)[0] for one in (trained, again)))


@pytest.mark.parametrize("shapes", ["policy", "extended"])
def test_a_preset_of_another_version_is_said(
    bundle: ModelBundle, tmp_path: Path, shapes: str, request: pytest.FixtureRequest
) -> None:
    replace(bundle, policy=request.getfixturevalue(shapes)).save(tmp_path / "b")
    file = tmp_path / "b" / "selector.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"preset": "telepathic"}))
    message = "reads preset 'telepathic', this slrl_sumo runs paper, image and extended"
    with pytest.raises(InputError, match=message) as caught:
        load_bundle(tmp_path / "b")
    assert "\n" not in str(caught.value)


def test_each_is_judged_by_the_heads_of_its_type(seen: Observation, extended: Policy) -> None:
    _disturb(extended)
    looking = _with_images(seen)
    rng = np.random.default_rng(4)
    ahead, route = (torch.from_numpy(rng.random((len(seen), *shape), np.float32)) for shape in ((20, 9), (14,)))
    vector, image, kind = _arguments(looking)
    assert len(kind) > IMAGES_AT_ONCE
    correction, value = extended(vector, image, kind, ahead, route)
    for row in (0, 1, 7, IMAGES_AT_ONCE - 1, IMAGES_AT_ONCE, len(kind) - 1):
        one = slice(row, row + 1)
        features = torch.cat([vector[one, :5] * torch.tensor([0.1, 0.3, 1.0, 1.0, 1.0])], -1)
        counts = 0.5 * torch.log1p(vector[one, 6:])
        encoded = extended.encoder(image[one].permute(0, 3, 1, 2).float() / 127.5 - 1.0)
        trunk = extended.trunk(torch.cat([encoded, features, counts, route[one]], -1))
        head = int(kind[row])
        torch.testing.assert_close(value[one], extended.critics[head](trunk)[:, 0], rtol=1e-4, atol=1e-4)
        alone, _ = extended(vector[one], image[one], kind[one], ahead[one], route[one])
        torch.testing.assert_close(correction[one], alone, rtol=1e-4, atol=1e-4)
        leads = correction[one] - extended.actors[head](trunk)
        other = extended(vector[one], image[one], (kind[one] + 1) % 3, ahead[one], route[one])[0]
        assert not torch.allclose(leads + extended.actors[(head + 1) % 3](trunk), other, atol=1e-3)


def test_logits_without_values_are_the_same(bundle: ModelBundle, seen: Observation, policy: Policy) -> None:
    _disturb(policy)
    vector, image, kind = _arguments(_with_images(seen))
    logits, _ = policy_logits(policy, bundle.prior, vector, image, kind)
    with torch.inference_mode():
        chosen = choice_logits(policy, bundle.prior, vector, image, kind)
    torch.testing.assert_close(chosen.clone(), logits.detach(), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "shapes", [{"prior_logits": False}, {"preset": "paper"}, {"lookahead": False}, {"preset": "image"}]
)
def test_a_network_without_pytorch_gives_the_same_logits(
    bundle: ModelBundle, seen: Observation, shapes: dict[str, Any], tmp_path: Path
) -> None:
    torch.manual_seed(7)
    config = PolicyConfig(**{"preset": "extended", "modes": 20, "hidden": 32, "head": 16, "image": False} | shapes)
    policy = Policy(config)
    _disturb(policy)
    policy.without_route.copy_(torch.tensor([[0.25, 0.5]] * 3))
    looked = replace(_on_route(seen, config), image=None)
    assert looked.route is not None
    looked.route[:, 0] = np.arange(len(seen)) % 2  # every other one has a route
    vector, kind = tensors(looked)
    ahead = _rollouts(len(seen)).columns(config.rollout_features)
    route = torch.from_numpy(looked.route) if config.route_columns else None
    expected = choice_logits(policy, bundle.prior, vector, None, kind, torch.from_numpy(ahead), route)
    record = {"without_route": policy.without_route.tolist()}
    replace(bundle, policy=policy, policy_training=record).save(tmp_path / "b")
    again = load_bundle(tmp_path / "b", training=False)
    assert again.policy is None
    assert again.network is not None
    found = again.network.choice_logits(
        again.prior_networks, looked.vector, kind.numpy(), ahead, looked.route if config.route_columns else None
    )
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected.detach().numpy(), rtol=1e-4, atol=1e-4)
    if config.route_columns:
        policy.with_route.copy_(torch.tensor([[0.5, 0.125]] * 3))
        expected = choice_logits(policy, bundle.prior, vector, None, kind, torch.from_numpy(ahead), route)
        found = network_of(policy).choice_logits(
            bundle.prior_networks, looked.vector, kind.numpy(), ahead if config.looks_ahead else None, looked.route
        )
        np.testing.assert_allclose(found, expected.detach().numpy(), rtol=1e-4, atol=1e-4)


def test_weights_of_other_shapes_are_damage_without_pytorch_too(bundle: ModelBundle, tmp_path: Path) -> None:
    policy = Policy(PolicyConfig(preset="extended", modes=20, hidden=32, head=16, image=False))
    replace(bundle, policy=policy).save(tmp_path / "b")
    file = tmp_path / "b" / "selector.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"hidden": 33}))
    for training in (False, True):
        with pytest.raises(InputError, match="its selector is damaged"):
            load_bundle(tmp_path / "b", training=training)


def test_the_preset_image_reads_the_past_the_path_and_no_rollouts(bundle: ModelBundle, seen: Observation) -> None:
    torch.manual_seed(8)
    policy = Policy(PolicyConfig(preset="image", modes=20, hidden=32, head=16))
    _disturb(policy)
    looked = _on_route(seen, policy.config)
    vector, image, kind = _arguments(looked)
    route = torch.from_numpy(looked.route)
    before, _ = policy(vector, image, kind, None, route)
    for columns, name in ((vector, "vector"), (route, "route")):
        for k in range(columns.shape[1]):
            kept = columns[:, k].clone()
            columns[:, k] += 1.0
            reads = not torch.equal(policy(vector, image, kind, None, route)[0], before)
            assert reads == (policy.config.vector_columns[k] != "heading" if name == "vector" else True)
            columns[:, k] = kept
    # The models read the first columns.
    known = bundle.prior.logits(vector, kind)
    torch.testing.assert_close(known, bundle.prior.logits(vector[:, :12], kind))
