"""The selector `mixed`: vehicles as `greedy`, pedestrians as `rule`."""

import numpy as np
import pytest

from slrl_sumo.agent.driver import make_selector
from slrl_sumo.agent.mixed_selector import MixedSelector
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.agent.selection import Modes
from slrl_sumo.agent.selectors import PolicySelector
from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings


def test_vehicles_choose_as_trained_and_pedestrians_as_the_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    differ = {True: 0, False: 0}
    choose = MixedSelector.choose

    def compared(self: MixedSelector, observation, rollouts, ids=None, masks=()) -> list[Modes]:  # type: ignore[no-untyped-def]
        chosen = choose(self, observation, rollouts, ids, masks)
        walks = observation.type == RoadUserType.PEDESTRIAN
        trained: list[Modes] = self._trained.choose(observation, rollouts, ids, masks)
        rule: list[Modes] = self._rule.choose(observation, rollouts, ids, masks)
        assert len(chosen) == 1 + len(masks)
        for mixed, first, second in zip(chosen, trained, rule, strict=True):
            np.testing.assert_array_equal(mixed, np.where(walks, second, first))
            for walking in (True, False):
                differ[walking] += int(np.sum((first != second)[walks == walking]))
        return chosen

    monkeypatch.setattr(MixedSelector, "choose", compared)
    settings = RunSettings("intersection", agents=20, mix="car=0.4,bicycle=0.2,pedestrian=0.4", steps=20)
    assert len(list(run(settings))) > 20
    # Otherwise nothing would have been tested.
    assert min(differ.values()) > 0


def test_it_is_made_by_name_and_needs_a_trained_selector_that_reads_routes() -> None:
    made = make_selector("mixed", load_bundle("intersection"), 1)
    assert isinstance(made, MixedSelector)
    assert isinstance(made._trained, PolicySelector)
    assert isinstance(made._rule, RuleSelector)
    with pytest.raises(InputError, match="its selector reads no routes; use `selector='greedy'`"):
        make_selector("mixed", load_bundle("intersection-paper"), 1)
