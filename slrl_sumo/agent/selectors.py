"""Selectors with networks: the prior and the trained policy. Only policies that read images need PyTorch."""

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.selection import Mask, Modes, Uniform, drawn
from slrl_sumo.errors import InputError
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.motion_models import Singles, outputs
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.models.policy_network import masked
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats

HOLD = 8
"""Mean number of decisions (3.2 s) for which a sampled mode is held. Modes that are sampled again every 0.4 s average
out: all samples take the mean path. Of 1, 4, 8 and 12, this value came nearest to held-out recordings of HC and SDD
(docs/measurements/archive/prediction.md)."""


class PriorSelector:
    """Chooses modes as road users did in the recordings (the paper's supervised baseline, section 4.1).

    With `sample`, it draws each mode from the prior's distribution with `uniform` and holds it for a random time, HOLD
    calls on average; without ids it draws in every call. Without `sample`, it takes the most central mode (see
    `central`).
    """

    needs_image = False
    needs_rollouts = False
    preset = "paper"

    def __init__(self, bundle: ModelBundle, uniform: Uniform, *, sample: bool = True) -> None:
        self._bundle = bundle
        self._sample = sample
        self._uniform = uniform
        self._held: dict[Hashable, int] = {}

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None = None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """See Selector. A held mode that is no longer allowed is replaced by a new draw."""
        kind = observation.type.astype(np.int64)
        logits = outputs(self._bundle.prior_networks, observation.vector, kind)[:, 0].astype(np.float64)
        allowed = [logits, *(np.where(mask, logits, -np.inf) for mask in masks)]
        weights = [np.exp(each - each.max(axis=1, keepdims=True)) for each in allowed]
        probabilities = [each / each.sum(axis=1, keepdims=True) for each in weights]
        if not self._sample:
            every = zip(probabilities, (None, *masks), strict=True)
            return [central(self._bundle, probability, kind, mask) for probability, mask in every]
        draw, again = self._uniform((2, len(observation)))
        chosen = [drawn(probability, draw) for probability in probabilities]
        if ids is not None:
            holds = again >= 1 / HOLD
            for row, name in enumerate(ids):
                held = self._held.get(name)
                if holds[row] and held is not None:
                    for modes, mask in zip(chosen, (None, *masks), strict=True):
                        if mask is None or mask[row, held]:
                            modes[row] = held
            # Drop road users that have left.
            self._held = dict(zip(ids, chosen[-1].tolist(), strict=True))
        return chosen


class PolicySelector:
    """Chooses modes by the bundle's trained policy, which reads the image (paper, section 3.4).

    With `uniform`, it samples each mode in every call, as in training. Otherwise it takes the most probable mode, or,
    for predictions (`middle`), the most central mode, as PriorSelector does. Raises InputError if the bundle has no
    trained policy.
    """

    def __init__(self, bundle: ModelBundle, uniform: Uniform | None = None, *, middle: bool = False) -> None:
        if bundle.policy is None and bundle.network is None:
            raise InputError(
                f"bundle {bundle.name}: it has no trained selector; use `selector='prior'`, or train one with "
                "`slrl-sumo train`"
            )
        self._bundle, self._middle = bundle, middle
        self._network = bundle.network
        if bundle.policy is not None and not bundle.policy.config.image:
            from slrl_sumo.models.trained_policy import network_of

            self._network = network_of(bundle.policy)
        config = self._config
        self.needs_image, self.needs_rollouts, self.preset = config.image, config.looks_ahead, config.preset
        self._uniform = uniform

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """See Selector."""
        if observation.image is None and self.needs_image:
            raise ValueError("this selector needs observations with images")
        if rollouts is None and self.needs_rollouts:
            raise ValueError("this selector needs mode rollouts")
        kind = observation.type.astype(np.int64)
        ahead, route = self._inputs(observation, rollouts)
        if self._network is None:
            free = self._in_pytorch(observation, ahead, route)
        else:
            free = self._network.choice_logits(self._bundle.prior_networks, observation.vector, kind, ahead, route)
        every = [free, *(masked(free, mask) for mask in masks)]
        if self._middle:
            masked_by = zip(every, (None, *masks), strict=True)
            return [central(self._bundle, np.exp(logits, dtype=np.float64), kind, mask) for logits, mask in masked_by]
        if self._uniform is None:
            return [np.asarray(logits.argmax(axis=1), np.int64) for logits in every]
        draw = self._uniform((len(observation),))
        return [drawn(np.exp(logits, dtype=np.float64), draw) for logits in every]

    @property
    def _config(self) -> PolicyConfig:
        if self._network is not None:
            return self._network.config
        assert self._bundle.policy is not None
        return self._bundle.policy.config

    def _inputs(self, observation: Observation, rollouts: ModeRollouts | None) -> tuple[Singles | None, Singles | None]:
        """Rollouts and route as inputs of the policy; without routes (recordings) the route columns are zero."""
        config = self._config
        ahead = None if rollouts is None else rollouts.columns(config.rollout_features)
        if not config.route_columns:
            return ahead, None
        given = observation.route
        return ahead, np.zeros((len(observation), config.route_columns), np.float32) if given is None else given

    def _in_pytorch(self, observation: Observation, ahead: Singles | None, route: Singles | None) -> Singles:
        """Like PolicyNetwork.choice_logits, for a policy that reads the image."""
        import torch

        from slrl_sumo.models.policy import choice_logits

        policy = self._bundle.policy
        assert policy is not None
        with torch.inference_mode():
            vector, kind = tensors(observation)
            image, ahead_, route_ = (
                None if each is None else torch.from_numpy(each) for each in (observation.image, ahead, route)
            )
            free = choice_logits(policy, self._bundle.prior, vector, image, kind, ahead_, route_)
        return np.asarray(free.numpy())


def central(bundle: ModelBundle, probability: Floats, kind: NDArray[np.int64], mask: Mask | None = None) -> Modes:
    """The modes (n,) with the least expected distance of destinations under `probability` (n, modes).

    If many modes are similar, none of them is probable, and the most probable mode may be an outlier; the most central
    mode has the least expected error. `kind`: (n,) int64 types. `mask` (n, modes): allowed modes.
    """
    centres = bundle.mode_centres
    distance = np.hypot(*np.moveaxis(centres[:, :, None] - centres[:, None], -1, 0))
    expected = np.zeros_like(probability)
    for t in range(len(centres)):
        expected[kind == t] = probability[kind == t] @ distance[t]
    if mask is not None:
        expected[~mask] = np.inf
    return np.asarray(expected.argmin(axis=1), np.int64)
