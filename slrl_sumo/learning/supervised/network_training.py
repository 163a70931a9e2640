"""Supervised training of the stacked networks, batched over types and modes."""

from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track
from torch import Tensor
from torch.nn import functional

from slrl_sumo.jobs.progress import bar_console
from slrl_sumo.learning.supervised.windows import FUTURE, Windows
from slrl_sumo.models.displacement import SPEED, DisplacementModels, new_speed
from slrl_sumo.models.prior import Prior
from slrl_sumo.models.stacked_networks import StackedNetworks
from slrl_sumo.perception.features import FEATURES, NEAR_FIRST, PAST_SPEED, PAST_YAW_RATE, YAW_RATE
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

LEARNING_RATE = 3e-3
"""Initial learning rate of Adam; it falls linearly to 0 over the epochs."""

TYPE_EPOCHS = 10
"""Number of epochs in which the modes of a type share their weights: a mode may have only a few windows."""

FEWEST_STEPS = 8
"""Least number of optimiser steps of an epoch, if there are enough windows: otherwise small data sets would get hardly
any steps. Many more steps made modes with few windows overfit (tried on the HC recordings)."""

KINEMATIC_WEIGHT = 0.1
"""Weight of the first step's errors of acceleration and yaw rate relative to the position errors: near a standstill,
positions contain neither the turn nor the deceleration of a stopped road user."""

EPOCH_PATHS = 120_000
"""Greatest number of windows of an epoch of path training: successive windows share 11 of 12 intervals, so that one in
eight of a million windows contains nearly the same information. Each mode gets the same share, or all of its windows:
modes of rare manoeuvres have a few hundred of a million windows and would hardly learn otherwise."""

HIDDEN_SHARE = 0.5
"""Share of the windows in which the nearest road users are hidden: without hiding, models memorise the few encounters
of the recordings (error of the best of 20 on other recordings of SDD's pedestrians: 0.59 instead of 0.56 of constant
velocity)."""

PRIOR_PENALTY = 1.0
"""Weight of the sum of squared weights of the mode classifiers relative to the sum of the windows' cross-entropies.
Chosen on HC: it reduced overfitting to the 400 windows of cyclists and cars and changed nothing for pedestrians."""

MODE_PENALTY = 3.0
"""Weight of the sum of squared differences between the weights of a mode's model and the shared weights of its type
relative to the sum of the windows' errors: a mode with few windows stays close to its type. Chosen on HC
(docs/measurements/archive/prediction.md)."""

ACCELERATION = FEATURES.index("acceleration")
HEADING = FEATURES.index("heading")
Longs = NDArray[np.int64]


def turned(vector: Tensor, generator: torch.Generator) -> Tensor:
    """Feature vectors with random headings, because the models must not depend on the direction of north.

    In the preset `history`, the nearest road users are hidden in the share HIDDEN_SHARE of the vectors.
    """
    turned = vector.clone()
    turned[..., HEADING] = (torch.rand(vector.shape[:-1], generator=generator) * 2 - 1) * torch.pi
    if vector.shape[-1] > len(FEATURES):
        turned[..., NEAR_FIRST:] *= torch.rand((*vector.shape[:-1], 1), generator=generator) >= HIDDEN_SHARE
    return turned


def epochs_of(count: int, what: str, optimizer: torch.optim.Optimizer) -> Iterator[int]:
    """Run through `count` epochs with a falling learning rate, and a progress bar on stderr in a terminal."""
    console = bar_console()
    for epoch in track(range(count), what, console=console, transient=True, disable=console.quiet):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - epoch / count)
        yield epoch


