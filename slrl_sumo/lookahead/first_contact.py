"""The first contact of each mode path of a road user with another one."""

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
"""m/s."""
DEEPER = 0.05
"""m by which vehicles in contact may come closer."""
PAST_STANDING = 0.3
"""m by which vehicles may come closer to one that stands, as SUMO's do whose lanes pass each other with less than their
width."""
STILL = 0.02
"""m that a person that stands may move and still stands: at less than STANDING they moved by 0.07 m in an interval,
into contact."""
ROOM = 0.02
"""m more than what would be a contact that pedestrians keep: there they are discs, which turn without coming nearer."""
START = 0.2
"""m that a person walks within an interval from a stand. Two that both stood for each other started at once, into
each other: 5 of 23 contacts in forty crowded networks."""
SLACK = 1e-6
"""m by which circles are larger than the boxes in them, and by which the room that is left may seem to shrink."""


class Now(NamedTuple):
    """Where all road users are, (m,) each."""

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
    """See Others."""


class Blame(NamedTuple):
    """For what n road users are to blame, (n,) each."""

    in_front: NDArray[np.bool_]
    """Only for a collision with what is in front: not where the other one comes from behind, or is beside the rear."""
    standing: Floats
    """What a collision counts for one that stands by then, from 0 to 1, if the other one does not stand."""
    walks: NDArray[np.bool_]
    """Pedestrians with a route: within the margin they may come nearer, but not into contact, nor to where a person is
    now, which may stop."""


class First(NamedTuple):
    """The first contact of each mode."""

    step: NDArray[np.int64]
    """Interval; that after the last one where there is none, (n, modes)."""
    counts: Floats
    """What it counts, from 0 to 1, (n, modes)."""


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
    """The first contacts of those that walk, in `first`.

    `pairs`: path, row of its road user, row of the other one, and whether that yields, (p, 4). `bounds`: of all modes
    in an interval, (n, steps, 4).
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
        # One that walks may stop, and one that stands may start: the later row leaves the earlier one the way.
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
            # One that stands not on its path: in a turn a car stands up to 0.3 m beside that.
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
    """Whether a pedestrian at (x, y) has less than the `least` room beside another road user, on its level."""
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
    """As walk_into, of all others, which are boxes."""
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
        # In contact, what separates the two, or keeps them as they are, is no collision: else none could go on.
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
                # One that comes from behind cannot be avoided, nor one beside the rear, which swings out in a turn.
                if in_front and c * dx + s * dy <= 0.0:
                    # Ahead an interval before, it is driven through: at 12 m/s intervals are 5 m long.
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
    """Radius of the circle round a box, m."""
    return 0.5 * math.sqrt(length**2 + width**2) + SLACK


@compiled
def _room(dx: float, dy: float, other: Box, person: bool, half: float) -> float:
    """m between a pedestrian of this `half` width, a disc, and another road user (dx, dy) m away, below 0 in contact:
    between two persons by the distance of their centres, else to the box."""
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
    """Distance between two intervals; 0 where they overlap."""
    return max(low - their_high, their_low - high, 0.0)
