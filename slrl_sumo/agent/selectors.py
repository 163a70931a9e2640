"""Selectors: what chooses a mode for each road user."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.policy import choice_logits
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats

HOLD = 8
"""Decisions for which a drawn mode is held on average, 3.2 s. Modes that are drawn anew every 0.4 s cancel out: all
samples go the mean way. Of 1, 4, 8 and 12 it came nearest to held-out recordings of HC and SDD (docs/prediction.md)."""

Modes = NDArray[np.int64]


class Selector(Protocol):
    """Chooses modes. One selector belongs to one run: it may carry a memory and a random state from call to call."""

    needs_image: bool
    """Whether `choose` reads `Observation.image`; where it does not, no image needs to be drawn."""
    looks_ahead: bool
    """Whether it reads `Observation.ahead`."""
    preset: str
    """`extended` where it reads `Observation.route` and images and lookahead with the route, else `paper`."""

    def choose(
        self, observation: Observation, ids: Sequence[str] | None = None, allowed: NDArray[np.bool_] | None = None
    ) -> Modes:
        """The mode of each observed road user, (n,) in 0..modes-1; `ids` (n,) say who it is that observes.

        Of the modes that are `allowed`, (n, modes), at least one each; None allows all.
        """
        ...


class PriorSelector:
    """Chooses the modes as people did in the recordings (the paper's supervised baseline, section 4.1).

    With `sample` each mode is drawn from the prior's distribution, by a generator of its own seeded with `seed`, and
    held for a random time, HOLD calls on average; who is not named by `ids` gets a new one every call. Otherwise the
    most central mode is taken (see `central`) and `seed` has no say.
    """

    needs_image = False
    looks_ahead = False
    preset = "paper"

    def __init__(self, bundle: ModelBundle, seed: int, *, sample: bool = True) -> None:
        self._bundle = bundle
        self._sample = sample
        self._random = np.random.default_rng(seed)
        self._held: dict[str, int] = {}

    def choose(
        self, observation: Observation, ids: Sequence[str] | None = None, allowed: NDArray[np.bool_] | None = None
    ) -> Modes:
        """See Selector. A held mode that is not allowed any more is drawn anew."""
        with torch.inference_mode():
            vector, kind = tensors(observation)
            logits = self._bundle.prior.logits(vector, kind).double()
            if allowed is not None:
                logits = logits.masked_fill(torch.from_numpy(~allowed), -torch.inf)
            probability = torch.softmax(logits, -1)
            if not self._sample:
                return central(self._bundle, probability, kind, allowed)
        draw, again = self._random.random((2, len(observation)))
        modes = drawn(probability.numpy(), draw)
        if ids is not None:
            holds = again >= 1 / HOLD
            for row, name in enumerate(ids):
                held = self._held.get(name)
                if holds[row] and held is not None and (allowed is None or allowed[row, held]):
                    modes[row] = held
            self._held = dict(zip(ids, modes.tolist(), strict=True))  # who is gone is forgotten
        return modes


class PolicySelector:
    """Chooses the modes by the bundle's trained policy, which looks at the image (paper, section 3.4).

    With `sample` each mode is drawn anew at every call, by a generator seeded with `seed`: so it was trained. Otherwise
    the most probable mode is taken. Raises InputError where the bundle has no trained policy.
    """

    needs_image = True

    def __init__(self, bundle: ModelBundle, seed: int, *, sample: bool) -> None:
        if bundle.policy is None:
            raise InputError(
                f"bundle {bundle.name}: it has no trained selector; use --selector prior, or train one with "
                "`slrl-sumo train`"
            )
        self._policy, self._prior = bundle.policy, bundle.prior
        self.looks_ahead, self.preset = bundle.policy.config.lookahead, bundle.policy.config.preset
        self._sample = sample
        self._random = np.random.default_rng(seed)

    def choose(
        self, observation: Observation, ids: Sequence[str] | None = None, allowed: NDArray[np.bool_] | None = None
    ) -> Modes:
        """See Selector."""
        if observation.image is None:
            raise ValueError("this selector needs observations with images")
        if observation.ahead is None and self.looks_ahead:
            raise ValueError("this selector needs observations that look ahead")
        with torch.inference_mode():
            vector, kind = tensors(observation)
            image = torch.from_numpy(observation.image)
            ahead, route = self._known(observation)
            logits = choice_logits(self._policy, self._prior, vector, image, kind, ahead, route)
            if allowed is not None:
                logits = torch.log_softmax(logits.masked_fill(torch.from_numpy(~allowed), -torch.inf), -1)
        if not self._sample:
            return np.asarray(logits.argmax(-1).numpy(), np.int64)
        return drawn(logits.double().exp().numpy(), self._random.random(len(observation)))

    def _known(self, observation: Observation) -> tuple[Tensor | None, Tensor | None]:
        """What the policy is told of modes and routes; without routes (recordings) those columns are zero."""
        config, n = self._policy.config, len(observation)
        ahead = route = None
        if observation.ahead is not None:
            ahead = torch.from_numpy(observation.ahead)
            ahead = torch.nn.functional.pad(ahead, (0, config.ahead_columns - ahead.shape[-1]))
        if config.route_columns:
            given = observation.route
            route = torch.zeros(n, config.route_columns) if given is None else torch.from_numpy(given)
        return ahead, route


def drawn(probability: Floats, draw: Floats) -> Modes:
    """Modes (n,) with these probabilities (n, modes), for draws (n,) from [0, 1)."""
    # The last sum may be a hair below 1: between it and 1 may lie modes that are not allowed.
    summed = probability.cumsum(-1)
    return np.asarray(((draw * summed[:, -1])[:, None] >= summed[:, :-1]).sum(-1), np.int64)


def central(bundle: ModelBundle, probability: Tensor, kind: Tensor, allowed: NDArray[np.bool_] | None = None) -> Modes:
    """The modes (n,) whose destinations are on average nearest to those that `probability` (n, modes) expects.

    Of many modes side by side none is probable, and the most probable one may be an outlier: this one errs least.
    `kind`: (n,) int64 types; `allowed` (n, modes): only these are taken.
    """
    centres = torch.from_numpy(bundle.mode_centres)
    distance = torch.cdist(centres, centres)
    expected = torch.zeros_like(probability)
    for t in range(len(centres)):
        expected[kind == t] = probability[kind == t] @ distance[t]
    if allowed is not None:
        expected[torch.from_numpy(~allowed)] = torch.inf
    return np.asarray(expected.argmin(-1).numpy(), np.int64)
