"""The central path: the path with the least mean distance to all predictions."""

import numpy as np

from slrl_sumo.scene.geometry import Floats

ITERATIONS = 30
LEAST_DISTANCE = 1e-3
"""Least distance (m) between paths, so that no path has an infinite weight."""


def central_path(paths: Floats, weight: Floats) -> Floats:
    """The weighted spatial median of the samples at each moment, (U, moments, 2).

    `paths` (S, U, moments, 2) m, `weight` (S, U): probabilities of the samples. The point from which the expected
    distance is the least (Weiszfeld's algorithm), where the mean would be drawn away by a few samples that turn.
    """
    share = weight[:, :, None, None] / weight.sum(0)[:, None, None]
    centre: Floats = (paths * share).sum(0)
    for _ in range(ITERATIONS):
        away = np.hypot(paths[..., 0] - centre[..., 0], paths[..., 1] - centre[..., 1])[..., None]
        pull = share / np.maximum(away, LEAST_DISTANCE)
        centre = (paths * pull).sum(0) / pull.sum(0)
    return centre
