"""The keywords that RoadUserEnv, the parallel environment and the vector environment share."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, TypeVar, Unpack, get_args

from gymnasium import spaces

from slrl_sumo.agent.make_driver import make_selector, usual_selector
from slrl_sumo.errors import InputError, check_type, check_whole_number, suggestion
from slrl_sumo.learning.environments.arena import EPISODE_STEPS, ArenaSettings
from slrl_sumo.learning.environments.observations import ObserveFunction, OwnObservation
from slrl_sumo.learning.environments.source import ArenaSource, is_family
from slrl_sumo.learning.rewards.terms import RewardWeights
from slrl_sumo.learning.rewards.transition import RewardFunction
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.simulation.excluded import Excluded, parse_excluded
from slrl_sumo.simulation.shares import Shares, parse_mix, served_shares
from slrl_sumo.sumo.scenario import find_scenario

Function = TypeVar("Function", RewardFunction, ObserveFunction)
Others = Literal["prior", "rule", "greedy", "sampled"]

TRIP_STEPS = 1500
"""Decisions (10 min) after which an episode with a takeover is truncated."""
MOST_AGENTS, MOST_STEPS, LONGEST_WARM_UP = 10_000, 1_000_000, 86_400.0
RESET_OPTIONS = ("scenario",)
"""Options of a reset."""
FOREIGN_OPTIONS = ("options",)
"""Options of a reset that PettingZoo's parallel_api_test passes to each environment; they have no effect."""


class EnvOptions(TypedDict, total=False):
    """Keywords of all environments; see RoadUserEnv for their meaning."""

    takeover: Shares | None
    mix: Shares | None
    exclude: Excluded
    bundle: str | Path
    preset: str | None
    image: bool | None
    weights: RewardWeights | None
    reward: RewardFunction | None
    observe: ObserveFunction | None
    observation_space: spaces.Space[Any] | None
    episode_steps: int | None
    warm_up: float


def make_source(scenario: str | Path, agents: int, others: str | None, **options: Unpack[EnvOptions]) -> ArenaSource:
    """The source for the keywords of an environment, see RoadUserEnv. Raises InputError."""
    check_type("scenario", scenario, (str, Path), "the name, folder or .sumocfg of a scenario")
    named = options.get("bundle", DEFAULT_BUNDLE)
    check_type("bundle", named, (str, Path), "the name or the folder of a bundle")
    where, bundle = str(scenario), load_bundle(named)
    takeover, mix = options.get("takeover"), options.get("mix")
    if not is_family(where):
        find_scenario(where)
    preset = options.get("preset") or _usual_preset(bundle)
    check_known("preset", preset, tuple(PRESETS))
    image = options.get("image")
    if image is None:
        image = preset == "image" or (bundle.policy is not None and bundle.policy.config.image)
    steps = options.get("episode_steps")
    if steps is None:
        steps = EPISODE_STEPS if takeover is None else TRIP_STEPS
    warm_up = options.get("warm_up", 60.0)
    check_whole_number("agents", agents, 1, MOST_AGENTS)
    check_whole_number("episode_steps", steps, 1, MOST_STEPS)
    if isinstance(warm_up, bool) or not isinstance(warm_up, Real) or not 0.0 <= warm_up <= LONGEST_WARM_UP:
        raise InputError(f"give a number from 0 to {LONGEST_WARM_UP:g}", argument="warm_up", value=warm_up)
    if takeover is not None and mix is not None:
        raise InputError("leave one of `takeover` and `mix` out: road users that are taken over have their types")
    settings = ArenaSettings(
        agents=agents,
        mix=None if mix is None else _three(parse_mix(mix)),
        weights=_checked_weights(options.get("weights")),
        episode_steps=steps,
        warm_up=warm_up,
        preset=preset,
        image=image,
        state=vector_for(bundle.config.preset, preset),
        trips=takeover is not None,
        takeover=None if takeover is None else _three(served_shares(takeover, bundle)),
    )
    return ArenaSource(
        (where,),
        str(named),
        settings,
        _checked_others(others, bundle, preset),
        _own_observation(options.get("observe"), options.get("observation_space")),
        _checked_function("reward", options.get("reward")),
        parse_excluded(options.get("exclude", ())),
    )


def check_keywords(given: Mapping[str, object], *own: str) -> None:
    """Raise InputError for a keyword that is neither in EnvOptions nor among the environment's `own` keywords."""
    known = (*own, *EnvOptions.__annotations__)
    for name in given:
        if name not in known:
            raise InputError(f"there is no keyword '{name}'{suggestion(name, known)}")


def scenario_wanted(options: Mapping[str, object] | None) -> str | None:
    """The scenario in the options of a reset; None without one. Raises InputError for other options."""
    given = options or {}
    for name in given:
        if name not in (*RESET_OPTIONS, *FOREIGN_OPTIONS):
            raise InputError(f"reset: there is no option '{name}'{suggestion(name, RESET_OPTIONS)}")
    wanted = given.get("scenario")
    return None if wanted is None else str(wanted)


def check_known(name: str, value: str | None, known: tuple[str | None, ...]) -> None:
    """Raise InputError if `value` is not among the `known` values."""
    if value not in known:
        raise InputError(f"there is none of that name; use {', '.join(map(repr, known))}", argument=name, value=value)


def _checked_others(others: str | None, bundle: ModelBundle, preset: str) -> str:
    check_known("others", others, (None, *get_args(Others)))
    if others is None:
        return usual_selector(bundle) if preset == _usual_preset(bundle) else "prior" if preset == "paper" else "rule"
    sees = make_selector(others, bundle, 0).preset  # fails now where there is none
    if others != "prior" and sees != preset:
        raise InputError(
            f"it sees the preset {sees!r}; give `preset={sees!r}` or others", argument="others", value=others
        )
    return others


def _checked_weights(weights: RewardWeights | None) -> RewardWeights:
    check_type("weights", weights, (RewardWeights, type(None)), "RewardWeights, as RewardWeights(close=1.0)")
    weights = weights or RewardWeights()
    for name, value in asdict(weights).items():
        if not math.isfinite(value):
            raise InputError(f"{name} is {value}; give finite numbers", argument="weights")
    return weights


def _checked_function(name: str, function: Function | None) -> Function | None:
    if function is not None and not callable(function):
        raise InputError("give a function", argument=name, value=function)
    return function


def _usual_preset(bundle: ModelBundle) -> str:
    """The preset of the bundle's policy; without a policy the preset of the selector `rule`."""
    return "extended" if bundle.policy is None else bundle.policy.config.preset


def _own_observation(observe: ObserveFunction | None, space: spaces.Space[Any] | None) -> OwnObservation | None:
    if (observe is None) != (space is None):
        raise InputError("give `observe` and `observation_space` together, or leave both out")
    _checked_function("observe", observe)
    return None if observe is None or space is None else OwnObservation(observe, space)


def _three(shares: Floats) -> tuple[float, float, float]:
    car, bicycle, pedestrian = shares.tolist()
    return car, bicycle, pedestrian
