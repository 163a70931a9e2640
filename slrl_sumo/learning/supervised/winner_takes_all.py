"""Modes that compete for recorded paths: each mode is trained on the paths that it predicts best (`fit --modes
paths`)."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from slrl_sumo.learning.supervised.network_training import (
    batches,
    epochs_of,
    huber,
    rolled,
    seen_in_training,
    some_windows,
    tie,
    train_displacement,
    train_prior,
    usual_errors,
)
from slrl_sumo.learning.supervised.windows import Windows
from slrl_sumo.models.displacement import DisplacementModels
from slrl_sumo.models.prior import Prior
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

CLUSTERS_PART = 4
"""Divisor of the number of epochs: in the first part, the modes are trained on their clusters."""
ASSIGN_EVERY = 4
"""Number of epochs after which windows are assigned again to the mode that predicts them best."""
RANDOM_MODE_SHARE = 0.05
"""Share of the windows that a random mode learns instead of the best mode, so that no mode stays untrained."""
WEIGHT_DECAY = 0.01
"""Weight decay of the optimiser (AdamW)."""
LONGEST_GRADIENT = 1.0
"""Norm to which gradients are clipped, as is usual for gradients through many steps."""
ROWS, BLOCKS = 16, 32
"""Number of windows of a block, which share type and mode, and number of blocks of an optimiser step."""
PRIOR_BLOCKS, PRIOR_STEPS = 8, 120
"""Number of blocks of an optimiser step of the prior, and intended number of steps of an epoch. With 8 steps an epoch,
the prior was trained too little: with the same models, single predictions of SDD's held-out pedestrians erred
by 0.93 instead of 0.88 of constant velocity (docs/measurements/archive/prediction.md)."""
LEAST_PRIOR_ROWS, MOST_PRIOR_ROWS = 32, 576
"""Bounds of the number of windows of a block of the prior, which share the type."""
WINDOWS_AT_ONCE = 1024
"""Number of windows that are rolled out in all modes at once, outside training steps."""

Longs = NDArray[np.int64]


def train_winners(
    models: DisplacementModels,
    train: Windows,
    mode: Longs,
    epochs: int,
    generator: torch.Generator,
    *,
    forget: float,
    horizon: int,
) -> Longs:
    """Train displacement models so that the modes of a type cover the recorded paths over `horizon` intervals.

    The training begins like `train_displacement` with the modes (N,) of clusters. Then, every few epochs, each window
    is rolled out in all modes, and the mode with the least error learns the window. Errors have equal weights at all
    times of a path, as in the mean error that selects the best of many predictions. The modes of a type differ only in
    biases and the last layer: otherwise each mode would learn its other layers from a twentieth of the windows, and
    predict other recordings less well.
    Returns the modes that predict the windows best, (N,).
    """
    train_displacement(
        models, train, mode, -(-epochs // CLUSTERS_PART), generator, forget=forget, horizon=horizon, tied=True
    )
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    members = models.networks.members
    part = train.take(some_windows(train.type * members + mode, random))
    vector, kind = torch.from_numpy(part.vector), torch.from_numpy(part.type)
    target = torch.from_numpy(part.path[:, :horizon].astype(np.float32))
    unit = usual_errors(vector, kind, target).square().mean(1).sqrt()
    optimizer = torch.optim.AdamW(models.parameters(), weight_decay=WEIGHT_DECAY)
    for epoch in epochs_of(epochs, "winners", optimizer):
        if epoch % ASSIGN_EVERY == 0:
            best = mode_errors(models, part, horizon).argmin(-1)
        left = random.random(len(part)) < RANDOM_MODE_SHARE
        learns = np.where(left, random.integers(members, size=len(part)), best)
        chosen = torch.from_numpy(learns)
        for rows in batches(part.type * members + learns, ROWS, BLOCKS, random):
            of = kind[rows[:, 0]]
            seen = seen_in_training(vector[rows], forget, generator)
            path = rolled(models, seen, of, chosen[rows[:, 0]], horizon)[0]
            error = huber((path - target[rows]) / unit[of][:, None, None, None])
            optimizer.zero_grad()
            torch.autograd.backward(error)
            tie(models.networks)
            nn.utils.clip_grad_norm_(models.parameters(), LONGEST_GRADIENT)
            optimizer.step()
    return np.asarray(mode_errors(models, train, horizon).argmin(-1), np.int64)


@torch.inference_mode()
def mode_errors(models: DisplacementModels, every: Windows, horizon: int) -> Floats:
    """Mean error of each mode's rollout over `horizon` intervals, m, (N, modes)."""
    modes = torch.arange(models.networks.members)
    result = np.zeros((len(every), len(modes)))
    for t in RoadUserType:
        for rows in np.array_split(mine := np.flatnonzero(every.type == t), -(-len(mine) // WINDOWS_AT_ONCE) or 1):
            if len(rows):
                vector = torch.from_numpy(every.vector[rows]).expand(len(modes), -1, -1)
                path = rolled(models, vector, torch.full_like(modes, int(t)), modes, horizon)[0]
                target = torch.from_numpy(every.path[rows, :horizon]).float()
                result[rows] = (path - target).norm(dim=-1).mean(-1).T.numpy()
    return result


def train_path_prior(
    prior: Prior, models: DisplacementModels, train: Windows, epochs: int, generator: torch.Generator, horizon: int
) -> None:
    """Train the prior with the probabilities of the modes by the errors of their rollouts over `horizon` intervals.

    Several similar modes predict a path nearly equally well: the best mode alone carries little information.
    """
    likely = responsibilities(mode_errors(models, train, horizon), train.type)
    rows = prior_rows(len(train))
    train_prior(prior, train, likely, epochs, generator, rows, PRIOR_BLOCKS)


def prior_rows(windows: int) -> int:
    """Number of windows of a block of the prior, with which an epoch has about PRIOR_STEPS optimiser steps."""
    return min(max(windows // (PRIOR_BLOCKS * PRIOR_STEPS), LEAST_PRIOR_ROWS), MOST_PRIOR_ROWS)


def responsibilities(errors: Floats, kind: Longs) -> Floats:
    """Probability of each mode for each window, (N, modes), from its error (N, modes).

    The unit of the errors is the mean error of the best mode of the type `kind` (N,).
    """
    unit = np.ones(len(errors))
    for t in np.unique(kind):
        unit[kind == t] = max(errors[kind == t].min(-1).mean(), 1e-6)
    likely = np.exp((errors.min(-1, keepdims=True) - errors) / unit[:, None])
    return np.asarray(likely / likely.sum(-1, keepdims=True), np.float64)
