"""The settings of a training, and the TOML file that changes them."""

import difflib
import tomllib
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from slrl_sumo.errors import InputError
from slrl_sumo.learning.rl.arena import ArenaSettings
from slrl_sumo.learning.rl.imitation import ImitationSettings
from slrl_sumo.learning.rl.ppo import PpoSettings
from slrl_sumo.learning.rl.rewards import RewardWeights
from slrl_sumo.learning.rl.teacher import TeacherWeights
from slrl_sumo.models.policy import PRESETS, PolicyConfig

Section = TypeVar("Section")


@dataclass(frozen=True)
class NetworkSettings:
    """Where episodes happen."""

    count: int = 24
    """Scenarios that are drawn from each family; a new one is opened in every worker every `reset_every` updates."""
    first_seed: int = 9000
    """Seed of the first of them: shipped bundles were fitted to networks with other seeds."""
    reset_every: int = 4
    """Updates until all simulations begin anew; also where a checkpoint can be taken."""


@dataclass(frozen=True)
class TrainSettings:
    """Everything that decides how a selector is trained, besides scenarios, bundle, steps, workers and seed."""

    ppo: PpoSettings = field(default_factory=PpoSettings)
    reward: RewardWeights = field(default_factory=RewardWeights)
    guidance: TeacherWeights = field(default_factory=TeacherWeights)
    arena: ArenaSettings = field(default_factory=lambda: ArenaSettings(staggered=True))
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    networks: NetworkSettings = field(default_factory=NetworkSettings)
    imitation: ImitationSettings = field(default_factory=ImitationSettings)


NOT_FOR_USERS = {"arena": {"weights", "guidance", "extended"}, "policy": {"modes"}}
"""Fields that are set elsewhere: weights by [reward] and [guidance], routes by the preset, modes by the bundle."""


def read_settings(file: Path | None) -> TrainSettings:
    """The settings of a TOML file, defaults where it is silent; None is all defaults.

    Sections are the fields of TrainSettings, keys those of their classes. Raises InputError for an unknown section or
    key, naming the nearest right one, and for values of a wrong kind.
    """
    settings = TrainSettings()
    if file is None:
        return settings
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); name another --config") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no TOML ({error})") from None
    sections = [f.name for f in fields(TrainSettings)]
    for name, given in values.items():
        if name not in sections or not isinstance(given, dict):
            raise InputError(f"{file}: there is no section [{name}]{_nearest(name, sections)}")
        section = _changed(getattr(settings, name), given, NOT_FOR_USERS.get(name, set()), f"{file}: [{name}]")
        settings = replace(settings, **{name: section})
    _check(settings, file)
    return settings


def _changed(section: Section, given: dict[str, Any], closed: set[str], where: str) -> Section:
    """`section` (a dataclass) with the `given` values; keys in `closed` count as unknown."""
    kinds = get_type_hints(type(section))
    known = [name for name in kinds if name not in closed]
    values: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            raise InputError(f"{where} has no setting '{key}'{_nearest(key, known)}")
        values[key] = _converted(value, kinds[key], f"{where} {key}")
    return replace(section, **values)  # type: ignore[type-var]


def _converted(value: Any, kind: Any, where: str) -> Any:
    """`value` as TOML has it, as a field of type `kind`: bool, int, float, or a tuple of numbers or None."""
    if kind is str:
        if value not in PRESETS:
            raise InputError(f"{where} is {value!r}: give {' or '.join(PRESETS)}")
        return value
    if kind in (bool, int, float):
        right = isinstance(value, bool) == (kind is bool) and isinstance(value, int if kind is int else int | float)
        if not right:
            raise InputError(f"{where} is {value!r}: give {_wanted(kind)}")
        return kind(value)
    shape = next(option for option in (kind, *get_args(kind)) if get_origin(option) is tuple)
    element, *more = get_args(shape)
    length = None if Ellipsis in more else 1 + len(more)
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise InputError(f"{where} is {value!r}: give a list of {length or 'several'} numbers")
    return tuple(_converted(item, element, where) for item in value)


def _wanted(kind: type) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number"}[kind]


def _nearest(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, 1, 0.5)
    return f"; did you mean '{close[0]}'?" if close else f"; there are {', '.join(known)}"


def _check(settings: TrainSettings, file: Path) -> None:
    """Ranges that would otherwise fail somewhere in the middle."""
    ppo, arena, networks = settings.ppo, settings.arena, settings.networks
    rules = (
        ("[ppo] num_steps", ppo.num_steps, 1, 100_000),
        ("[ppo] num_minibatches", ppo.num_minibatches, 1, 100_000),
        ("[ppo] update_epochs", ppo.update_epochs, 1, 1000),
        ("[ppo] learning_rate", ppo.learning_rate, 0.0, 1.0),
        ("[ppo] gamma", ppo.gamma, 0.0, 1.0),
        ("[ppo] gae_lambda", ppo.gae_lambda, 0.0, 1.0),
        ("[arena] agents", arena.agents, 1, 10_000),
        ("[arena] episode_steps", arena.episode_steps, 1, 1_000_000),
        ("[arena] warm_up", arena.warm_up, 0.0, 86_400.0),
        ("[imitation] epochs", settings.imitation.epochs, 0, 10_000),
        ("[imitation] stride", settings.imitation.stride, 1, 10_000),
        ("[imitation] batch", settings.imitation.batch, 1, 1_000_000),
        ("[imitation] seconds", settings.imitation.seconds, 1.0, 1e6),
        ("[networks] count", networks.count, 1, 10_000),
        ("[networks] first_seed", networks.first_seed, 0, 2**31 - 20_000),
        ("[networks] reset_every", networks.reset_every, 1, 1_000_000),
    )
    for name, value, low, high in rules:
        if not low <= value <= high:
            raise InputError(f"{file}: {name} is {value:g}: give a number from {low:g} to {high:g}")
