"""What a selector is: it chooses a mode for each road user. Needs no PyTorch."""

from collections.abc import Callable, Hashable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats

Modes = NDArray[np.int64]
Mask = NDArray[np.bool_]
Uniform = Callable[[tuple[int, ...]], Floats]
"""Gives an array of that shape of random numbers from [0, 1), as numpy.random.Generator.random."""


class Selector(Protocol):
    """Chooses modes. One selector belongs to one run: it may have a memory and a random state."""

    needs_image: bool
    """Whether it reads `Observation.image`; where it does not, no image is drawn."""
    needs_rollouts: bool
    """Whether it reads the mode rollouts."""
    preset: str
    """What it perceives, one of perception.presets.PRESETS."""

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """The mode of each observed road user, (n,) in 0..modes-1: without a mask, then under each of the `masks`.

        The last one is the choice; the others say what each mask has changed. `masks` (n, modes) allow at least one
        mode each; `ids` (n,) name the road users.
        """
        ...


class GivenModes:
    """Modes that are chosen elsewhere: by a training, or by the user of an environment."""

    needs_image = True
    needs_rollouts = True

    def __init__(self, preset: str) -> None:
        self.preset = preset
        self.modes: Modes = np.zeros(0, np.int64)
        """Modes of the next decision, (n,)."""

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """See Selector."""
        return [self.modes] * (1 + len(masks))


def drawn(probability: Floats, draw: Floats) -> Modes:
    """Modes (n,) with these probabilities (n, modes), for draws (n,) from [0, 1)."""
    # The last sum may be a hair below 1: between it and 1 may lie modes that are not allowed.
    summed = probability.cumsum(-1)
    return np.asarray(((draw * summed[:, -1])[:, None] >= summed[:, :-1]).sum(-1), np.int64)
