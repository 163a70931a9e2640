"""The keywords that RoadUserEnv, the parallel environment and the vector environment share."""

from typing import Any, Literal, TypedDict, Unpack, get_args

from gymnasium import spaces

from slrl_sumo.agent.driver import make_selector, usual_selector
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import EPISODE_STEPS, ArenaSettings
from slrl_sumo.learning.environments.observations import ObserveFunction, OwnObservation
from slrl_sumo.learning.environments.source import ArenaSource, is_family
from slrl_sumo.learning.rewards.terms import RewardWeights
from slrl_sumo.learning.rewards.transition import RewardFunction
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.simulation.shares import Shares, parse_mix, served_shares
from slrl_sumo.sumo.scenario import find_scenario

Others = Literal["prior", "rule", "greedy", "sampled"]

TRIP_STEPS = 1500
"""Decisions (10 min) after which an episode with a takeover is truncated."""


class EnvOptions(TypedDict, total=False):
    """Keywords of all environments; see RoadUserEnv for their meaning."""

    takeover: Shares | None
    mix: Shares | None
    bundle: str
    preset: str | None
    image: bool | None
    weights: RewardWeights | None
    reward: RewardFunction | None
    observe: ObserveFunction | None
    observation_space: spaces.Space[Any] | None
    episode_steps: int | None
    warm_up: float


def make_source(scenario: str, agents: int, others: str | None, **options: Unpack[EnvOptions]) -> ArenaSource:
    """What the keywords of an environment ask for: see RoadUserEnv. Raises InputError."""
    bundle = load_bundle(options.get("bundle", "intersection"))
    takeover, mix = options.get("takeover"), options.get("mix")
    if not is_family(scenario):
        find_scenario(scenario)
    preset = options.get("preset") or _usual_preset(bundle)
    check_known("preset", preset, tuple(PRESETS))
    image = options.get("image")
    if image is None:
        image = bundle.policy is not None and bundle.policy.config.image
    steps = options.get("episode_steps")
    if steps is None:
        steps = EPISODE_STEPS if takeover is None else TRIP_STEPS
    warm_up = options.get("warm_up", 60.0)
    for name, value, least in (("agents", agents, 1), ("episode_steps", steps, 1), ("warm_up", warm_up, 0)):
        if value < least:
            raise InputError(f"give a number from {least}", argument=name, value=value)
    if takeover is not None and mix is not None:
        raise InputError("leave one of `takeover` and `mix` out: road users that are taken over have their types")
    settings = ArenaSettings(
        agents=agents,
        mix=None if mix is None else _three(parse_mix(mix)),
        weights=options.get("weights") or RewardWeights(),
        episode_steps=steps,
        warm_up=warm_up,
        preset=preset,
        image=image,
        state=vector_for(bundle.config.preset, preset),
        trips=takeover is not None,
        takeover=None if takeover is None else _three(served_shares(takeover, bundle)),
    )
    return ArenaSource(
        (scenario,),
        options.get("bundle", "intersection"),
        settings,
        _checked_others(others, bundle, preset),
        _own_observation(options.get("observe"), options.get("observation_space")),
        options.get("reward"),
    )


def check_known(name: str, value: str | None, known: tuple[str | None, ...]) -> None:
    """Raise InputError where `value` is none of the `known` ones."""
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


def _usual_preset(bundle: ModelBundle) -> str:
    """The preset of the bundle's selector; without one that of the selector `rule`."""
    return "extended" if bundle.policy is None else bundle.policy.config.preset


def _own_observation(observe: ObserveFunction | None, space: spaces.Space[Any] | None) -> OwnObservation | None:
    if (observe is None) != (space is None):
        raise InputError("give `observe` and `observation_space` together, or leave both out")
    return None if observe is None or space is None else OwnObservation(observe, space)


def _three(shares: Floats) -> tuple[float, float, float]:
    car, bicycle, pedestrian = shares.tolist()
    return car, bicycle, pedestrian
