"""Which mode paths lead into the expected box of another road user, and how soon."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.forecast import Boxes
from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Box, Floats
from slrl_sumo.scene.kernels import overlap
from slrl_sumo.scene.state import WorldState

REACH = 30.0
"""m within which other road users count."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""m by which boxes of each type are larger, half on each side: vehicles collide below 0.4 m of clearance, pedestrians
below 0.15 m. Without routes 0.4 for all types: selectors of the preset `paper` learned with that."""
STANDING = 0.2
"""m/s."""
SLACK = 1e-6
"""m by which circles are larger than the boxes in them."""


def collision_scores(
    paths: ModePaths, excused: NDArray[np.bool_], boxes: Boxes, world: WorldState, rows: NDArray[np.intp]
) -> Floats:
    """How soon each mode collides: 0 where it does not within STEPS, up to 1 where it does at once, (n, modes).

    `paths`: of the n road users `rows` of `world`; `boxes`: of all its road users, of which those within REACH count.
    An `excused` road user, (n,), is not to blame where it stands by then, or where the other one comes from behind or
    is beside its rear.
    """
    return _collision_scores(paths, excused, rows, boxes, world.x, world.y, np.argsort(world.x))


@compiled
def _collision_scores(
    paths: ModePaths,
    excused: NDArray[np.bool_],
    rows: NDArray[np.intp],
    boxes: Boxes,
    now_x: Floats,
    now_y: Floats,
    order: NDArray[np.intp],
) -> Floats:
    """`order`: rows of all road users from west to east."""
    x, y, cos, sin, speed = paths.x, paths.y, paths.cos, paths.sin, paths.speed
    their_x, their_y, their_cos, their_sin, size = boxes.x, boxes.y, boxes.cos, boxes.sin, boxes.size
    n, steps, modes = x.shape
    m = len(order)
    scores = np.zeros((n, modes))
    first = np.empty(modes, np.int64)
    # Pairs that may touch are found by axis-aligned bounds, ever smaller ones: of a whole path, then of the places of
    # all modes after one interval; then by circles round the boxes. Few boxes remain to be compared.
    bounds = _bounds(x, y)
    their_bounds = _bounds(their_x.reshape(m, 1, steps), their_y.reshape(m, 1, steps))
    radius = np.empty(m)
    for other in range(m):
        radius[other] = 0.5 * math.sqrt(size[other, 0] ** 2 + size[other, 1] ** 2) + SLACK
    for i in range(n):
        me = rows[i]
        west, east = now_x[me] - REACH, now_x[me] + REACH
        low, high = 0, m
        while low < high:
            half = (low + high) // 2
            if now_x[order[half]] < west:
                low = half + 1
            else:
                high = half
        candidates = False
        for place in range(low, m):
            other = order[place]
            if now_x[other] > east:
                break
            if other == me or (now_x[other] - now_x[me]) ** 2 + (now_y[other] - now_y[me]) ** 2 > REACH**2:
                continue
            if not candidates:
                candidates = True
                first[:] = steps
                x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
                for step in range(steps):
                    x0, x1 = min(x0, bounds[i, step, 0]), max(x1, bounds[i, step, 1])
                    y0, y1 = min(y0, bounds[i, step, 2]), max(y1, bounds[i, step, 3])
            touching = radius[me] + radius[other]
            dx = _between(x0, x1, their_bounds[other, 0, 0], their_bounds[other, 0, 1])
            if not _near(dx, _between(y0, y1, their_bounds[other, 0, 2], their_bounds[other, 0, 3]), touching):
                continue
            for step in range(steps):
                there_x, there_y = their_x[other, step], their_y[other, step]
                dx = _between(bounds[i, step, 0], bounds[i, step, 1], there_x, there_x)
                if not _near(dx, _between(bounds[i, step, 2], bounds[i, step, 3], there_y, there_y), touching):
                    continue
                for mode in range(modes):
                    dx, dy = there_x - x[i, step, mode], there_y - y[i, step, mode]
                    # Only the first collision of a mode counts.
                    if not _near(dx, dy, touching) or first[mode] <= step:
                        continue
                    c, s = cos[i, step, mode], sin[i, step, mode]
                    # A vehicle that stands by then is hit by the other one, and could not avoid that by driving on.
                    # Nor can it avoid one that comes from behind, or one beside its rear, which swings out in a turn.
                    if excused[i] and (speed[i, step, mode] <= STANDING or c * dx + s * dy <= 0.0):
                        continue
                    mine = Box(c, s, size[me, 0], size[me, 1])
                    theirs = Box(their_cos[other, step], their_sin[other, step], size[other, 0], size[other, 1])
                    if overlap(dx, dy, mine, theirs):
                        first[mode] = step
        if candidates:
            for mode in range(modes):
                scores[i, mode] = 1.0 - first[mode] / steps
    return scores


@compiled
def _near(dx: float, dy: float, reach: float) -> bool:
    return bool(dx * dx + dy * dy < reach * reach)


@compiled
def _between(low: float, high: float, their_low: float, their_high: float) -> float:
    """Distance between two intervals; 0 where they overlap."""
    return max(low - their_high, their_low - high, 0.0)


@compiled
def _bounds(x: Floats, y: Floats) -> Floats:
    """Lowest and highest `x` and `y` (n, m, k) along the last axis, (n, m, 4)."""
    n, m, places = x.shape
    bounds = np.empty((n, m, 4))
    for i in range(n):
        for j in range(m):
            x0, x1, y0, y1 = x[i, j, 0], x[i, j, 0], y[i, j, 0], y[i, j, 0]
            # Not min and max, which also check for NaN.
            for k in range(1, places):
                at_x, at_y = x[i, j, k], y[i, j, k]
                x0 = at_x if at_x < x0 else x0
                x1 = at_x if at_x > x1 else x1
                y0 = at_y if at_y < y0 else y0
                y1 = at_y if at_y > y1 else y1
            bounds[i, j, 0], bounds[i, j, 1], bounds[i, j, 2], bounds[i, j, 3] = x0, x1, y0, y1
    return bounds
