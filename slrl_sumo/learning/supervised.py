"""Supervised training of the stacked networks, batched over types and modes."""

from collections.abc import Iterable, Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from slrl_sumo.learning.windows import Windows
from slrl_sumo.models.displacement import SPEED, DisplacementModels, displacement
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

LEARNING_RATE = 3e-3
"""Of Adam at the start; it falls linearly to 0 over the epochs."""

KINEMATIC_WEIGHT = 0.1
"""Weight of the acceleration and yaw rate errors beside the displacement error: near standstill the displacement
says nothing about the turn, and nothing about how hard a stopped road user brakes."""

HEADING = FEATURES.index("heading")
Longs = NDArray[np.int64]


def turned(vector: Tensor, generator: torch.Generator) -> Tensor:
    """Feature vectors (N, 12) with a new random heading each: which way is north must not matter to the models."""
    turned = vector.clone()
    turned[:, HEADING] = (torch.rand(len(vector), generator=generator) * 2 - 1) * torch.pi
    return turned


def _steps(group: Longs, rows: int, at_least: int, blocks: int, random: np.random.Generator) -> Iterator[Tensor]:
    """One epoch, as batches of blocks: int64 indices (blocks, rows) of windows that share a group.

    Every window comes up once; the last block of a group is filled up with windows of the group, and groups with
    fewer than `at_least` blocks get that many. The blocks of each group are spread evenly over the epoch.
    """
    order = np.lexsort((random.random(len(group)), group))
    made, place = [], []
    for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        n = max(-(-len(mine) // rows), at_least)
        filled = np.concatenate([mine, random.choice(mine, n * rows - len(mine))])
        made.append(filled.reshape(n, rows))
        place.append((np.arange(n) + random.random(n)) / n)
    mixed = np.concatenate(made)[np.argsort(np.concatenate(place), kind="stable")]
    for first in range(0, len(mixed), blocks):
        yield torch.from_numpy(mixed[first : first + blocks])


def train_displacement(
    models: DisplacementModels,
    train: Windows,
    mode: Longs,
    epochs: Iterable[int],
    count: int,
    generator: torch.Generator,
) -> None:
    """Train all displacement models at once, each on the windows of its type and mode."""
    models.networks.initialise(generator)
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    target = torch.from_numpy(train.displacement).float()
    acceleration_target = torch.from_numpy(train.acceleration).float()
    yaw_target = torch.from_numpy(train.yaw_rate).float()
    # Errors count relative to what is usual for the type, so that one learning rate suits walking and driving.
    unit = torch.ones(len(RoadUserType), 3)
    for one in RoadUserType:
        mine = kind == int(one)
        usual = vector[mine][:, SPEED, None] * torch.tensor([DECISION_INTERVAL, 0.0]) - target[mine]
        spread = (usual, acceleration_target[mine], yaw_target[mine])
        unit[one] = torch.stack([s.square().mean().sqrt() for s in spread]).clamp_min(1e-3)
    lowest, highest = models.acceleration_bounds.T
    right, left = models.yaw_rate_bounds.T
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    optimizer = torch.optim.Adam(models.parameters(), LEARNING_RATE)
    for epoch in epochs:
        north_free = turned(vector, generator)
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - epoch / count)
        for rows in _steps(train.type * models.networks.members + mode, 64, 10, 120, random):
            t = kind[rows[:, 0]]
            seen = north_free[rows]
            acceleration, yaw_rate = models.motion_blocks(seen, t, chosen[rows[:, 0]])
            moved = displacement(seen[..., SPEED], acceleration, yaw_rate, models.max_speed[t][:, None])
            scale = unit[t][:, :, None]
            wanted = acceleration_target[rows].clamp(lowest[t][:, None], highest[t][:, None])
            turn = yaw_target[rows].clamp(right[t][:, None], left[t][:, None])
            off = torch.stack([(acceleration - wanted) / scale[:, 1], (yaw_rate - turn) / scale[:, 2]])
            error = _huber((moved - target[rows]) / scale[:, :1]) + KINEMATIC_WEIGHT * _huber(off)
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()


def _huber(error: Tensor) -> Tensor:
    """Mean Huber loss: a few wild recorded positions must not rule a model with few windows."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error))


def train_prior(
    prior: Prior, train: Windows, mode: Longs, epochs: Iterable[int], count: int, generator: torch.Generator
) -> None:
    """Train the mode classifiers of all types at once."""
    prior.networks.initialise(generator)
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    optimizer = torch.optim.Adam(prior.parameters(), LEARNING_RATE)
    for epoch in epochs:
        north_free = turned(vector, generator)
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - epoch / count)
        for rows in _steps(train.type, 512, 10, 9, random):
            t = kind[rows[:, 0]]
            logits = prior.networks(north_free[rows], t, torch.zeros_like(t))
            error = functional.cross_entropy(logits.flatten(0, 1), chosen[rows].flatten())
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()
