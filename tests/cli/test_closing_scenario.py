"""Every family of generated networks has a shipped scenario that its selectors are measured in."""

from typing import get_args

import pytest

from slrl_sumo.cli.train_display import closing_scenario
from slrl_sumo.netgen.families import Family
from slrl_sumo.sumo.scenario import shipped_scenarios


@pytest.mark.parametrize("family", get_args(Family))
def test_a_selector_trained_in_a_family_is_measured_in_a_shipped_scenario(family: str) -> None:
    assert closing_scenario(f"{family}, somewhere-else") in shipped_scenarios()


def test_roundabouts_are_closed_at_the_intersection_and_scenarios_in_themselves() -> None:
    assert closing_scenario("roundabout,random") == "intersection"
    assert closing_scenario("my/folder") == "my/folder"
