"""The policy in the folder of a bundle, read without PyTorch.

selector.json          its shapes (PolicyConfig) and the record of its training
selector.safetensors   its weights
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import read_json
from slrl_sumo.models.bundle_folder import POLICY_FILES
from slrl_sumo.models.motion_models import Singles, Weights
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.models.policy_network import PolicyNetwork
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.scene.types import RoadUserType


class PolicyFiles(NamedTuple):
    """What a bundle's folder says of its policy."""

    config: PolicyConfig
    weights: Weights
    training: dict[str, Any]
    without_route: Singles
    """(3, 2), see Policy."""


@contextmanager
def damage_reported(folder: Path) -> Iterator[None]:
    """What goes wrong inside is an InputError that says that the policy of the bundle `folder` is damaged."""
    try:
        yield
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, SafetensorError) as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())[:300]
        raise InputError(
            f"bundle {folder}: its selector is damaged ({reason}); copy the bundle again, or train it anew"
        ) from error


def read_policy_files(folder: Path, modes: int) -> PolicyFiles | None:
    """The policy's files of a bundle's folder with `modes` modes; None where it has none. The shapes of the weights are
    not compared with those of the configuration. Raises InputError where they are damaged or not for this version."""
    there = [(folder / name).is_file() for name in POLICY_FILES]
    if not any(there):
        return None
    if not all(there):
        missing = POLICY_FILES[there.index(False)]
        raise InputError(f"bundle {folder}: its selector is damaged ({missing} missing); copy the bundle again")
    with damage_reported(folder):
        values = read_json(folder / POLICY_FILES[0])
        training = dict(values.pop("training"))
        shapes: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        config = PolicyConfig(**shapes)
        if config.preset not in PRESETS:
            *others, last = PRESETS
            raise InputError(
                f"bundle {folder}: its selector reads preset '{config.preset}', this slrl_sumo runs "
                f"{', '.join(others)} and {last}"
            )
        if config.modes != modes:
            raise ValueError(f"it chooses among {config.modes} modes, the bundle has {modes}")
        sizes = [config.hidden, config.head, *config.channels]
        if len(sizes) > 16 or not all(type(size) is int and 0 < size <= 65536 for size in sizes):
            raise ValueError("its sizes are impossible")
        weights = load_file(folder / POLICY_FILES[1])
        types = len(RoadUserType)
        without_route = np.array(training.get("without_route", np.ones((types, 2))), np.float32)
        expected_route = np.array(training.get("expected_route", np.zeros((types, 2))), np.float32)
        if without_route.shape != (types, 2) or expected_route.shape != (types, 2):
            raise ValueError("without_route or expected_route")
        if not all(bool(np.isfinite(value).all()) for value in (*weights.values(), without_route, expected_route)):
            raise ValueError("weights that are not finite")
    return PolicyFiles(config, weights, training, without_route)


def read_network(folder: Path, files: PolicyFiles) -> PolicyNetwork:
    """The network of the files in `folder` of a policy without image. Raises InputError where they do not fit."""
    with damage_reported(folder):
        expected, found = _shapes(files.config), {name: value.shape for name, value in files.weights.items()}
        if odd := sorted(expected.items() ^ found.items()):
            raise ValueError(f"{odd[0][0]} is {found.get(odd[0][0])} instead of {expected.get(odd[0][0])}")
    return PolicyNetwork.of(files.config, files.weights, files.without_route)


def _shapes(config: PolicyConfig) -> dict[str, tuple[int, ...]]:
    """Of the weights of a policy without image, by their names; nothing is allocated."""
    layers = {"trunk.0": (config.hidden, config.inputs)}
    for one in range(len(RoadUserType)):
        layers |= {f"actors.{one}.0": (config.head, config.hidden), f"actors.{one}.2": (config.modes, config.head)}
        layers |= {f"critics.{one}.0": (config.head, config.hidden), f"critics.{one}.2": (1, config.head)}
        if config.looks_ahead:
            inner = (config.scorer_hidden, config.scorer_inputs)
            layers |= {f"scorers.{one}.0": inner, f"scorers.{one}.2": (1, config.scorer_hidden)}
    shapes: dict[str, tuple[int, ...]] = {f"{name}.weight": shape for name, shape in layers.items()}
    return shapes | {f"{name}.bias": shape[:1] for name, shape in layers.items()}
