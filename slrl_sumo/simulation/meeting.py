"""Whom road users would meet on their courses."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.simulation.courses import Courses
from slrl_sumo.world.compiled import compiled
from slrl_sumo.world.geometry import Floats
from slrl_sumo.world.state import WorldState

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
    mine: Courses, excused: NDArray[np.bool_], theirs: Boxes, world: WorldState, rows: NDArray[np.intp]
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
    """`meeting` of the fields of Courses and of Boxes; `order`: rows of all road users from west to east."""
    n, steps, modes = x.shape
    m = len(order)
    met = np.zeros((n, modes))
    first = np.empty(modes, np.int64)
    # What is near enough is found by circles, in ever smaller ones: round all of a course, round the places of all
    # modes after one interval, round the box of a mode. Few boxes remain to be compared.
    their_middle, corner = np.empty((m, 3)), np.empty(m)
    for other in range(m):
        corner[other] = 0.5 * math.sqrt(size[other, 0] ** 2 + size[other, 1] ** 2) + SLACK
        _circle(their_x[other], their_y[other], their_middle[other])
        their_middle[other, 2] += corner[other]
    places, middle = np.empty((steps, 3)), np.empty(3)
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
                for step in range(steps):
                    _circle(x[i, step], y[i, step], places[step])
                    places[step, 2] += corner[me]
                _circle(x[i].ravel(), y[i].ravel(), middle)
                middle[2] += corner[me]
            whole = their_middle[other]
            if not _near(middle[0] - whole[0], middle[1] - whole[1], middle[2] + whole[2]):
                continue
            touching = corner[me] + corner[other]
            for step in range(steps):
                there_x, there_y = their_x[other, step], their_y[other, step]
                if not _near(there_x - places[step, 0], there_y - places[step, 1], places[step, 2] + corner[other]):
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
                    if _overlap(dx, dy, c, s, there_c, there_s, size[me], size[other]):
                        first[mode] = step
        if looked:
            for mode in range(modes):
                met[i, mode] = 1.0 - first[mode] / steps
    return met


@compiled
def _near(dx: float, dy: float, reach: float) -> bool:
    return bool(dx * dx + dy * dy < reach * reach)


@compiled
def _circle(x: Floats, y: Floats, out: Floats) -> None:
    """Centre and radius of a circle round points, (3,), into `out`."""
    west, east, south, north = x[0], x[0], y[0], y[0]
    for k in range(1, len(x)):
        west, east, south, north = min(west, x[k]), max(east, x[k]), min(south, y[k]), max(north, y[k])
    out[0], out[1] = 0.5 * (west + east), 0.5 * (south + north)
    out[2] = 0.5 * math.sqrt((east - west) ** 2 + (north - south) ** 2)


@compiled
def _overlap(
    dx: float, dy: float, cos: float, sin: float, their_cos: float, their_sin: float, size: Floats, their_size: Floats
) -> bool:
    """`geometry.boxes_overlap` of two boxes of (length, width), the other one `dx`, `dy` away."""
    c, s = abs(cos * their_cos + sin * their_sin), abs(their_sin * cos - their_cos * sin)
    length, width, their_length, their_width = size[0], size[1], their_size[0], their_size[1]
    return bool(
        abs(cos * dx + sin * dy) <= 0.5 * (length + their_length * c + their_width * s)
        and abs(cos * dy - sin * dx) <= 0.5 * (width + their_length * s + their_width * c)
        and abs(their_cos * dx + their_sin * dy) <= 0.5 * (their_length + length * c + width * s)
        and abs(their_cos * dy - their_sin * dx) <= 0.5 * (their_width + length * s + width * c)
    )
