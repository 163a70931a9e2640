"""Selectors: what chooses a mode for each road user."""

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation


class Selector(Protocol):
    """Chooses modes. One selector belongs to one run: it may carry a random state from call to call."""

    needs_image: bool
    """Whether `choose` reads `Observation.image`; where it does not, no image needs to be drawn."""

    def choose(self, observation: Observation) -> NDArray[np.int64]:
        """The mode of each observed road user, (n,) in 0..modes-1."""
        ...


class PriorSelector:
    """Chooses the modes as people did in the recordings (the paper's supervised baseline, section 4.1).

    With `sample` each mode is drawn from the prior's distribution, by a generator of its own seeded with `seed`, one
    draw per road user and call; otherwise the most probable mode is taken and `seed` has no say.
    """

    needs_image = False

    def __init__(self, bundle: ModelBundle, seed: int, *, sample: bool = True) -> None:
        self._prior = bundle.prior
        self._sample = sample
        self._random = np.random.default_rng(seed)

    def choose(self, observation: Observation) -> NDArray[np.int64]:
        """The mode of each observed road user, (n,) in 0..modes-1."""
        with torch.inference_mode():
            logits = self._prior.logits(*tensors(observation)).double()
            if not self._sample:
                return np.asarray(logits.argmax(-1).numpy(), np.int64)
            cumulated = torch.softmax(logits, -1).cumsum(-1).numpy()
        # The last sum may be a hair below 1, so it is left out: what lies above all others is the last mode.
        draw = self._random.random(len(cumulated))[:, None]
        return np.asarray((draw >= cumulated[:, :-1]).sum(-1), np.int64)
