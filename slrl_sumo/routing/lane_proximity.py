"""Parts of lanes that are too close to other lanes for vehicles on both lanes."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats

SPACING = 0.5
"""Spacing (m) of the points at which lanes are compared."""


def sampled(shape: Floats) -> Floats:
    """Points of a line (k, 2) every SPACING m, (points, 5): x, y, m along the line, and the direction, a unit
    vector."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
    s = np.linspace(0.0, along[-1], 2 + int(along[-1] / SPACING))
    points = np.stack([np.interp(s, along, shape[:, 0]), np.interp(s, along, shape[:, 1])], axis=1)
    steps = np.diff(points, axis=0)
    steps = np.append(steps, steps[-1:], axis=0)
    return np.column_stack([points, s, steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None]])


def clear_of(mine: Floats, others: Iterable[tuple[Floats, float]]) -> NDArray[np.bool_]:
    """Which points of a line are clear of all `others`: lines, each with the least distance (m); see `sampled`."""
    clear = np.ones(len(mine), np.bool_)
    for line, apart in others:
        offset = mine[:, None, :2] - line[:, :2]
        clear &= np.hypot(offset[..., 0], offset[..., 1]).min(axis=1) >= apart
    return clear


@compiled
def near_parts(mine: Floats, theirs: Floats, apart: float) -> tuple[int, int, int, int]:
    """Indices of the first and last point of each of two lines (k, 5) that is less than `apart` (m) from the other
    line.

    The indices of the first line are -1 if the lines are farther apart.
    """
    first, last, their_first, their_last = -1, -1, len(theirs), -1
    for i in range(len(mine)):
        for j in range(len(theirs)):
            dx, dy = mine[i, 0] - theirs[j, 0], mine[i, 1] - theirs[j, 1]
            # Most points are far apart along one axis; without this comparison, a pair of lanes took 3 times as long.
            if abs(dx) < apart and abs(dy) < apart and math.hypot(dx, dy) < apart:
                first, last = i if first < 0 else first, i
                their_first, their_last = min(their_first, j), max(their_last, j)
    return first, last, their_first, their_last
