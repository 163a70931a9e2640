"""Selectors with networks in PyTorch: the prior and the trained policy."""

from collections.abc import Hashable, Sequence

import numpy as np
import torch
from torch import Tensor

from slrl_sumo.agent.selection import Mask, Modes, Uniform, drawn
from slrl_sumo.errors import InputError
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.policy import choice_logits, masked
from slrl_sumo.perception.observation import Observation

HOLD = 8
"""Decisions for which a sampled mode is held on average, 3.2 s. Modes that are sampled anew every 0.4 s cancel out: all
samples go the mean way. Of 1, 4, 8 and 12 it came nearest to held-out recordings of HC and SDD (docs/prediction.md)."""


class PriorSelector:
    """Chooses modes as road users did in the recordings (the paper's supervised baseline, section 4.1).

    With `sample` each mode is drawn from the prior's distribution by `uniform`, and held for a random time, HOLD calls
    on average; without ids it is drawn anew in every call. Otherwise the most central mode is taken (see `central`).
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
        """See Selector. A held mode that is not allowed any more is drawn anew."""
        with torch.inference_mode():
            vector, kind = tensors(observation)
            logits = self._bundle.prior.logits(vector, kind).double()
            probabilities = [
                torch.softmax(logits if mask is None else logits.masked_fill(torch.from_numpy(~mask), -torch.inf), -1)
                for mask in (None, *masks)
            ]
        if not self._sample:
            every = zip(probabilities, (None, *masks), strict=True)
            return [central(self._bundle, probability, kind, mask) for probability, mask in every]
        draw, again = self._uniform((2, len(observation)))
        chosen = [drawn(probability.numpy(), draw) for probability in probabilities]
        if ids is not None:
            holds = again >= 1 / HOLD
            for row, name in enumerate(ids):
                held = self._held.get(name)
                if holds[row] and held is not None:
                    for modes, mask in zip(chosen, (None, *masks), strict=True):
                        if mask is None or mask[row, held]:
                            modes[row] = held
            # Road users that are gone are forgotten.
            self._held = dict(zip(ids, chosen[-1].tolist(), strict=True))
        return chosen


class PolicySelector:
    """Chooses modes by the bundle's trained policy, which reads the image (paper, section 3.4).

    With `uniform` each mode is sampled anew in every call, as in training. Otherwise the most probable mode is taken,
    or, for predictions (`middle`), the most central one, as by PriorSelector. Raises InputError where the bundle has no
    trained policy.
    """

    def __init__(self, bundle: ModelBundle, uniform: Uniform | None = None, *, middle: bool = False) -> None:
        if bundle.policy is None:
            raise InputError(
                f"bundle {bundle.name}: it has no trained selector; use `selector='prior'`, or train one with "
                "`slrl-sumo train`"
            )
        self._bundle, self._middle = bundle, middle
        self._policy, self._prior = bundle.policy, bundle.prior
        config = bundle.policy.config
        self.needs_image, self.needs_rollouts, self.preset = config.image, config.lookahead, config.preset
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
        with torch.inference_mode():
            vector, kind = tensors(observation)
            image = None if observation.image is None else torch.from_numpy(observation.image)
            ahead, route = self._inputs(observation, rollouts)
            free = choice_logits(self._policy, self._prior, vector, image, kind, ahead, route)
            every = [free, *(masked(free, torch.from_numpy(mask)) for mask in masks)]
        if self._middle:
            masked_by = zip(every, (None, *masks), strict=True)
            return [central(self._bundle, logits.double().exp(), kind, mask) for logits, mask in masked_by]
        if self._uniform is None:
            return [np.asarray(logits.argmax(-1).numpy(), np.int64) for logits in every]
        draw = self._uniform((len(observation),))
        return [drawn(logits.double().exp().numpy(), draw) for logits in every]

    def _inputs(self, observation: Observation, rollouts: ModeRollouts | None) -> tuple[Tensor | None, Tensor | None]:
        """Rollouts and route as the policy reads them; without routes (recordings) those columns are zero."""
        config = self._policy.config
        ahead = None if rollouts is None else torch.from_numpy(rollouts.columns(config.rollout_features))
        if not config.route_columns:
            return ahead, None
        given = observation.route
        return ahead, torch.zeros(len(observation), config.route_columns) if given is None else torch.from_numpy(given)


def central(bundle: ModelBundle, probability: Tensor, kind: Tensor, mask: Mask | None = None) -> Modes:
    """The modes (n,) whose destinations are on average nearest to those that `probability` (n, modes) expects.

    Of many modes side by side none is probable, and the most probable one may be an outlier: this one errs least.
    `kind`: (n,) int64 types; `mask` (n, modes): only these are taken.
    """
    centres = torch.from_numpy(bundle.mode_centres)
    distance = torch.cdist(centres, centres)
    expected = torch.zeros_like(probability)
    for t in range(len(centres)):
        expected[kind == t] = probability[kind == t] @ distance[t]
    if mask is not None:
        expected[torch.from_numpy(~mask)] = torch.inf
    return np.asarray(expected.argmin(-1).numpy(), np.int64)
