"""Supervised training of the stacked networks, batched over types and modes."""

from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from torch import Tensor
from torch.nn import functional

from slrl_sumo.learning.windows import Windows
from slrl_sumo.models.displacement import SPEED, DisplacementModels, displacement
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

LEARNING_RATE = 3e-3
"""Of Adam at the start; it falls linearly to 0 over the epochs."""

TYPE_EPOCHS = 10
"""Epochs in which all modes of a type learn as one before they part: a mode may have only a handful of windows."""

STEPS = 8
"""Steps an epoch has at least, where there are windows enough for it: else little data would mean hardly any steps.
Many more of them made modes with few windows overfit (tried on the HC recordings)."""

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


def _epochs(count: int, what: str, optimizer: torch.optim.Optimizer) -> Iterator[None]:
    """Run through `count` epochs with a falling learning rate, and a bar on stderr where somebody watches it."""
    console = Console(stderr=True)
    for epoch in track(range(count), what, console=console, transient=True, disable=not console.is_terminal):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - epoch / count)
        yield


def _batches(group: Longs, rows: int, blocks: int, random: np.random.Generator) -> Iterator[Tensor]:
    """One epoch: int64 indices (up to `blocks`, `rows`) of windows, in blocks that share a group.

    Every window comes up once, and the last block of a group is filled up with windows of the group. The blocks of
    each group are spread evenly over the epoch, so that every step sees the groups in the same proportion.
    """
    order = np.lexsort((random.random(len(group)), group))
    made, place = [], []
    for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        n = -(-len(mine) // rows)
        filled = np.concatenate([mine, random.choice(mine, n * rows - len(mine))])
        made.append(filled.reshape(n, rows))
        place.append((np.arange(n) + random.random(n)) / n)
    mixed = np.concatenate(made)[np.argsort(np.concatenate(place), kind="stable")]
    blocks = min(blocks, -(-len(mixed) // STEPS))
    for first in range(0, len(mixed), blocks):
        yield torch.from_numpy(mixed[first : first + blocks])


def train_displacement(
    models: DisplacementModels, train: Windows, mode: Longs, epochs: int, generator: torch.Generator
) -> None:
    """Train all displacement models at once, each on the windows of its type and mode (N,).

    They start as constant velocity, then all modes of a type learn the same for TYPE_EPOCHS, then each its own.
    """
    networks = models.networks
    networks.initialise(generator)
    _train_motion(models, train, np.zeros_like(mode), min(TYPE_EPOCHS, epochs), "motion of types", generator)
    with torch.no_grad():
        for parameter in networks.parameters():
            parameter.copy_(parameter[:, :1].expand_as(parameter))
    _train_motion(models, train, mode, epochs, "motion of modes", generator)


def _train_motion(
    models: DisplacementModels, train: Windows, mode: Longs, epochs: int, what: str, generator: torch.Generator
) -> None:
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    target = torch.from_numpy(train.displacement).float()
    # What is beyond the bounds cannot be learned; the displacement error still counts it.
    bounds = torch.stack([models.acceleration_bounds, models.yaw_rate_bounds], -1)[kind]
    kinematics = torch.from_numpy(np.stack([train.acceleration, train.yaw_rate], -1)).float()
    kinematics = kinematics.clamp(bounds[:, 0], bounds[:, 1])
    # Errors count relative to what is usual for the type, so that one learning rate suits walking and driving.
    straight = vector[:, SPEED, None] * torch.tensor([DECISION_INTERVAL, 0.0])
    usual = torch.cat([(straight - target).square().mean(-1, keepdim=True), kinematics.square()], -1)
    unit = torch.stack([usual[kind == int(t)].mean(0).sqrt().clamp_min(1e-3) for t in RoadUserType])
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    optimizer = torch.optim.Adam(models.parameters())
    for _ in _epochs(epochs, what, optimizer):
        north_free = turned(vector, generator)
        for rows in _batches(train.type * models.networks.members + mode, 64, 120, random):
            t = kind[rows[:, 0]]
            seen, scale = north_free[rows], unit[t][:, None]
            acceleration, yaw_rate = models.motion_blocks(seen, t, chosen[rows[:, 0]])
            moved = displacement(seen[..., SPEED], acceleration, yaw_rate, models.max_speed[t][:, None])
            off = torch.stack([acceleration, yaw_rate], -1) - kinematics[rows]
            error = _huber((moved - target[rows]) / scale[..., :1]) + KINEMATIC_WEIGHT * _huber(off / scale[..., 1:])
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()


def _huber(error: Tensor) -> Tensor:
    """Mean Huber loss: a few wild recorded positions must not rule a model with few windows."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error))


def train_prior(prior: Prior, train: Windows, mode: Longs, epochs: int, generator: torch.Generator) -> None:
    """Train the mode classifiers of all types at once, with cross-entropy against the modes (N,)."""
    prior.networks.initialise(generator)
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    optimizer = torch.optim.Adam(prior.parameters())
    for _ in _epochs(epochs, "prior", optimizer):
        north_free = turned(vector, generator)
        for rows in _batches(train.type, 128, 36, random):
            t = kind[rows[:, 0]]
            logits = prior.networks(north_free[rows], t, torch.zeros_like(t))
            error = functional.cross_entropy(logits.flatten(0, 1), chosen[rows].flatten())
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()
