"""Where road users get to in the next seconds under each of their modes, and whom they would meet there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.advance import HALT, INTENT
from slrl_sumo.world.geometry import Floats, boxes_overlap, cos_sin, to_ego
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL

STEPS = 8
"""Intervals that are looked ahead: 3.2 s."""
HELD = 5
"""Intervals for which a mode's acceleration and yaw rate are kept up; then speed and heading stay."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""m that boxes of each type are enlarged by, half on each side: cars meet below 0.4 m between them, pedestrians
0.15 m. Without routes 0.4 for all: selectors of the preset `paper` learned with that."""
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
    x, y = (_places(begin, distance, c) for begin, c in zip((users.x, users.y), cos_sin(middle), strict=True))
    return Courses(x, y, heading, speed, _running_sum(distance))


def meeting(
    mine: Courses,
    size: Floats,
    excused: NDArray[np.bool_],
    theirs: Floats,
    ego: NDArray[np.intp],
    other: NDArray[np.intp],
) -> Floats:
    """How soon each mode meets somebody: 0 where it does not within STEPS, up to 1 where it does at once, (n, modes).

    `mine`: courses of n road users of `size` (length and width in m, MARGIN included, (n, 2)); `theirs`: boxes
    of all road users after each interval, MARGIN larger, (m, STEPS, 5); `ego`, `other`: the pairs that are looked at.
    Who is `excused`, (n,), is not to blame where it stands by then, or is met from behind or beside its rear.
    """
    n, modes = len(size), mine.x.shape[2]
    met = np.zeros(n * modes)
    # What is near enough is found by circles, in ever smaller ones: round all of a course, round the places of all
    # modes after one interval, round the box of a mode. Few boxes remain to be compared.
    low_x, high_x, low_y, high_y = (f(c, axis=2) for c in (mine.x, mine.y) for f in (np.min, np.max))
    all_x, all_y, all_reach = _circles(low_x.min(1), high_x.max(1), low_y.min(1), high_y.max(1))
    path_x, path_y = np.ascontiguousarray(theirs[..., 0]), np.ascontiguousarray(theirs[..., 1])
    their_x, their_y, their_reach = _circles(path_x.min(1), path_x.max(1), path_y.min(1), path_y.max(1))
    corner, their_corner = (0.5 * np.hypot(x[:, 0], x[:, 1]) + 1e-6 for x in (size, theirs[:, 0, 3:]))
    all_reach, their_reach = all_reach + corner, their_reach + their_corner
    dx, dy = all_x[ego] - their_x[other], all_y[ego] - their_y[other]
    near = np.flatnonzero(dx * dx + dy * dy < (all_reach[ego] + their_reach[other]) ** 2)
    ego, other = ego[near], other[near]
    middle_x, middle_y, reach = _circles(low_x, high_x, low_y, high_y)
    reach += corner[:, None]
    dx, dy = middle_x[ego] - path_x[other], middle_y[ego] - path_y[other]
    pair, step = np.nonzero(dx * dx + dy * dy < (reach[ego] + their_corner[other, None]) ** 2)
    # From here on rows of all road users and intervals laid end to end.
    touching = (corner[ego] + their_corner[other])[pair, None]
    here, there = ego[pair] * STEPS + step, other[pair] * STEPS + step
    dx = mine.x.reshape(-1, modes).take(here, axis=0) - path_x.ravel().take(there)[:, None]
    dy = mine.y.reshape(-1, modes).take(here, axis=0) - path_y.ravel().take(there)[:, None]
    dx *= dx
    dy *= dy
    dx += dy
    row, mode = np.divmod(np.flatnonzero(dx < touching * touching), modes)
    place, there = here.take(row) * modes + mode, there.take(row)
    boxes, their_boxes = np.empty((len(row), 5)), theirs.reshape(-1, 5).take(there, axis=0)
    user, after = np.divmod(place // modes, STEPS)
    for column, values in enumerate((mine.x, mine.y, mine.heading)):
        boxes[:, column] = values.ravel().take(place)
    boxes[:, 3], boxes[:, 4] = size[:, 0].take(user), size[:, 1].take(user)
    to_blame = ~excused.take(user) | (mine.speed.ravel().take(place) > STANDING)
    to_blame &= boxes_overlap(boxes, their_boxes)
    hit = np.flatnonzero(to_blame)
    user, mode, after, boxes, their_boxes = user[hit], mode[hit], after[hit], boxes[hit], their_boxes[hit]
    ahead, _ = to_ego(their_boxes[:, 0] - boxes[:, 0], their_boxes[:, 1] - boxes[:, 1], boxes[:, 2])
    blamed = ~excused[user] | (ahead > 0.0)
    np.maximum.at(met, (user * modes + mode)[blamed], 1.0 - after[blamed] / STEPS)
    return met.reshape(n, modes)


def _places(begin: Floats, distance: Floats, direction: Floats) -> Floats:
    """One coordinate after each interval, (n, STEPS, modes): from `begin` (n,) on by `distance` (n, STEPS, modes), in
    directions whose cosines or sines are given, (n, HELD + 1, modes); the last one is that of all that follow."""
    steps = distance.copy()
    steps[:, :HELD] *= direction[:, :HELD]
    steps[:, HELD:] *= direction[:, HELD:]
    steps[:, 0] += begin[:, None]
    return _running_sum(steps)


def _running_sum(steps: Floats) -> Floats:
    """Sums of `steps` (n, STEPS, modes) up to each interval, in place: quicker than np.cumsum for so few of them."""
    for step in range(1, STEPS):
        steps[:, step] += steps[:, step - 1]
    return steps


def _circles(x0: Floats, x1: Floats, y0: Floats, y1: Floats) -> tuple[Floats, Floats, Floats]:
    """Centres and radii of circles round upright boxes."""
    return 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * np.hypot(x1 - x0, y1 - y0)
