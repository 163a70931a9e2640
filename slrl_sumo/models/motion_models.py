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
CACHED_ROWS = 128
"""Number of road users for which all layers are computed before those of the next ones: what a layer gives stays in the
cache until the next layer reads it."""
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
    _, members, _, last = networks.bias[-1].shape
    n, result = len(vector), np.empty((len(vector), members, last), np.float32)
    for begin in range(0, n, CACHED_ROWS):
        some = slice(begin, begin + CACHED_ROWS)
        result[some] = _outputs(networks, vector[some], kind[some])
    return result


def _outputs(networks: Networks, vector: Singles, kind: NDArray[np.int64]) -> Singles:
    """As `outputs`."""
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
    """Outputs (n, members, out) of one layer; `x`: (n, members or 1, in), `weight`: (types, members, in, out).

    Each output adds its inputs one after the other, in whatever order the rows are computed.
    """
    n, members, outputs = len(x), weight.shape[1], weight.shape[3]
    result, sums = np.empty((n, members, outputs), np.float32), np.empty((4, outputs), np.float32)
    rows, first = _by_type(kind, len(weight))
    for one in range(len(weight)):
        for begin in range(first[one], first[one + 1], BLOCK_ROWS):
            block = rows[begin : min(begin + BLOCK_ROWS, first[one + 1])]
            for member in range(members):
                inputs = x[:, member if x.shape[1] > 1 else 0]
                of_one, added = weight[one, member], bias[one, member, 0]
                if outputs < FEW_OUTPUTS:
                    _few_outputs(inputs, block, of_one, added, result[:, member])
                else:
                    _many_outputs(inputs, block, of_one, added, result[:, member], sums)
    return result


@compiled
def _by_type(kind: NDArray[np.int64], types: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of each type in turn, (n,), and where those of each type begin and end, (types + 1,)."""
    rows, first = np.empty(len(kind), np.int64), np.zeros(types + 1, np.int64)
    found = 0
    for one in range(types):
        for i in range(len(kind)):
            if kind[i] == one:
                rows[found] = i
                found += 1
        first[one + 1] = found
    return rows, first


@compiled
def _few_outputs(x: Singles, rows: NDArray[np.int64], weight: Singles, bias: Singles, result: Singles) -> None:
    """Outputs of some rows, four at once: the sums of one row wait for each other, those of four rows do not."""
    last, (columns, outputs) = len(rows) - 1, weight.shape
    for place in range(0, len(rows), 4):
        # At the end of the block, a row is computed twice.
        p, q = rows[place], rows[min(place + 1, last)]
        r, s = rows[min(place + 2, last)], rows[min(place + 3, last)]
        for j in range(outputs):
            of_p = of_q = of_r = of_s = bias[j]
            for k in range(columns):
                of_p += x[p, k] * weight[k, j]
                of_q += x[q, k] * weight[k, j]
                of_r += x[r, k] * weight[k, j]
                of_s += x[s, k] * weight[k, j]
            result[p, j], result[q, j], result[r, j], result[s, j] = of_p, of_q, of_r, of_s


@compiled
def _many_outputs(
    x: Singles, rows: NDArray[np.int64], weight: Singles, bias: Singles, result: Singles, sums: Singles
) -> None:
    """Outputs of some rows, four rows and two inputs at once, so that weights and sums are loaded less often.

    `sums` is a buffer (4, out).
    """
    last, (columns, outputs) = len(rows) - 1, weight.shape
    for place in range(0, len(rows), 4):
        p, q = rows[place], rows[min(place + 1, last)]
        r, s = rows[min(place + 2, last)], rows[min(place + 3, last)]
        for j in range(outputs):
            sums[0, j] = sums[1, j] = sums[2, j] = sums[3, j] = bias[j]
        for k in range(0, columns - 1, 2):
            p0, q0, r0, s0 = x[p, k], x[q, k], x[r, k], x[s, k]
            p1, q1, r1, s1 = x[p, k + 1], x[q, k + 1], x[r, k + 1], x[s, k + 1]
            for j in range(outputs):
                a, b = weight[k, j], weight[k + 1, j]
                sums[0, j] = (sums[0, j] + p0 * a) + p1 * b
                sums[1, j] = (sums[1, j] + q0 * a) + q1 * b
                sums[2, j] = (sums[2, j] + r0 * a) + r1 * b
                sums[3, j] = (sums[3, j] + s0 * a) + s1 * b
        if columns % 2:
            k = columns - 1
            for j in range(outputs):
                sums[0, j] += x[p, k] * weight[k, j]
                sums[1, j] += x[q, k] * weight[k, j]
                sums[2, j] += x[r, k] * weight[k, j]
                sums[3, j] += x[s, k] * weight[k, j]
        for j in range(outputs):
            result[p, j], result[q, j], result[r, j], result[s, j] = sums[0, j], sums[1, j], sums[2, j], sums[3, j]


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
