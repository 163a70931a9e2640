from dataclasses import replace

import pytest

from slrl_sumo.agent.make_driver import usual_selector
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.bundle_folder import usual_selector_of


@pytest.mark.parametrize("name", ["intersection", "shared-space", "intersection-paper", "shared-space-paper"])
def test_the_usual_selector_is_the_trained_one(name: str) -> None:
    bundle = load_bundle(name)
    assert usual_selector(bundle) == usual_selector_of(name) == "greedy"
    assert usual_selector(replace(bundle, policy=None, policy_training=None)) == "rule"
