"""The source of an environment: scenarios, bundle and settings."""

import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.observations import OwnObservation
from slrl_sumo.learning.rewards.transition import RewardFunction
from slrl_sumo.netgen.families import Family, generate
from slrl_sumo.sumo.scenario import Scenario, find_scenario, shipped_scenarios


@dataclass(frozen=True)
class ArenaSource:
    """Scenarios (as for `slrl-sumo run`, or families of networks), a bundle (name or folder) and settings."""

    scenarios: tuple[str, ...]
    bundle: str
    settings: ArenaSettings
    others: str | None = None
    """Selector of the road users without a given mode (-1)."""
    observation: OwnObservation | None = None
    """The user's observation; None: the observation of the selectors."""
    reward: RewardFunction | None = None
    """The user's reward; None: the terms, weighted by `settings.weights`."""
    exclude: tuple[str, ...] = ()
    """Ids of road users that are neither taken over nor held for learned road users."""


def is_family(name: str) -> bool:
    """Whether `name` is a family of networks, drawn again for each simulation, and not a scenario."""
    return name in get_args(Family) and name not in shipped_scenarios()


def found_scenario(name: str, seed: int, opened: ExitStack) -> Scenario:
    """The scenario of this name; for a family a scenario drawn by `seed`, in a folder that `opened` removes on
    close."""
    if not is_family(name):
        return find_scenario(name)
    folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="slrl_sumo_")))
    return find_scenario(str(generate(name, seed, folder / f"{name}-{seed}")))
