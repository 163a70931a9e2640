"""Predictors of a path from the last 2 s, learned per type: what the models of a bundle have to beat.

Each takes training moments and test moments of one type and returns paths (samples, N, 16, 2) in m, in the ego frame;
one sample is a single prediction. All but the damped turn add a learned residual to constant velocity.
"""

import numpy as np
import torch
from sklearn.cluster import KMeans
from torch import Tensor, nn
from torch.nn import functional

from benchmarks.prediction.moments import Moments
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.prediction.rollout import STEPS

SAMPLES = 20
DAMPINGS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0)
"""Shares of the yaw rate that remain after an interval, of which the best on the training moments is taken."""
RIDGE_PENALTY = 10.0
"""Of the squared weights, for standardised inputs and residuals in m."""
HIDDEN = 64
EPOCHS = 60
LEARNING_RATE = 3e-3
BATCH = 256
RELAXATION = 0.05
"""Weight of the mean error of all samples beside that of the best one, so that none is left behind untrained."""


def constant_velocity(train: Moments, test: Moments, seed: int) -> Floats:
    """Speed and heading stay."""
    return test.straight[None]


def damped_turn(train: Moments, test: Moments, seed: int) -> Floats:
    """The speed stays, the yaw rate falls by the same share in each interval."""
    error = [np.hypot(*(_turn(train, keep) - train.path).transpose(2, 0, 1)).mean() for keep in DAMPINGS]
    return _turn(test, DAMPINGS[int(np.argmin(error))])[None]


def _turn(moments: Moments, keep: float) -> Floats:
    yaw_rate = moments.yaw_rate[:, None] * keep ** np.arange(1, STEPS + 1)
    heading = DECISION_INTERVAL * (yaw_rate.cumsum(1) - 0.5 * yaw_rate)
    step = moments.speed[:, None] * DECISION_INTERVAL
    return np.stack([(step * np.cos(heading)).cumsum(1), (step * np.sin(heading)).cumsum(1)], -1)


def ridge(train: Moments, test: Moments, seed: int) -> Floats:
    """Linear in the positions of the last 2 s."""
    x, others = _inputs(train, test)
    x, others = (np.column_stack([values, np.ones(len(values))]) for values in (x, others))
    penalty = RIDGE_PENALTY * np.eye(x.shape[1])
    penalty[-1, -1] = 0.0
    weights = np.linalg.solve(x.T @ x + penalty, x.T @ _residuals(train))
    return _paths(test, (others @ weights)[None])


def mlp(train: Moments, test: Moments, seed: int) -> Floats:
    """A multilayer perceptron with the inputs of `ridge`."""
    return _learned(train, test, seed, np.zeros((1, 2 * STEPS)))


def kmeans(train: Moments, test: Moments, seed: int) -> Floats:
    """The same 20 residual paths for all: clusters of those in the training moments."""
    found = KMeans(SAMPLES, n_init=4, random_state=seed).fit(_residuals(train)).cluster_centers_
    return _paths(test, np.repeat(found[:, None], len(test), 1))


def winner_takes_all(train: Moments, test: Moments, seed: int) -> Floats:
    """A perceptron with 20 outputs, of which the nearest to the recorded path is trained; begins at `kmeans`."""
    found = KMeans(SAMPLES, n_init=4, random_state=seed).fit(_residuals(train)).cluster_centers_
    return _learned(train, test, seed, found)


def _learned(train: Moments, test: Moments, seed: int, begin: Floats) -> Floats:
    """Residuals of a perceptron whose outputs begin at `begin` (samples, 2 STEPS)."""
    generator = torch.Generator().manual_seed(seed)
    x, others = (torch.from_numpy(values).float() for values in _inputs(train, test))
    target = torch.from_numpy(_residuals(train)).float().view(-1, STEPS, 2)
    first, second, last = nn.Linear(x.shape[1], HIDDEN), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, begin.size)
    with torch.no_grad():
        for layer in (first, second):
            reach = layer.in_features**-0.5
            layer.weight.uniform_(-reach, reach, generator=generator)
            layer.bias.zero_()
        last.weight.zero_()
        last.bias.copy_(torch.from_numpy(begin).flatten())
    network = nn.Sequential(first, nn.Tanh(), second, nn.Tanh(), last)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=0.01)
    for epoch in range(EPOCHS):
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - epoch / EPOCHS)
        order = torch.randperm(len(x), generator=generator)
        for start in range(0, len(x), BATCH):
            rows = order[start : start + BATCH]
            error = _huber(network(x[rows]).view(-1, len(begin), STEPS, 2) - target[rows][:, None])
            loss = error.amin(1).mean() + (RELAXATION * error.mean() if len(begin) > 1 else 0.0)
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            optimizer.step()
    with torch.inference_mode():
        found: Tensor = network(others).view(-1, len(begin), 2 * STEPS).transpose(0, 1)
    return _paths(test, found.double().numpy())


def _huber(error: Tensor) -> Tensor:
    """Mean over the path, (n, samples)."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none").mean((-2, -1))


def _inputs(train: Moments, test: Moments) -> tuple[Floats, Floats]:
    """Positions of the last 2 s, standardised by the training moments, (n, 10), at most 5 deviations away."""
    x, others = (moments.past.reshape(len(moments), -1) for moments in (train, test))
    mean, deviation = x.mean(0), np.maximum(x.std(0), 1e-6)
    return np.clip((x - mean) / deviation, -5.0, 5.0), np.clip((others - mean) / deviation, -5.0, 5.0)


def _residuals(moments: Moments) -> Floats:
    return (moments.path - moments.straight).reshape(len(moments), -1)


def _paths(moments: Moments, residuals: Floats) -> Floats:
    """`residuals` (samples, N, 32) as paths (samples, N, 16, 2)."""
    return moments.straight + residuals.reshape(*residuals.shape[:2], STEPS, 2)


BASELINES = {
    "constant velocity": constant_velocity,
    "damped turn": damped_turn,
    "ridge": ridge,
    "MLP": mlp,
    "20 K-Means paths": kmeans,
    "winner-takes-all MLP": winner_takes_all,
}
