"""Collision scores of modes: whether, and how soon, a mode path leads into the expected box of another road user."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.first_contact import STANDING, Blame, First, Now, between, circle, drive_into, near, walk_into
from slrl_sumo.lookahead.forecast import Boxes
from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.lookahead.precedence import Precedence, goes_first
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN

REACH = 30.0
"""Distance (m) within which other road users count."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""Margin (m) added to the boxes of moving road users, by type, half on each side: moving vehicles collide below 0.4 m
of clearance, pedestrians below 0.15 m, because pedestrians can step aside. Without routes, the margin is 0.4 m for all
types, also at a stand: selectors of the preset `paper` were trained with it."""
WAITING = 0.5
"""Weight of a collision in which the ego pedestrian stands by then and the other road user moves. With 1, two oncoming
pedestrians that could not avoid each other had no better mode than to walk on, although stopping solves the
conflict."""


class Others(NamedTuple):
    """Forecast of all m road users of a world."""

    boxes: Boxes
    """Expected boxes of road users that keep their present motion."""
    yielding: Boxes
    """Expected boxes of road users that wait for the ego road user."""
    order: Precedence
    """Decides which road users wait for the ego road user."""
    starts: NDArray[np.bool_]
    """Standing learned pedestrians that may walk on, (m,); of two, the later row gives way to the earlier row."""


def blame_of(kind: NDArray[np.int8], follows: NDArray[np.bool_], routed: NDArray[np.bool_]) -> Blame:
    """Blame of road users of the types `kind`, with routes (`routed`), and as vehicles on them (`follows`), (n,) each.

    A standing vehicle is hit by the other road user, and could not avoid the collision by driving on; a pedestrian
    might step aside. Vehicles in contact with a standing road user may drive on beside it, as SUMO's lanes lead them.
    """
    walks = routed & (kind == PEDESTRIAN)
    return Blame(follows, np.where(follows, 0.0, np.where(walks, WAITING, 1.0)), walks)


def collision_scores(
    paths: ModePaths,
    blame: Blame,
    others: Others,
    world: WorldState,
    rows: NDArray[np.intp],
    levels: Levels = FLAT,
) -> Floats:
    """How soon each mode collides, (n, modes): 0 without a collision within STEPS, 1 for an immediate collision.

    `paths`: mode paths of the n ego road users, the `rows` of `world`. `others`: forecast of all road users of `world`;
    only road users within REACH count. Boxes on different `levels` do not collide.
    """
    stands = world.speed < STANDING
    person = world.type == PEDESTRIAN
    return _collision_scores(
        paths,
        blame,
        rows,
        others.boxes,
        others.yielding,
        others.order,
        Now(
            world.x,
            world.y,
            np.cos(world.heading),
            np.sin(world.heading),
            world.length,
            world.width,
            stands,
            person,
            others.starts,
        ),
        np.argsort(world.x),
        levels,
    )


@compiled
def _collision_scores(
    paths: ModePaths,
    blame: Blame,
    rows: NDArray[np.intp],
    boxes: Boxes,
    yielding: Boxes,
    precedence: Precedence,
    now: Now,
    order: NDArray[np.intp],
    levels: Levels,
) -> Floats:
    """`order`: rows of all road users from west to east."""
    n, steps, modes = paths.x.shape
    bounds = _bounds(paths.x, paths.y)
    pairs = _pairs(rows, bounds, boxes, yielding, precedence, now, order)
    first = First(np.full((n, modes), steps), np.ones((n, modes)))
    walk_into(pairs, paths, bounds, blame, boxes, yielding, now, levels, first)
    drive_into(pairs, paths, bounds, blame, boxes, yielding, now, levels, first)
    scores = np.empty((n, modes))
    for i in range(n):
        for mode in range(modes):
            scores[i, mode] = first.counts[i, mode] * (1.0 - first.step[i, mode] / steps)
    return scores


@compiled
def _pairs(
    rows: NDArray[np.intp],
    bounds: Floats,
    boxes: Boxes,
    yielding: Boxes,
    precedence: Precedence,
    now: Now,
    order: NDArray[np.intp],
) -> NDArray[np.int64]:
    """Pairs of ego and other road users whose paths may touch, from the bounds of all modes, (p, 4); see
    `walk_into`."""
    x, y, size = now.x, now.y, boxes.size
    n, steps, _ = bounds.shape
    m = len(order)
    going_bounds = _bounds(boxes.x.reshape(m, 1, steps), boxes.y.reshape(m, 1, steps))
    yielding_bounds = _bounds(yielding.x.reshape(m, 1, steps), yielding.y.reshape(m, 1, steps))
    radius = np.empty(m)
    for other in range(m):
        radius[other] = circle(size[other, 0], size[other, 1])
    pairs, found = np.empty((8 * n, 4), np.int64), 0
    for i in range(n):
        me = rows[i]
        x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
        for step in range(steps):
            x0, x1 = min(x0, bounds[i, step, 0]), max(x1, bounds[i, step, 1])
            y0, y1 = min(y0, bounds[i, step, 2]), max(y1, bounds[i, step, 3])
        west, east = x[me] - REACH, x[me] + REACH
        low, high = 0, m
        while low < high:
            half = (low + high) // 2
            if x[order[half]] < west:
                low = half + 1
            else:
                high = half
        for place in range(low, m):
            other = order[place]
            if x[other] > east:
                break
            if other == me or (x[other] - x[me]) ** 2 + (y[other] - y[me]) ** 2 > REACH**2:
                continue
            touching = radius[me] + radius[other]
            # `goes_first` is called last: it takes longer than both comparisons.
            dx = between(x0, x1, going_bounds[other, 0, 0], going_bounds[other, 0, 1])
            going = near(dx, between(y0, y1, going_bounds[other, 0, 2], going_bounds[other, 0, 3]), touching)
            dx = between(x0, x1, yielding_bounds[other, 0, 0], yielding_bounds[other, 0, 1])
            waiting = near(dx, between(y0, y1, yielding_bounds[other, 0, 2], yielding_bounds[other, 0, 3]), touching)
            if not (going or waiting):
                continue
            waits = goes_first(me, other, precedence)
            if not (waiting if waits else going):
                continue
            if found == len(pairs):
                longer = np.empty((2 * found, 4), np.int64)
                for pair in range(found):
                    for column in range(4):
                        longer[pair, column] = pairs[pair, column]
                pairs = longer
            pairs[found, 0], pairs[found, 1], pairs[found, 2], pairs[found, 3] = i, me, other, waits
            found += 1
    return pairs[:found]


@compiled
def _bounds(x: Floats, y: Floats) -> Floats:
    """Lowest and highest `x` and `y` (n, m, k) along the last axis, (n, m, 4)."""
    n, m, places = x.shape
    bounds = np.empty((n, m, 4))
    for i in range(n):
        for j in range(m):
            x0, x1, y0, y1 = x[i, j, 0], x[i, j, 0], y[i, j, 0], y[i, j, 0]
            # Comparisons are faster than min and max, which also check for NaN.
            for k in range(1, places):
                at_x, at_y = x[i, j, k], y[i, j, k]
                x0 = at_x if at_x < x0 else x0
                x1 = at_x if at_x > x1 else x1
                y0 = at_y if at_y < y0 else y0
                y1 = at_y if at_y > y1 else y1
            bounds[i, j, 0], bounds[i, j, 1], bounds[i, j, 2], bounds[i, j, 3] = x0, x1, y0, y1
    return bounds
