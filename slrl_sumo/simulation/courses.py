"""Where road users get to in the next seconds under each of their modes, and whom they would meet there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.advance import HALT, INTENT
from slrl_sumo.world.geometry import Floats, boxes_overlap, to_ego
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL

STEPS = 8
"""Intervals that are looked ahead: 3.2 s."""
HELD = 5
"""Intervals for which a mode's acceleration and yaw rate are kept up; then speed and heading stay."""
MARGIN = 0.4
"""m between boxes below which two meet."""
STANDING = 0.2
"""m/s."""


@dataclass(frozen=True, eq=False)
class Courses:
    """Of n road users under each mode, after each of STEPS intervals: (n, STEPS, modes) each, in m, rad and m/s."""

    x: Floats
    y: Floats
    heading: Floats
    """Not wrapped."""
    speed: Floats
    way: Floats
    """m covered by then."""


def courses(users: WorldState, acceleration: Floats, yaw_rate: Floats, top: Floats, *, halting: bool) -> Courses:
    """How `advance` would move n road users that keep up a mode's `acceleration` and `yaw_rate`, (n, modes), for HELD
    intervals, and then speed and heading; up to the speed `top`, (n, 1). With `halting` as `world.advance.halting`
    has it."""
    n, modes = acceleration.shape
    speed = np.empty((n, STEPS, modes))
    now, gain, ends = users.speed[:, None], acceleration * DECISION_INTERVAL, acceleration < INTENT
    for step in range(HELD):
        after = now + gain
        now = np.clip(after, 0.0, top)
        if halting:
            now[ends & (after < HALT)] = 0.0
        speed[:, step] = now
    speed[:, HELD:] = now[:, None]
    turn = yaw_rate[:, None] * DECISION_INTERVAL
    heading = users.heading[:, None, None] + turn * np.minimum(np.arange(1, STEPS + 1), HELD)[:, None]
    # The mean heading of each interval: that at its end once there is no turn any more.
    middle = heading[:, : HELD + 1] - 0.5 * turn
    middle[:, HELD] = heading[:, HELD]
    distance = speed * DECISION_INTERVAL
    along = [distance[:, :HELD] * f(middle[:, :HELD]) for f in (np.cos, np.sin)]
    beyond = [distance[:, HELD:] * f(middle[:, HELD:]) for f in (np.cos, np.sin)]
    x, y = (np.concatenate(parts, axis=1).cumsum(axis=1) for parts in zip(along, beyond, strict=True))
    x += users.x[:, None, None]
    y += users.y[:, None, None]
    return Courses(x, y, heading, speed, distance.cumsum(axis=1))


def meeting(
    mine: Courses,
    size: Floats,
    excused: NDArray[np.bool_],
    theirs: Floats,
    ego: NDArray[np.intp],
    other: NDArray[np.intp],
) -> Floats:
    """How soon each mode meets somebody: 0 where it does not within STEPS, up to 1 where it does at once, (n, modes).

    `mine`: courses of n road users of `size` (length and width in m, (n, 2)), as boxes MARGIN larger; `theirs`: boxes
    of all road users after each interval, MARGIN larger, (m, STEPS, 5); `ego`, `other`: the pairs that are looked at.
    Who is `excused`, (n,), is not to blame where it stands by then, or is met from behind or beside its rear.
    """
    met = np.zeros((len(size), mine.x.shape[2]))
    # What is near enough is found by circles, in ever smaller ones: round all of a course, round the places of all
    # modes after one interval, round the box of a mode. Few boxes remain to be compared.
    reach = 0.5 * np.hypot(size[:, 0], size[:, 1]) + 2 * MARGIN
    contact = reach[ego] + 0.5 * np.hypot(theirs[other, 0, 3], theirs[other, 0, 4])
    low_x, high_x, low_y, high_y = (f(c, axis=2) for c in (mine.x, mine.y) for f in (np.min, np.max))
    middle_x, middle_y = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
    radius = 0.5 * np.hypot(high_x - low_x, high_y - low_y)
    all_x, all_y, all_radius = _circle(low_x.min(1), high_x.max(1), low_y.min(1), high_y.max(1))
    path_x, path_y = theirs[..., 0], theirs[..., 1]
    their_x, their_y, their_radius = _circle(path_x.min(1), path_x.max(1), path_y.min(1), path_y.max(1))
    dx, dy = all_x[ego] - their_x[other], all_y[ego] - their_y[other]
    near = np.flatnonzero(dx * dx + dy * dy < (all_radius[ego] + their_radius[other] + contact) ** 2)
    ego, other, contact = ego[near], other[near], contact[near]
    dx, dy = middle_x[ego] - path_x[other], middle_y[ego] - path_y[other]
    pair, step = np.nonzero(dx * dx + dy * dy < (radius[ego] + contact[:, None]) ** 2)
    ego, other, contact = ego[pair], other[pair], contact[pair]
    dx, dy = mine.x[ego, step] - path_x[other, step, None], mine.y[ego, step] - path_y[other, step, None]
    row, mode = np.nonzero(dx * dx + dy * dy < (contact * contact)[:, None])
    ego, other, step = ego[row], other[row], step[row]
    boxes = np.empty((len(row), 5))
    here = (ego, step, mode)
    boxes[:, 0], boxes[:, 1], boxes[:, 2] = mine.x[here], mine.y[here], mine.heading[here]
    boxes[:, 3:] = size[ego] + MARGIN
    hit = np.flatnonzero(boxes_overlap(boxes, theirs[other, step]))
    ego, other, step, mode, boxes = ego[hit], other[hit], step[hit], mode[hit], boxes[hit]
    to_blame = ~excused[ego]
    ahead, _ = to_ego(path_x[other, step] - boxes[:, 0], path_y[other, step] - boxes[:, 1], boxes[:, 2])
    to_blame |= (mine.speed[ego, step, mode] > STANDING) & (ahead > 0.0)
    np.maximum.at(met, (ego[to_blame], mode[to_blame]), 1.0 - step[to_blame] / STEPS)
    return met


def _circle(x0: Floats, x1: Floats, y0: Floats, y1: Floats) -> tuple[Floats, Floats, Floats]:
    """Centres and radii of circles round upright boxes."""
    return 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * np.hypot(x1 - x0, y1 - y0)
