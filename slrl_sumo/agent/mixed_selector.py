"""The selector `mixed`: vehicles as `greedy`, pedestrians as `rule`."""

from collections.abc import Hashable, Sequence

import numpy as np

from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.agent.selection import Mask, Modes
from slrl_sumo.agent.selectors import PolicySelector
from slrl_sumo.errors import InputError
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.types import RoadUserType


class MixedSelector:
    """Chooses modes of cars and bicycles by the bundle's trained policy, those of pedestrians by RuleSelector.

    Where the policy learned, pedestrians hardly ever met red (docs/measurements/training.md). Raises InputError where
    the bundle has no trained policy, or one that reads no routes.
    """

    needs_rollouts = True
    preset = "extended"

    def __init__(self, bundle: ModelBundle) -> None:
        self._trained, self._rule = PolicySelector(bundle), RuleSelector()
        self.needs_image = self._trained.needs_image
        if self._trained.preset != self.preset:
            raise InputError(f"bundle {bundle.name}: its selector reads no routes; use `selector='greedy'` or 'rule'")

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """See Selector."""
        walks = observation.type == RoadUserType.PEDESTRIAN
        trained, rule = (each.choose(observation, rollouts, ids, masks) for each in (self._trained, self._rule))
        return [np.where(walks, second, first) for first, second in zip(trained, rule, strict=True)]
