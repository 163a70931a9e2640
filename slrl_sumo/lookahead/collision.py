"""Whom road users would meet on their courses."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollout import ModeRollouts
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState

REACH = 30.0
"""m within which others are looked at."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""m that boxes of each type are enlarged by, half on each side: cars meet below 0.4 m between them, pedestrians
0.15 m. Without routes 0.4 for all: selectors of the preset `paper` learned with that."""
STANDING = 0.2
"""m/s."""
SLACK = 1e-6
"""m by which circles are larger than what they are round."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Where m road users are expected after each of STEPS intervals, (m, STEPS) each."""

    x: Floats
    y: Floats
    cos: Floats
    """Of the heading."""
    sin: Floats
    size: Floats
    """Length and width in m with MARGIN, (m, 2)."""


def sizes(users: WorldState, margin: Floats) -> Floats:
    """Length and width of road users in m, `margin` of their type, (3,), larger: (n, 2)."""
    room = margin[users.type]
    result = np.empty((len(users), 2))
    result[:, 0], result[:, 1] = users.length + room, users.width + room
    return result


def meeting(
    mine: ModeRollouts, excused: NDArray[np.bool_], theirs: Boxes, world: WorldState, rows: NDArray[np.intp]
) -> Floats:
    """How soon each mode meets somebody: 0 where it does not within STEPS, up to 1 where it does at once, (n, modes).

    `mine`: courses of the n road users `rows` of `world`; `theirs`: boxes of all road users of `world`. Others count
    that are within REACH now. Who is `excused`, (n,), is not to blame where it stands by then, or is met from behind or
    beside its rear.
    """
    order = np.argsort(world.x)
    return _meeting(
        mine.x,
        mine.y,
        mine.cos,
        mine.sin,
        mine.speed,
        excused,
        rows,
        theirs.x,
        theirs.y,
        theirs.cos,
        theirs.sin,
        theirs.size,
        world.x,
        world.y,
        order,
    )


@compiled
def _meeting(
    x: Floats,
    y: Floats,
    cos: Floats,
    sin: Floats,
    speed: Floats,
    excused: NDArray[np.bool_],
    rows: NDArray[np.intp],
    their_x: Floats,
    their_y: Floats,
    their_cos: Floats,
    their_sin: Floats,
    size: Floats,
    now_x: Floats,
    now_y: Floats,
    order: NDArray[np.intp],
) -> Floats:
    """`meeting` of the fields of ModeRollouts and of Boxes; `order`: rows of all road users from west to east."""
    n, steps, modes = x.shape
    m = len(order)
    met = np.zeros((n, modes))
    first = np.empty(modes, np.int64)
    # What is near enough is found by upright bounds, in ever smaller ones: of all of a course, of the places of all
    # modes after one interval; then by circles round boxes. Few boxes remain to be compared.
    places, theirs = _bounds(x, y), _bounds(their_x.reshape(m, 1, steps), their_y.reshape(m, 1, steps))
    corner = np.empty(m)
    for other in range(m):
        corner[other] = 0.5 * math.sqrt(size[other, 0] ** 2 + size[other, 1] ** 2) + SLACK
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
        looked = False
        for place in range(low, m):
            other = order[place]
            if now_x[other] > east:
                break
            if other == me or (now_x[other] - now_x[me]) ** 2 + (now_y[other] - now_y[me]) ** 2 > REACH**2:
                continue
            if not looked:
                looked = True
                first[:] = steps
                x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
                for step in range(steps):
                    x0, x1 = min(x0, places[i, step, 0]), max(x1, places[i, step, 1])
                    y0, y1 = min(y0, places[i, step, 2]), max(y1, places[i, step, 3])
            touching = corner[me] + corner[other]
            dx = _between(x0, x1, theirs[other, 0, 0], theirs[other, 0, 1])
            if not _near(dx, _between(y0, y1, theirs[other, 0, 2], theirs[other, 0, 3]), touching):
                continue
            for step in range(steps):
                there_x, there_y = their_x[other, step], their_y[other, step]
                dx = _between(places[i, step, 0], places[i, step, 1], there_x, there_x)
                if not _near(dx, _between(places[i, step, 2], places[i, step, 3], there_y, there_y), touching):
                    continue
                for mode in range(modes):
                    dx, dy = there_x - x[i, step, mode], there_y - y[i, step, mode]
                    # Who is met later than somebody else does not count any more.
                    if not _near(dx, dy, touching) or first[mode] <= step:
                        continue
                    c, s = cos[i, step, mode], sin[i, step, mode]
                    # A vehicle that stands by then is run into, and could not help it by driving on. Nor can it help
                    # who comes from behind, or stands beside the rear that swings out in a turn.
                    if excused[i] and (speed[i, step, mode] <= STANDING or c * dx + s * dy <= 0.0):
                        continue
                    there_c, there_s = their_cos[other, step], their_sin[other, step]
                    length, width, their_length, their_width = size[me, 0], size[me, 1], size[other, 0], size[other, 1]
                    if _overlap(dx, dy, c, s, there_c, there_s, length, width, their_length, their_width):
                        first[mode] = step
        if looked:
            for mode in range(modes):
                met[i, mode] = 1.0 - first[mode] / steps
    return met


@compiled
def _near(dx: float, dy: float, reach: float) -> bool:
    return bool(dx * dx + dy * dy < reach * reach)


@compiled
def _between(low: float, high: float, their_low: float, their_high: float) -> float:
    """How far two spans are apart; 0 where they overlap."""
    return max(low - their_high, their_low - high, 0.0)


@compiled
def _bounds(x: Floats, y: Floats) -> Floats:
    """Lowest and highest `x` and `y` (n, m, k) along the last axis, (n, m, 4)."""
    n, m, places = x.shape
    bounds = np.empty((n, m, 4))
    for i in range(n):
        for j in range(m):
            x0, x1, y0, y1 = x[i, j, 0], x[i, j, 0], y[i, j, 0], y[i, j, 0]
            # Not min and max, which look for what is no number as well.
            for k in range(1, places):
                at_x, at_y = x[i, j, k], y[i, j, k]
                x0 = at_x if at_x < x0 else x0
                x1 = at_x if at_x > x1 else x1
                y0 = at_y if at_y < y0 else y0
                y1 = at_y if at_y > y1 else y1
            bounds[i, j, 0], bounds[i, j, 1], bounds[i, j, 2], bounds[i, j, 3] = x0, x1, y0, y1
    return bounds


@compiled
def _overlap(
    dx: float,
    dy: float,
    cos: float,
    sin: float,
    their_cos: float,
    their_sin: float,
    length: float,
    width: float,
    their_length: float,
    their_width: float,
) -> bool:
    """`geometry.boxes_overlap` of two boxes, the other one `dx`, `dy` away."""
    c, s = abs(cos * their_cos + sin * their_sin), abs(their_sin * cos - their_cos * sin)
    return bool(
        abs(cos * dx + sin * dy) <= 0.5 * (length + their_length * c + their_width * s)
        and abs(cos * dy - sin * dx) <= 0.5 * (width + their_length * s + their_width * c)
        and abs(their_cos * dx + their_sin * dy) <= 0.5 * (their_length + length * c + width * s)
        and abs(their_cos * dy - their_sin * dx) <= 0.5 * (their_width + length * s + width * c)
    )
