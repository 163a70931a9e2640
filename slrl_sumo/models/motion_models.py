"""The networks of decisions in compiled loops, without PyTorch, whose import takes longer than the rest of a start.

The result of each road user depends only on its own row, and the order of computation does not depend on other rows.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.features import FEATURES
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.types import DECISION_INTERVAL

MODES = 20
"""Number of modes per road user type (paper, section 3.2)."""
SPEED = FEATURES.index("speed")
INPUT_LIMIT = 5.0
"""Bound (standard deviations) to which inputs are clipped, because the networks have no data beyond it."""
BLOCK_ROWS = 32
"""Number of road users for which the outputs of a network are computed together: weights and inputs stay in the
cache."""
FEW_OUTPUTS = 8
"""Number of outputs from which a layer is computed for all outputs at once."""

Singles = NDArray[np.float32]
Weights = Mapping[str, NDArray[Any]]
"""Tensors by name, as in a bundle's file."""


class Networks(NamedTuple):
    """Arrays of stacked_networks.StackedNetworks."""

    mean: Singles
    scale: Singles
    weight: tuple[Singles, ...]
    bias: tuple[Singles, ...]


class MotionModels(NamedTuple):
    """Arrays of displacement.DisplacementModels."""

    networks: Networks
    acceleration_bounds: Singles
    yaw_rate_bounds: Singles
    max_curvature: Singles
    max_speed: Singles


def networks(weights: Weights, prefix: str) -> Networks:
    """The networks among `weights` whose names begin with `prefix`; nothing is copied."""
    of = f"{prefix}networks."
    layers = range(sum(name.startswith(f"{of}weight.") for name in weights))
    return Networks(
        weights[f"{of}mean"],
        weights[f"{of}scale"],
        tuple(weights[f"{of}weight.{number}"] for number in layers),
        tuple(weights[f"{of}bias.{number}"] for number in layers),
    )


def motion_models(weights: Weights, prefix: str = "") -> MotionModels:
    """The displacement models among `weights`, whose names begin with `prefix`; nothing is copied."""
    return MotionModels(networks(weights, prefix), *(weights[prefix + name] for name in MotionModels._fields[1:]))


def motions(models: MotionModels, vector: Singles, kind: NDArray[np.int64]) -> tuple[Singles, Singles]:
    """Acceleration (m/s²) and yaw rate (rad/s) of all modes, (n, modes) each.

    `vector`: (n, columns) feature vectors; `kind`: (n,) RoadUserType.
    """
    x = outputs(models.networks, vector, kind)
    return _bounded(np.tanh(x, out=x), vector[:, SPEED].copy(), kind, *models[1:], DECISION_INTERVAL)


def outputs(networks: Networks, vector: Singles, kind: NDArray[np.int64]) -> Singles:
    """Outputs (n, members, out) of all networks of each row's type, as from StackedNetworks.forward_all.

    The networks read the first columns of `vector`; a selector may read more columns.
    """
    read = np.ascontiguousarray(vector[:, : networks.mean.shape[1]])
    x = _standardised(read, kind, networks.mean, networks.scale)
    for number, (weight, bias) in enumerate(zip(networks.weight, networks.bias, strict=True)):
        # numpy's tanh takes a tenth of the time of a compiled tanh.
        x = layer(np.tanh(x, out=x) if number else x, kind, weight, bias)
    return x


@compiled
def _standardised(vector: Singles, kind: NDArray[np.int64], mean: Singles, scale: Singles) -> Singles:
    """Inputs of the networks, the same for all members: (n, 1, columns)."""
    n, columns = vector.shape
    result = np.empty((n, 1, columns), np.float32)
    for i in range(n):
        for k in range(columns):
            away = (vector[i, k] - mean[kind[i], k]) * scale[kind[i], k]
            result[i, 0, k] = min(max(away, np.float32(-INPUT_LIMIT)), np.float32(INPUT_LIMIT))
    return result


@compiled
def layer(x: Singles, kind: NDArray[np.int64], weight: Singles, bias: Singles) -> Singles:
    """Outputs (n, members, out) of one layer; `x`: (n, members or 1, in), `weight`: (types, members, in, out)."""
    n, columns, members, outputs = len(x), x.shape[2], weight.shape[1], weight.shape[3]
    result, out = np.empty((n, members, outputs), np.float32), np.empty(outputs, np.float32)
    for begin in range(0, n, BLOCK_ROWS):
        for member in range(members):
            mine = member if x.shape[1] > 1 else 0
            for i in range(begin, min(begin + BLOCK_ROWS, n)):
                one = kind[i]
                if outputs < FEW_OUTPUTS:
                    for j in range(outputs):
                        total = bias[one, member, 0, j]
                        for k in range(columns):
                            total += x[i, mine, k] * weight[one, member, k, j]
                        result[i, member, j] = total
                    continue
                for j in range(outputs):  # not out[:]: numba compiles numpy's messages on shapes for 4 s
                    out[j] = bias[one, member, 0, j]
                # Four inputs are added at once, so that outputs are loaded and stored a quarter as often.
                for k in range(0, columns - 3, 4):
                    a, b, c, d = x[i, mine, k], x[i, mine, k + 1], x[i, mine, k + 2], x[i, mine, k + 3]
                    of_a, of_b = weight[one, member, k], weight[one, member, k + 1]
                    of_c, of_d = weight[one, member, k + 2], weight[one, member, k + 3]
                    for j in range(outputs):
                        out[j] = (((out[j] + a * of_a[j]) + b * of_b[j]) + c * of_c[j]) + d * of_d[j]
                for k in range(columns - columns % 4, columns):
                    for j in range(outputs):
                        out[j] += x[i, mine, k] * weight[one, member, k, j]
                for j in range(outputs):
                    result[i, member, j] = out[j]
    return result


@compiled
def _bounded(
    unit: Singles,
    speed: Singles,
    kind: NDArray[np.int64],
    acceleration_bounds: Singles,
    yaw_rate_bounds: Singles,
    max_curvature: Singles,
    max_speed: Singles,
    dt: float,
) -> tuple[Singles, Singles]:
    """Accelerations and yaw rates from outputs between -1 and 1, `unit` (n, modes, 2), at `speed` (n,)."""
    n, modes, _ = unit.shape
    acceleration, yaw_rate = np.empty((n, modes), np.float32), np.empty((n, modes), np.float32)
    for i in range(n):
        one = kind[i]
        low, high = acceleration_bounds[one, 0], acceleration_bounds[one, 1]
        right, left = yaw_rate_bounds[one, 0], yaw_rate_bounds[one, 1]
        for mode in range(modes):
            up, turn = unit[i, mode, 0], unit[i, mode, 1]
            felt = up * high if up > 0.0 else -up * low
            most = max_curvature[one] * min(max(speed[i] + felt * dt, 0.0), max_speed[one])
            acceleration[i, mode] = felt
            yaw_rate[i, mode] = turn * min(left, most) if turn > 0.0 else -turn * max(right, -most)
    return acceleration, yaw_rate
