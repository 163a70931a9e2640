"""The settings of a training, and the TOML file that changes them."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from slrl_sumo.agent.mode_cost import CostWeights
from slrl_sumo.errors import InputError, suggestion
from slrl_sumo.input_files import read_toml
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.options import LONGEST_WARM_UP, MOST_AGENTS, MOST_STEPS
from slrl_sumo.learning.rewards.terms import TERMS, RewardWeights
from slrl_sumo.learning.rl.imitation import ImitationSettings
from slrl_sumo.learning.rl.ppo import PpoSettings
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.scene.types import TYPE_NAMES

Section = TypeVar("Section")


@dataclass(frozen=True)
class NetworkSettings:
    """Generated scenarios of the training."""

    count: int = 24
    """Number of scenarios drawn from each family; each worker opens another scenario every `reset_every` updates."""
    first_seed: int = 9000
    """Seed of the first scenario: shipped bundles were fitted to networks with other seeds."""
    reset_every: int = 4
    """Number of updates after which all simulations restart and a checkpoint is saved."""


@dataclass(frozen=True)
class TrainSettings:
    """All settings that determine the training of a selector, except scenarios, bundle, steps, workers and seed."""

    ppo: PpoSettings = field(default_factory=PpoSettings)
    reward: RewardWeights = field(default_factory=RewardWeights)
    teacher: CostWeights = field(default_factory=CostWeights)
    arena: ArenaSettings = field(default_factory=lambda: ArenaSettings(staggered=True))
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    networks: NetworkSettings = field(default_factory=NetworkSettings)
    imitation: ImitationSettings = field(default_factory=ImitationSettings)


NOT_FOR_USERS = {"arena": {"weights", "teacher", "preset", "image", "state", "takeover"}, "policy": {"modes"}}
"""Fields that are set elsewhere: weights by [reward] and [teacher], observations by [policy], modes by the bundle."""

RANGES = {
    ("ppo", "num_steps"): (1, 100_000),
    ("ppo", "num_minibatches"): (1, 100_000),
    ("ppo", "update_epochs"): (1, 1000),
    ("ppo", "learning_rate"): (0.0, 1.0),
    ("ppo", "gamma"): (0.0, 1.0),
    ("ppo", "gae_lambda"): (0.0, 1.0),
    ("ppo", "clip_coef"): (0.001, 1.0),
    ("ppo", "ent_coef"): (0.0, 100.0),
    ("ppo", "vf_coef"): (0.0, 100.0),
    ("ppo", "max_grad_norm"): (0.001, 1e6),
    ("ppo", "explore"): (0.0, 0.9),
    ("ppo", "kl_coef"): (0.0, 1000.0),
    ("ppo", "kl_coef_last"): (0.0, 1000.0),
    ("ppo", "kl_until"): (0.0, 1.0),
    ("ppo", "prior_coef"): (0.0, 1000.0),
    ("ppo", "teacher_first"): (0, 1_000_000),
    **{("reward", name): (0.0, 1e6) for name in TERMS},
    **{("teacher", weight.name): (0.0, 1e6) for weight in fields(CostWeights)},
    ("arena", "agents"): (1, MOST_AGENTS),
    ("arena", "mix"): (0.0, 1000.0),
    ("arena", "desired_speed"): (0.1, 50.0),
    ("arena", "episode_steps"): (1, MOST_STEPS),
    ("arena", "warm_up"): (0.0, LONGEST_WARM_UP),
    ("policy", "channels"): (1, 4096),
    ("policy", "hidden"): (1, 4096),
    ("policy", "head"): (1, 4096),
    ("imitation", "epochs"): (0, 10_000),
    ("imitation", "stride"): (1, 10_000),
    ("imitation", "batch"): (1, 1_000_000),
    ("imitation", "seconds"): (1.0, 1e6),
    ("imitation", "learning_rate"): (0.0, 1.0),
    ("networks", "count"): (1, 10_000),
    ("networks", "first_seed"): (0, 2**31 - 20_000),
    ("networks", "reset_every"): (1, 1_000_000),
}
"""Lowest and highest values of all numbers: other values fail during a training, or give a useless selector."""
MOST_CHANNELS = 14
"""Greatest number of convolutions of a selector: bundles with more cannot be read."""

NAMES = {("policy", "preset"): tuple(PRESETS), ("ppo", "only"): TYPE_NAMES, ("ppo", "kl_kept"): TYPE_NAMES}
"""Valid names of the settings that are not numbers."""


def recorded_settings(bundle: ModelBundle) -> TrainSettings:
    """The recorded settings with which the selector of a bundle was trained; defaults for missing values.

    Raises InputError for values that are also invalid in a TOML file.
    """
    settings, record = TrainSettings(), (bundle.policy_training or {}).get("settings", {})
    for name in (f.name for f in fields(TrainSettings)):
        section = getattr(settings, name)
        known = get_type_hints(type(section)).keys() - NOT_FOR_USERS.get(name, set())
        given = {key: value for key, value in record.get(name, {}).items() if key in known and value is not None}
        where = f"the selector of bundle {bundle.name}: [{name}]"
        settings = replace(settings, **{name: _changed(name, section, given, where)})
    return settings


def read_settings(file: Path | None, settings: TrainSettings | None = None) -> TrainSettings:
    """The settings of a TOML file; missing keys, and all keys without a file, come from `settings` or the defaults.

    Sections are the fields of TrainSettings, keys the fields of their classes. Raises InputError for an unknown section
    or key, with the nearest known name, and for values of a wrong type or outside RANGES.
    """
    settings = settings or TrainSettings()
    if file is None:
        return settings
    try:
        values = read_toml(file)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror or error}); name another `config`") from None
    except ValueError as error:
        raise InputError(f"{file}: is no TOML ({error})") from None
    sections = [f.name for f in fields(TrainSettings)]
    for name, given in values.items():
        if name not in sections or not isinstance(given, dict):
            raise InputError(f"{file}: there is no section [{name}]{suggestion(name, sections)}")
        settings = replace(settings, **{name: _changed(name, getattr(settings, name), given, f"{file}: [{name}]")})
    return settings


def _changed(name: str, section: Section, given: dict[str, Any], where: str) -> Section:
    """`section` (a dataclass) with the `given` values."""
    types = get_type_hints(type(section))
    known = [key for key in types if key not in NOT_FOR_USERS.get(name, ())]
    values: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            raise InputError(f"{where} has no setting '{key}'{suggestion(key, known)}")
        values[key] = _converted(value, types[key], f"{where} {key}", NAMES.get((name, key), ()))
        if (name, key) in RANGES:
            _check_range(values[key], RANGES[name, key], f"{where} {key}")
    if len(values.get("channels", ())) > MOST_CHANNELS:
        raise InputError(f"{where} channels has {len(values['channels'])} numbers: give at most {MOST_CHANNELS}")
    if "mix" in values and not any(values["mix"]):
        raise InputError(f"{where} mix is all zeros: give at least one type a share above 0")
    return replace(section, **values)  # type: ignore[type-var]


def _check_range(value: float | tuple[float, ...], allowed: tuple[float, float], where: str) -> None:
    low, high = allowed
    for number in value if isinstance(value, tuple) else (value,):
        if not low <= number <= high:  # nor is NaN
            raise InputError(f"{where} is {number:g}: give a number from {low:g} to {high:g}")


def _converted(value: Any, type_: Any, where: str, names: tuple[str, ...]) -> Any:
    """`value` of a TOML file as a field of type `type_`: str (one of `names`), bool, int, float, or a tuple of numbers
    or names, or None."""
    if type_ is str:
        if value not in names:
            raise InputError(f"{where} is {value!r}: give {' or '.join(names)}")
        return value
    if type_ in (bool, int, float):
        if isinstance(value, bool) != (type_ is bool) or not isinstance(value, int if type_ is int else int | float):
            wanted = {bool: "true or false", int: "a whole number", float: "a number"}[type_]
            raise InputError(f"{where} is {value!r}: give {wanted}")
        return type_(value)
    tuple_type = next(option for option in (type_, *get_args(type_)) if get_origin(option) is tuple)
    element, *more = get_args(tuple_type)
    length = None if Ellipsis in more else 1 + len(more)
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise InputError(
            f"{where} is {value!r}: give a list of {length or 'several'} {'names' if element is str else 'numbers'}"
        )
    return tuple(_converted(item, element, where, names) for item in value)
