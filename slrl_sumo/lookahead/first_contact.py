"""The first contact of each mode path of an ego road user with another road user."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.forecast import Boxes
from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.scene.geometry import Box, Floats
from slrl_sumo.scene.kernels import apart, clearance, overlap
from slrl_sumo.scene.levels import Levels

STANDING = 0.2
"""Speed (m/s) up to which a road user stands."""
DEEPER = 0.05
"""Distance (m) by which vehicles that are in contact may come closer."""
PAST_STANDING = 0.3
"""Distance (m) by which a vehicle in contact with a standing road user may come closer, as SUMO's vehicles do where
lanes pass each other with less than the width of the vehicles."""
STILL = 0.02
"""Distance (m) that a standing pedestrian may move in an interval and still count as standing: below STANDING, they
moved by up to 0.07 m, into contact."""
ROOM = 0.02
"""Room (m) that pedestrians keep beyond contact. Pedestrians are discs here, which turn without coming nearer."""
START = 0.2
"""Distance (m) that a pedestrian walks in the first interval from a stand. Two pedestrians waiting for each other
started at the same time, into each other: 5 of 23 contacts in forty crowded networks."""
SLACK = 1e-6
"""Tolerance (m): excess of circles over the boxes in them, and greatest decrease of room that counts as no decrease."""


class Now(NamedTuple):
    """Present state of all road users of the world, (m,) each."""

    x: Floats
    y: Floats
    cos: Floats
    """Of the heading."""
    sin: Floats
    length: Floats
    width: Floats
    stands: NDArray[np.bool_]
    person: NDArray[np.bool_]
    starts: NDArray[np.bool_]
    """See collision.Others."""


class Blame(NamedTuple):
    """The collisions for which n ego road users are at fault, (n,) each."""

    in_front: NDArray[np.bool_]
    """Only collisions with road users in front count, not with road users behind or beside the rear."""
    standing: Floats
    """Weight, from 0 to 1, of a collision in which the ego road user stands by then and the other one moves."""
    walks: NDArray[np.bool_]
    """Pedestrians with a route: within the margin they may come nearer, but not into contact, and not into the present
    position of a walking pedestrian, which may stop."""


class First(NamedTuple):
    """The first contact of each mode."""

    step: NDArray[np.int64]
    """Interval of the contact, (n, modes); the number of intervals if there is no contact."""
    counts: Floats
    """Weight of the contact, from 0 to 1, (n, modes)."""


@compiled
def walk_into(
    pairs: NDArray[np.int64],
    paths: ModePaths,
    bounds: Floats,
    blame: Blame,
    going: Boxes,
    yielding: Boxes,
    now: Now,
    levels: Levels,
    first: First,
) -> None:
    """Write the first contacts of pedestrians with a route to `first`.

    `pairs`, (p, 4): index of the ego road user in `paths`, its row, the row of the other road user, and whether the
    other one yields. `bounds`: bounds of all modes in each interval, (n, steps, 4).
    """
    x, y, cos, sin, size = paths.x, paths.y, paths.cos, paths.sin, going.size
    first_step, counts = first
    _, steps, modes = x.shape
    for pair in range(len(pairs)):
        i, me, other, yields = pairs[pair, 0], pairs[pair, 1], pairs[pair, 2], pairs[pair, 3]
        if not blame.walks[i]:
            continue
        expected, standing = yielding if yields else going, blame.standing[i]
        stood_before, stands = now.stands[me], now.stands[other]
        touching = circle(size[me, 0], size[me, 1]) + circle(size[other, 0], size[other, 1])
        person, half = now.person[other], 0.5 * now.width[me] + ROOM
        there_x, there_y, there_c, there_s = now.x[other], now.y[other], now.cos[other], now.sin[other]
        theirs = Box(there_c, there_s, now.length[other], now.width[other])
        away = _room(there_x - now.x[me], there_y - now.y[me], theirs, person, half)
        keeps = 0.5 * (size[me, 1] - now.width[me] + size[other, 1] - now.width[other])
        nearest = min(away, 0.0) - SLACK if away < keeps else keeps
        # A walking pedestrian may stop, and a standing one may start: the later row gives way to the earlier row.
        starts = stood_before and now.starts[other] and other < me
        if person and (starts or not stands):
            ahead = START if starts else 0.0
            start_x, start_y = there_x + ahead * there_c, there_y + ahead * there_s
            least = min(_room(start_x - now.x[me], start_y - now.y[me], theirs, person, half), 0.0) - SLACK
            for mode in range(modes):
                goes = paths.speed[i, 0, mode] > STANDING or (stood_before and paths.distance[i, 0, mode] > STILL)
                here_x, here_y, c, s = x[i, 0, mode], y[i, 0, mode], cos[i, 0, mode], sin[i, 0, mode]
                if goes and _meets(here_x, here_y, c, s, start_x, start_y, theirs, person, half, least, levels):
                    first_step[i, mode], counts[i, mode] = 0, 1.0
        for step in range(steps):
            # A standing road user stays at its position, not on its path: a turning car stands up to 0.3 m beside it.
            if not stands:
                there_x, there_y = expected.x[other, step], expected.y[other, step]
                there_c, there_s = expected.cos[other, step], expected.sin[other, step]
                theirs = Box(there_c, there_s, now.length[other], now.width[other])
            dx = between(bounds[i, step, 0], bounds[i, step, 1], there_x, there_x)
            if not near(dx, between(bounds[i, step, 2], bounds[i, step, 3], there_y, there_y), touching):
                continue
            for mode in range(modes):
                here_x, here_y, c, s = x[i, step, mode], y[i, step, mode], cos[i, step, mode], sin[i, step, mode]
                # Only the first collision of a mode counts.
                if not near(there_x - here_x, there_y - here_y, touching) or first_step[i, mode] <= step:
                    continue
                if _meets(here_x, here_y, c, s, there_x, there_y, theirs, person, half, nearest, levels):
                    stood = paths.speed[i, step, mode] <= STANDING and not stands
                    stood &= not stood_before or paths.distance[i, step, mode] <= STILL
                    first_step[i, mode], counts[i, mode] = step, standing if stood else 1.0


@compiled
def _meets(
    x: float,
    y: float,
    cos: float,
    sin: float,
    there_x: float,
    there_y: float,
    other: Box,
    person: bool,
    half: float,
    least: float,
    levels: Levels,
) -> bool:
    """Whether a pedestrian at (x, y) has less room than `least` (m) to another road user on the same level."""
    if _room(there_x - x, there_y - y, other, person, half) >= least:
        return False
    return not apart(levels, x, y, cos, sin, there_x, there_y, other.cos, other.sin)


@compiled
def drive_into(
    pairs: NDArray[np.int64],
    paths: ModePaths,
    bounds: Floats,
    blame: Blame,
    going: Boxes,
    yielding: Boxes,
    now: Now,
    levels: Levels,
    first: First,
) -> None:
    """Write the first contacts of all other road users, which are boxes, to `first`; arguments as for `walk_into`."""
    x, y, cos, sin, size = paths.x, paths.y, paths.cos, paths.sin, going.size
    first_step, counts = first
    _, steps, modes = x.shape
    for pair in range(len(pairs)):
        i, me, other, yields = pairs[pair, 0], pairs[pair, 1], pairs[pair, 2], pairs[pair, 3]
        if blame.walks[i]:
            continue
        expected, standing, in_front = yielding if yields else going, blame.standing[i], blame.in_front[i]
        stands = now.stands[other]
        touching = circle(size[me, 0], size[me, 1]) + circle(size[other, 0], size[other, 1])
        # If the two are in contact now, a movement that does not bring them closer is no collision: otherwise neither
        # of them could drive on.
        now_x, now_y = now.x[other] - now.x[me], now.y[other] - now.y[me]
        mine = Box(now.cos[me], now.sin[me], size[me, 0], size[me, 1])
        theirs = Box(now.cos[other], now.sin[other], size[other, 0], size[other, 1])
        least = clearance(now_x, now_y, mine, theirs)
        contact = least < 0.0
        deepest = least - (PAST_STANDING if stands else DEEPER)
        for step in range(steps):
            there_x, there_y = expected.x[other, step], expected.y[other, step]
            dx = between(bounds[i, step, 0], bounds[i, step, 1], there_x, there_x)
            if not near(dx, between(bounds[i, step, 2], bounds[i, step, 3], there_y, there_y), touching):
                continue
            theirs = Box(expected.cos[other, step], expected.sin[other, step], size[other, 0], size[other, 1])
            for mode in range(modes):
                here_x, here_y, c, s = x[i, step, mode], y[i, step, mode], cos[i, step, mode], sin[i, step, mode]
                dx, dy = there_x - here_x, there_y - here_y
                if not near(dx, dy, touching) or first_step[i, mode] <= step:
                    continue
                stood = paths.speed[i, step, mode] <= STANDING
                if stood and standing == 0.0:
                    continue
                # A road user behind cannot be avoided; nor can one beside the rear, which swings out in a turn.
                if in_front and c * dx + s * dy <= 0.0:
                    # If the road user was ahead one interval before, the ego drives through it: at 12 m/s, an interval
                    # is 5 m long.
                    if step == 0:
                        before = now.cos[me] * now_x + now.sin[me] * now_y
                    else:
                        before = cos[i, step - 1, mode] * (expected.x[other, step - 1] - x[i, step - 1, mode])
                        before += sin[i, step - 1, mode] * (expected.y[other, step - 1] - y[i, step - 1, mode])
                    if before <= 0.0:
                        continue
                mine = Box(c, s, size[me, 0], size[me, 1])
                if (
                    overlap(dx, dy, mine, theirs)
                    and not (contact and clearance(dx, dy, mine, theirs) > deepest)
                    and not apart(levels, here_x, here_y, c, s, there_x, there_y, theirs.cos, theirs.sin)
                ):
                    waits = stood and not stands
                    first_step[i, mode], counts[i, mode] = step, standing if waits else 1.0


@compiled
def circle(length: float, width: float) -> float:
    """Radius (m) of the circle around a box."""
    return 0.5 * math.sqrt(length**2 + width**2) + SLACK


@compiled
def _room(dx: float, dy: float, other: Box, person: bool, half: float) -> float:
    """Room (m) between a pedestrian, a disc with the radius `half`, and another road user at (dx, dy) m; below 0 in
    contact. Between two pedestrians the distance of their centres counts, else the distance to the box."""
    if person:
        return math.sqrt(dx * dx + dy * dy) - COLLISION_DISTANCE - ROOM
    ahead = abs(other.cos * dx + other.sin * dy) - 0.5 * other.length
    aside = abs(other.cos * dy - other.sin * dx) - 0.5 * other.width
    outside = math.sqrt(max(ahead, 0.0) ** 2 + max(aside, 0.0) ** 2)
    return float(outside + min(max(ahead, aside), 0.0) - half)


@compiled
def near(dx: float, dy: float, reach: float) -> bool:
    return bool(dx * dx + dy * dy < reach * reach)


@compiled
def between(low: float, high: float, their_low: float, their_high: float) -> float:
    """Distance between two intervals; 0 if they overlap."""
    return max(low - their_high, their_low - high, 0.0)
