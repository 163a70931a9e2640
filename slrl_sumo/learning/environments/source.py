"""What an environment simulates."""

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
    """What is simulated: scenarios (as `slrl-sumo run` names them, or families of networks), a bundle (name or folder)
    and settings."""

    scenarios: tuple[str, ...]
    bundle: str
    settings: ArenaSettings
    others: str | None = None
    """Selector of the road users whose mode is not given (-1)."""
    observation: OwnObservation | None = None
    """An observation of one's own; None: that of the selectors."""
    reward: RewardFunction | None = None
    """A reward of one's own; None: the terms by `settings.weights`."""
    exclude: tuple[str, ...] = ()
    """Ids of road users that are neither taken over nor held for learned ones."""


def is_family(name: str) -> bool:
    """Whether a scenario is drawn anew for every simulation: the name of a family of networks, but of no scenario."""
    return name in get_args(Family) and name not in shipped_scenarios()


def found_scenario(name: str, seed: int, opened: ExitStack) -> Scenario:
    """The scenario of a name; of a family one drawn by `seed`, in a folder that is removed when `opened` is closed."""
    if not is_family(name):
        return find_scenario(name)
    folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="slrl_sumo_")))
    return find_scenario(str(generate(name, seed, folder / f"{name}-{seed}")))
