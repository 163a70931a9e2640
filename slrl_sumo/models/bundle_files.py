"""Reading and checking of the files of a bundle's folder; slrl_sumo.models.bundle lists the files."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import read_json, read_text
from slrl_sumo.models.bundle_config import BundleConfig
from slrl_sumo.scene.types import RoadUserType

_Kind = tuple[tuple[int, ...], np.dtype[Any]]

BOUNDS = {
    "displacement.acceleration_bounds": 100.0,
    "displacement.yaw_rate_bounds": 100.0,
    "displacement.max_curvature": 100.0,
    "displacement.max_speed": 200.0,
    "mode_centres": 1e4,
}
"""Highest possible absolute values of tensors with units: m/s², rad/s, 1/m, m/s, m."""


def read_card(file: Path) -> str:
    """The text of the model card. Raises InputError if it is damaged."""
    try:
        return read_text(file)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise InputError(f"bundle {file.parent}: {file.name} is damaged ({reason}); copy the bundle again") from error


def read_object(file: Path) -> dict[str, Any]:
    """The JSON object in a file of a bundle. Raises InputError if it is damaged."""
    try:
        values = read_json(file)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise InputError(f"bundle {file.parent}: {file.name} is damaged ({reason}); copy the bundle again") from error
    if not isinstance(values, dict):
        raise InputError(f"bundle {file.parent}: {file.name} is damaged (no JSON object); copy the bundle again")
    return values


def read_training(file: Path) -> dict[str, Any]:
    """The record of the training, with a check of the numbers on which decisions depend. Raises InputError if it is
    damaged."""
    training = read_object(file)
    types = training.get("types", {})
    records = types.values() if isinstance(types, dict) else ()
    for record in records:
        value = record.get("hardest_braking_mps2", 0.0) if isinstance(record, dict) else 0.0
        if type(value) not in (int, float) or not -BOUNDS["displacement.acceleration_bounds"] <= value <= 0.0:
            raise InputError(
                f"bundle {file.parent}: {file.name} is damaged (hardest_braking_mps2 is {value!r}); copy the bundle "
                "again"
            )
    return training


def read_weights(folder: Path, config: BundleConfig) -> dict[str, NDArray[Any]]:
    """All tensors of the bundle, with a check of names, shapes, kinds, and finite and possible values.

    Raises InputError if the check fails.
    """
    expected = _expected(config)
    damaged = f"bundle {folder}: weights.safetensors is damaged"
    try:
        state: dict[str, NDArray[Any]] = load_file(folder / "weights.safetensors")
    except (OSError, SafetensorError, KeyError) as error:
        raise InputError(f"{damaged} ({error}); copy the bundle again") from error
    for key in sorted(set(expected) | set(state)):
        if key not in expected or key not in state:
            raise InputError(f"{damaged} ({key} {'missing' if key in expected else 'unknown'}); copy the bundle again")
        value, wanted = state[key], expected[key]
        if (value.shape, value.dtype) != wanted:
            found, due = f"{value.shape} {value.dtype}", f"{wanted[0]} {wanted[1]}"
            raise InputError(f"{damaged} ({key} is {found} instead of {due}); copy the bundle again")
        if not np.isfinite(value).all():
            raise InputError(f"{damaged} ({key} is not finite); copy the bundle again")
        if key in BOUNDS and float(np.abs(value).max()) > BOUNDS[key]:
            raise InputError(f"{damaged} ({key} is above {BOUNDS[key]:g}); copy the bundle again")
    return state


def _expected(config: BundleConfig) -> dict[str, _Kind]:
    """Shape and kind of each tensor of a bundle, by name.

    Nothing is allocated, because a configuration can describe gigabytes that the file does not contain.
    """
    types, inputs, single = len(RoadUserType), len(config.features), np.dtype(np.float32)
    shapes: dict[str, tuple[int, ...]] = {}
    for name, members, hidden, outputs in (
        ("displacement", config.modes, config.displacement_hidden, 2),
        ("prior", 1, config.prior_hidden, config.modes),
    ):
        for layer, (a, b) in enumerate(pairwise((inputs, *hidden, outputs))):
            shapes[f"{name}.networks.weight.{layer}"] = types, members, a, b
            shapes[f"{name}.networks.bias.{layer}"] = types, members, 1, b
        shapes[f"{name}.networks.mean"] = shapes[f"{name}.networks.scale"] = types, inputs
    for bounds in ("acceleration_bounds", "yaw_rate_bounds"):
        shapes[f"displacement.{bounds}"] = types, 2
    for limit in ("max_curvature", "max_speed"):
        shapes[f"displacement.{limit}"] = (types,)
    expected: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {
        name: (shape, single) for name, shape in shapes.items()
    }
    expected["mode_centres"] = (types, config.modes, 2), np.dtype(np.float64)
    expected["mode_counts"] = (types, config.modes), np.dtype(np.int64)
    return expected
