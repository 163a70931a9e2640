"""The interface of selectors, which choose a mode for each road user. Needs no PyTorch."""

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
"""Returns random numbers from [0, 1) in an array of the given shape, as numpy.random.Generator.random does."""


class Selector(Protocol):
    """Chooses modes. A selector belongs to one run, because it may have a state and a random generator."""

    needs_image: bool
    """Whether the selector reads `Observation.image`; if not, no image is drawn."""
    needs_rollouts: bool
    """Whether the selector reads the mode rollouts."""
    preset: str
    """Preset of its inputs, one of perception.presets.PRESETS."""

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """Modes of the observed road users, (n,) in 0..modes-1: first without a mask, then under each of the `masks`.

        The last array is the choice; differences between successive arrays show the changes by each mask. Each mask
        (n, modes) allows at least one mode per road user. `ids` (n,): ids of the road users.
        """
        ...


class GivenModes:
    """Selector for modes that are chosen elsewhere: by training, or by the user of an environment."""

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
    """Sample modes (n,) with the given probabilities (n, modes), from draws (n,) in [0, 1)."""
    # The last sum may be slightly below 1; a draw above it must not select a mode that is not allowed.
    summed = probability.cumsum(-1)
    return np.asarray(((draw * summed[:, -1])[:, None] >= summed[:, :-1]).sum(-1), np.int64)
