"""Selectors and drivers by name."""

import numpy as np

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.decide import Agent
from slrl_sumo.agent.driver import Driver
from slrl_sumo.agent.lane_baseline.lane_driver import LaneDriver
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.agent.selection import Selector
from slrl_sumo.agent.selectors import PolicySelector, PriorSelector
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.errors import InputError
from slrl_sumo.jobs.row_threads import RowThreads
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.routing.routes import Routes
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network

SELECTORS = ("prior", "rule", "greedy", "sampled", "lane")
"""`prior`: the bundle's mode classifier. `rule`: the mode of the least cost, without learning. `greedy` and `sampled`:
the most probable mode of the trained policy, or a mode sampled from it. `lane`: the baseline that follows lanes,
without models."""

TRAINED = ("greedy", "sampled")
"""Selectors that need the bundle's trained policy."""

GUARDED = "+guard"
"""Suffix of a selector's name in tables for runs with the guard."""


def unknown_selector(name: str) -> InputError:
    """The error for an unknown selector `name`."""
    return InputError(f"there is none of that name; use {' or '.join(SELECTORS)}", argument="selector", value=name)


def usual_selector(bundle: ModelBundle) -> str:
    """The selector where none is named: the trained one, or `rule` for a bundle without one."""
    return "rule" if bundle.policy is None and bundle.network is None else "greedy"


def make_selector(name: str, bundle: ModelBundle, seed: int) -> Selector:
    """The selector `prior`, `rule`, `greedy` or `sampled`.

    Raises InputError if the bundle has no trained policy for `greedy` or `sampled`.
    """
    if name == "rule":
        return RuleSelector()
    uniform = np.random.default_rng(seed).random
    if name == "prior":
        return PriorSelector(bundle, uniform)
    return PolicySelector(bundle, uniform if name == "sampled" else None)


def make_driver(
    selector: str,
    bundle: ModelBundle,
    api: SumoApi,
    network: Network,
    seed: int,
    *,
    constraints: Constraints | None = None,
    stopwatch: Stopwatch | None = None,
    threads: int = 1,
) -> Driver:
    """The driver of one of SELECTORS, in the simulation of `api`.

    `stopwatch` measures the parts of decisions. Road users are distributed over `threads` threads. Raises InputError
    for any other name, and for a guard with `lane`, which has no modes.
    """
    constraints = constraints or Constraints()
    if selector == "lane":
        if constraints.guard:
            raise InputError(
                "`selector='lane'` chooses no modes; leave the guard out, or take another selector", argument="guard"
            )
        return LaneDriver(api, network)
    if selector not in SELECTORS:
        raise unknown_selector(selector)
    chooser = make_selector(selector, bundle, seed)
    routes = Routes(api, network) if constraints.guard or PRESETS[chooser.preset].knows_route else None
    return ModelDriver(Agent(bundle, chooser, constraints, threads=RowThreads(threads)), routes, stopwatch=stopwatch)