def batches(group: Longs, rows: int, blocks: int, random: np.random.Generator) -> Iterator[Tensor]:
    """One epoch: int64 indices (up to `blocks`, `rows`) of windows, in blocks that share a group.

    Each window occurs once, and the last block of a group is padded with windows of the group. The blocks of each group
    are spread evenly over the epoch, so that each step contains the groups in the same proportion."""
    order = np.lexsort((random.random(len(group)), group))
    made, place = [], []
    for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        n = -(-len(mine) // rows)
        filled = np.concatenate([mine, random.choice(mine, n * rows - len(mine))])
        made.append(filled.reshape(n, rows))
        place.append((np.arange(n) + random.random(n)) / n)
    mixed = np.concatenate(made)[np.argsort(np.concatenate(place), kind="stable")]
    blocks = min(blocks, -(-len(mixed) // FEWEST_STEPS))
    for first in range(0, len(mixed), blocks):
        yield torch.from_numpy(mixed[first : first + blocks])


def train_displacement(
    models: DisplacementModels,
    train: Windows,
    mode: Longs,
    epochs: int,
    generator: torch.Generator,
    *,
    forget: float = 0.0,
    horizon: int = FUTURE,
    tied: bool = False,
) -> None:
    """Train all displacement models at once, each on the windows of its type and mode (N,).

    A model is rolled out over `horizon` intervals, usually the 4.8 s to the destination, with its own speed and
    acceleration as input as in a run, and all positions on the path count: models trained on single steps drift.
    `forget`: share of the windows in which the acceleration is hidden. Accelerations persist, so that models that
    always observe the acceleration continue the present motion instead of starting the motion of the mode. The models
    start as constant velocity; the modes of a type share their weights for TYPE_EPOCHS and are then trained separately.

    With `tied`, the modes of a type differ only in biases and in the last layer.
    """
    networks = models.networks
    networks.initialise(generator)
    _train_paths(
        models, train, np.zeros_like(mode), min(TYPE_EPOCHS, epochs), "paths of types", generator, forget, horizon
    )
    with torch.no_grad():
        for parameter in networks.parameters():
            parameter.copy_(parameter[:, :1].expand_as(parameter))
    _train_paths(models, train, mode, epochs, "paths of modes", generator, forget, horizon, tied)


def rolled(
    models: DisplacementModels, vector: Tensor, kind: Tensor, mode: Tensor, horizon: int = FUTURE
) -> tuple[Tensor, Tensor]:
    """Roll out road users that follow one mode for `horizon` intervals in unchanged surroundings.

    `vector` (n, rows, columns), `kind` and `mode` (n,) as in `DisplacementModels.motion_blocks`. Returns the positions
    (n, rows, horizon, 2) in m, in the ego frame of the start, and acceleration and yaw rate (n, rows, 2) of the first
    step.
    """
    top = models.max_speed[kind][:, None]
    speed, rest = vector[..., SPEED], vector[..., ACCELERATION + 1 :]
    with_past = vector.shape[-1] > len(FEATURES)
    x = y = heading = torch.zeros_like(speed)
    positions, first = [], torch.zeros(0)
    for step in range(horizon):
        acceleration, yaw_rate = models.motion_blocks(vector, kind, mode)
        if step == 0:
            first = torch.stack([acceleration, yaw_rate], -1)
        after = new_speed(speed, acceleration, top)
        middle = heading + 0.5 * DECISION_INTERVAL * yaw_rate
        x = x + DECISION_INTERVAL * after * middle.cos()
        y = y + DECISION_INTERVAL * after * middle.sin()
        heading = heading + DECISION_INTERVAL * yaw_rate
        own = torch.stack([after, (after - speed) / DECISION_INTERVAL], -1)
        if with_past:
            rest = _later(rest, speed, yaw_rate)
        vector = torch.cat([own, rest], -1)
        speed = after
        positions.append(torch.stack([x, y], -1))
    return torch.stack(positions, -2), first


def _later(rest: Tensor, speed: Tensor, yaw_rate: Tensor) -> Tensor:
    """The columns of the preset `history` from the third on, one interval later, in unchanged surroundings."""
    skipped = ACCELERATION + 1
    fixed, now = rest[..., : YAW_RATE - skipped], rest[..., YAW_RATE - skipped, None]
    speeds = rest[..., PAST_SPEED - skipped : PAST_YAW_RATE - skipped - 1]
    turns, near = rest[..., PAST_YAW_RATE - skipped : NEAR_FIRST - skipped - 1], rest[..., NEAR_FIRST - skipped :]
    return torch.cat([fixed, yaw_rate[..., None], speed[..., None], speeds, now, turns, near], -1)


def _train_paths(
    models: DisplacementModels,
    train: Windows,
    mode: Longs,
    epochs: int,
    what: str,
    generator: torch.Generator,
    forget: float,
    horizon: int,
    tied: bool = False,
) -> None:
    """Train each model on the windows of its type and mode (N,); `tied`: with equal gradients, see `tie`."""
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    target = torch.from_numpy(train.path[:, :horizon].astype(np.float32))
    # Motion beyond the bounds cannot be learned; the position errors still contain it.
    bounds = torch.stack([models.acceleration_bounds, models.yaw_rate_bounds], -1)[kind]
    kinematics = torch.from_numpy(np.stack([train.acceleration, train.yaw_rate], -1)).float()
    kinematics = kinematics.clamp(bounds[:, 0], bounds[:, 1])
    # Errors are relative to those of constant velocity at the same time, so that walking and driving, and the first
    # step and the last, have equal weight.
    path_scale = usual_errors(vector, kind, target)
    moved = [kinematics[kind == int(t)].square().mean(0).sqrt().clamp_min(1e-3) for t in RoadUserType]
    kinematic_scale = torch.stack(moved)
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    group = train.type * models.networks.members + mode
    common = [weight.detach().clone() for weight in models.networks.weight]
    optimizer = torch.optim.Adam(models.parameters())
    for _ in epochs_of(epochs, what, optimizer):
        some = some_windows(group, random)
        for rows in batches(group[some], 64, 120, random):
            rows = torch.from_numpy(some)[rows]
            of = kind[rows[:, 0]]
            seen = seen_in_training(vector[rows], forget, generator)
            path, first = rolled(models, seen, of, chosen[rows[:, 0]], horizon)
            error = huber((path - target[rows]) / path_scale[of][:, None, :, None])
            error = error + KINEMATIC_WEIGHT * huber((first - kinematics[rows]) / kinematic_scale[of][:, None])
            apart = [(w - c).square().sum() for w, c in zip(models.networks.weight, common, strict=True)]
            error = error + MODE_PENALTY / len(train) * torch.stack(apart).sum()
            optimizer.zero_grad()
            torch.autograd.backward(error)
            if tied:
                tie(models.networks)
            optimizer.step()


def tie(networks: StackedNetworks) -> None:
    """Give all members of a type equal gradients in all layers except the last, so that equal weights stay equal."""
    for weight in networks.weight[:-1]:
        if weight.grad is not None:
            weight.grad.copy_(weight.grad.sum(1, keepdim=True).expand_as(weight))


def seen_in_training(vector: Tensor, forget: float, generator: torch.Generator) -> Tensor:
    """Inputs of a model for the windows `vector` (..., columns) in training (see `turned`, `train_displacement`)."""
    seen = turned(vector, generator)
    if forget:
        seen[..., ACCELERATION] *= torch.rand(seen.shape[:-1], generator=generator) >= forget
    return seen


def usual_errors(vector: Tensor, kind: Tensor, target: Tensor) -> Tensor:
    """Root mean square errors of constant velocity after each interval of `target` (N, horizon, 2), m per coordinate,
    (3, horizon)."""
    ahead = torch.arange(1, target.shape[1] + 1) * DECISION_INTERVAL
    usual = []
    for t in RoadUserType:
        mine = kind == int(t)
        straight = torch.stack([vector[mine, SPEED, None] * ahead, torch.zeros(int(mine.sum()), len(ahead))], -1)
        usual.append((straight - target[mine]).square().mean((0, 2)).sqrt().clamp_min(1e-2))
    return torch.stack(usual)


def some_windows(group: Longs, random: np.random.Generator) -> Longs:
    """Windows of one epoch, int64 indices in a random order; `group` (N,) as in `batches`."""
    order = random.permutation(len(group))
    if len(group) <= EPOCH_PATHS:
        return order
    # The same number of windows from each group, or all of a smaller group.
    share = EPOCH_PATHS // len(np.unique(group))
    grouped = order[np.argsort(group[order], kind="stable")]
    first = np.searchsorted(group[grouped], group[grouped])
    chosen = np.zeros(len(group), np.bool_)
    chosen[grouped[np.arange(len(group)) - first < share]] = True
    return order[chosen[order]]


def huber(error: Tensor) -> Tensor:
    """Mean Huber loss: outliers in recorded positions must not dominate a model with few windows."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error))


def train_prior(
    prior: Prior,
    train: Windows,
    mode: Longs | Floats,
    epochs: int,
    generator: torch.Generator,
    rows: int = 128,
    blocks: int = 36,
) -> None:
    """Train the mode classifiers of all types at once, with cross-entropy against the modes (N,), or their
    probabilities (N, modes).

    The weights have a Gaussian prior (PRIOR_PENALTY), which regularises types with few windows more strongly.
    An optimiser step has `blocks` blocks of `rows` windows (see `batches`).
    """
    prior.networks.initialise(generator)
    vector, kind, chosen = torch.from_numpy(train.vector), torch.from_numpy(train.type), torch.from_numpy(mode)
    if chosen.dim() > 1:
        chosen = chosen.float()
    random = np.random.default_rng(int(torch.randint(2**31, (), generator=generator)))
    optimizer = torch.optim.Adam(prior.parameters())
    for _ in epochs_of(epochs, "prior", optimizer):
        for some in batches(train.type, rows, blocks, random):
            t = kind[some[:, 0]]
            logits = prior.networks(turned(vector[some], generator), t, torch.zeros_like(t))
            size = torch.stack([weight.square().sum() for weight in prior.networks.weight]).sum()
            error = functional.cross_entropy(logits.flatten(0, 1), chosen[some].flatten(0, 1))
            error = error + PRIOR_PENALTY / len(train) * size
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()
