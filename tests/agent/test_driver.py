from dataclasses import replace

import pytest

from slrl_sumo.agent.make_driver import usual_selector
from slrl_sumo.models.bundle import load_bundle


@pytest.mark.parametrize(
    ("name", "selector"),
    [
        ("intersection", "greedy"),
        ("shared-space", "rule"),
        ("intersection-paper", "greedy"),
        ("shared-space-paper", "greedy"),
    ],
)
def test_the_usual_selector_is_the_policy_unless_its_bundle_names_another(name: str, selector: str) -> None:
    bundle = load_bundle(name)
    assert usual_selector(bundle) == selector
    assert usual_selector(replace(bundle, policy=None, policy_training=None)) == "rule"
