"""Which mode paths lead into the expected box of another road user, and how soon."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.forecast import Boxes
from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.lookahead.precedence import Precedence, goes_first
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.scene.geometry import Box, Floats
from slrl_sumo.scene.kernels import apart, clearance, overlap
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

REACH = 30.0
"""m within which other road users count."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""m by which boxes of each type are larger while they move, half on each side: moving vehicles collide below 0.4 m of
clearance, pedestrians below 0.15 m, because those can step aside. Without routes 0.4 for all types, standing ones
included: selectors of the preset `paper` learned with that."""
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
WAITING = 0.5
"""What a collision with one that moves counts for a pedestrian that stands by then. With 1, two that came towards each
other had no better mode than to walk on where none avoids the other, although it was enough that both stop."""
START = 0.2
"""m that a person walks within an interval from a stand. Two that both stood for each other started at once, into
each other: 5 of 23 contacts in forty crowded networks."""
SLACK = 1e-6
"""m by which circles are larger than the boxes in them, and by which the room that is left may seem to shrink."""


class Others(NamedTuple):
    """What is expected of all road users of a world."""

    boxes: Boxes
    """If they go on as they do now."""
    yielding: Boxes
    """If they wait for the road user whose modes are judged."""
    order: Precedence
    """Which of them wait."""
    starts: NDArray[np.bool_]
    """Learned persons that stand, and may walk on: of two, the later row leaves the earlier one the way, (m,)."""


class Blame(NamedTuple):
    """For what n road users are to blame, (n,) each."""

    in_front: NDArray[np.bool_]
    """Only for a collision with what is in front: not where the other one comes from behind, or is beside the rear."""
    standing: Floats
    """What a collision counts for one that stands by then, from 0 to 1, if the other one does not stand."""
    walks: NDArray[np.bool_]
    """Pedestrians with a route: within the margin they may come nearer, but not into contact, nor to where a person is
    now, which may stop."""


def blame_of(kind: NDArray[np.int8], follows: NDArray[np.bool_], routed: NDArray[np.bool_]) -> Blame:
    """Of road users of the types `kind` that have a route (`routed`), and vehicles that follow it, (n,) each.

    A vehicle that stands is hit by the other one, and could not avoid that by driving on; a pedestrian might step
    aside. In contact vehicles may drive on beside one that stands, as SUMO's lanes lead them.
    """
    walks = routed & (kind == RoadUserType.PEDESTRIAN)
    return Blame(follows, np.where(follows, 0.0, np.where(walks, WAITING, 1.0)), walks)


def collision_scores(
    paths: ModePaths,
    blame: Blame,
    others: Others,
    world: WorldState,
    rows: NDArray[np.intp],
    levels: Levels = FLAT,
) -> Floats:
    """How soon each mode collides: 0 where it does not within STEPS, up to 1 where it does at once, (n, modes).

    `paths`: of the n road users `rows` of `world`; `others`: all its road users, of which those within REACH count.
    Boxes on different `levels` do not collide.
    """
    stands = world.speed < STANDING
    person = world.type == RoadUserType.PEDESTRIAN
    return _collision_scores(
        paths,
        blame,
        rows,
        others.boxes,
        others.yielding,
        others.order,
        _Now(
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


class _Now(NamedTuple):
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


@compiled
def _collision_scores(
    paths: ModePaths,
    blame: Blame,
    rows: NDArray[np.intp],
    boxes: Boxes,
    yielding: Boxes,
    precedence: Precedence,
    now: _Now,
    order: NDArray[np.intp],
    levels: Levels,
) -> Floats:
    """`order`: rows of all road users from west to east."""
    x, y, cos, sin, speed = paths.x, paths.y, paths.cos, paths.sin, paths.speed
    size = boxes.size
    now_x, now_y, now_cos, now_sin = now.x, now.y, now.cos, now.sin
    n, steps, modes = x.shape
    m = len(order)
    scores = np.zeros((n, modes))
    first, counts = np.empty(modes, np.int64), np.empty(modes)
    # Pairs that may touch are found by axis-aligned bounds, ever smaller ones: of a whole path, then of the places of
    # all modes after one interval; then by circles round the boxes. Few boxes remain to be compared.
    bounds = _bounds(x, y)
    going_bounds = _bounds(boxes.x.reshape(m, 1, steps), boxes.y.reshape(m, 1, steps))
    yielding_bounds = _bounds(yielding.x.reshape(m, 1, steps), yielding.y.reshape(m, 1, steps))
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
                first[:], counts[:] = steps, 1.0
                x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
                for step in range(steps):
                    x0, x1 = min(x0, bounds[i, step, 0]), max(x1, bounds[i, step, 1])
                    y0, y1 = min(y0, bounds[i, step, 2]), max(y1, bounds[i, step, 3])
            touching = radius[me] + radius[other]
            # Whether it waits is looked up last: it takes longer than both comparisons.
            dx = _between(x0, x1, going_bounds[other, 0, 0], going_bounds[other, 0, 1])
            going = _near(dx, _between(y0, y1, going_bounds[other, 0, 2], going_bounds[other, 0, 3]), touching)
            dx = _between(x0, x1, yielding_bounds[other, 0, 0], yielding_bounds[other, 0, 1])
            waiting = _near(dx, _between(y0, y1, yielding_bounds[other, 0, 2], yielding_bounds[other, 0, 3]), touching)
            if not (going or waiting):
                continue
            waits = goes_first(me, other, precedence)
            if not (waiting if waits else going):
                continue
            expected = yielding if waits else boxes
            their_x, their_y, their_cos, their_sin = expected.x, expected.y, expected.cos, expected.sin
            if blame.walks[i]:
                person, half = now.person[other], 0.5 * now.width[me] + ROOM
                real = Box(now_cos[other], now_sin[other], now.length[other], now.width[other])
                away = _room(now_x[other] - now_x[me], now_y[other] - now_y[me], real, person, half)
                keeps = 0.5 * (size[me, 1] - now.width[me] + size[other, 1] - now.width[other])
                nearest = min(away, 0.0) - SLACK if away < keeps else keeps
                # One that walks may stop, and one that stands may start: the later row leaves the earlier one the way.
                starts = now.stands[me] and now.starts[other] and other < me
                if person and (starts or not now.stands[other]):
                    ahead = START if starts else 0.0
                    there_x, there_y = now_x[other] + ahead * now_cos[other], now_y[other] + ahead * now_sin[other]
                    dx, dy = there_x - now_x[me], there_y - now_y[me]
                    least_room = min(_room(dx, dy, real, person, half), 0.0) - SLACK
                    for mode in range(modes):
                        dx, dy = there_x - x[i, 0, mode], there_y - y[i, 0, mode]
                        creeps = now.stands[me] and paths.distance[i, 0, mode] > STILL
                        goes = speed[i, 0, mode] > STANDING or creeps
                        c, s = cos[i, 0, mode], sin[i, 0, mode]
                        if (
                            goes
                            and _room(dx, dy, real, person, half) < least_room
                            and not apart(
                                levels, x[i, 0, mode], y[i, 0, mode], c, s, there_x, there_y, real.cos, real.sin
                            )
                        ):
                            first[mode], counts[mode] = 0, 1.0
                for step in range(steps):
                    there_x, there_y = their_x[other, step], their_y[other, step]
                    there_c, there_s = their_cos[other, step], their_sin[other, step]
                    if now.stands[other]:
                        # Not on its path: in a turn a car stands up to 0.3 m beside that.
                        there_x, there_y, there_c, there_s = now_x[other], now_y[other], real.cos, real.sin
                    dx = _between(bounds[i, step, 0], bounds[i, step, 1], there_x, there_x)
                    if not _near(dx, _between(bounds[i, step, 2], bounds[i, step, 3], there_y, there_y), touching):
                        continue
                    theirs = Box(there_c, there_s, now.length[other], now.width[other])
                    for mode in range(modes):
                        dx, dy = there_x - x[i, step, mode], there_y - y[i, step, mode]
                        if not _near(dx, dy, touching) or first[mode] <= step:
                            continue
                        c, s = cos[i, step, mode], sin[i, step, mode]
                        if _room(dx, dy, theirs, person, half) < nearest and not apart(
                            levels, x[i, step, mode], y[i, step, mode], c, s, there_x, there_y, there_c, there_s
                        ):
                            stood = speed[i, step, mode] <= STANDING and not now.stands[other]
                            stood &= not now.stands[me] or paths.distance[i, step, mode] <= STILL
                            first[mode], counts[mode] = step, blame.standing[i] if stood else 1.0
                continue
            # In contact, what separates the two, or keeps them as they are, is no collision: else none could go on.
            least = clearance(
                now_x[other] - now_x[me],
                now_y[other] - now_y[me],
                Box(now_cos[me], now_sin[me], size[me, 0], size[me, 1]),
                Box(now_cos[other], now_sin[other], size[other, 0], size[other, 1]),
            )
            contact = least < 0.0
            deepest = least - (PAST_STANDING if now.stands[other] else DEEPER)
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
                    stood = speed[i, step, mode] <= STANDING
                    if stood and blame.standing[i] == 0.0:
                        continue
                    # One that comes from behind cannot be avoided, nor one beside the rear, which swings out in a turn.
                    if blame.in_front[i] and c * dx + s * dy <= 0.0:
                        # Ahead an interval before, it is driven through: at 12 m/s intervals are 5 m long.
                        if step == 0:
                            before = now_cos[me] * (now_x[other] - now_x[me])
                            before += now_sin[me] * (now_y[other] - now_y[me])
                        else:
                            before = cos[i, step - 1, mode] * (their_x[other, step - 1] - x[i, step - 1, mode])
                            before += sin[i, step - 1, mode] * (their_y[other, step - 1] - y[i, step - 1, mode])
                        if before <= 0.0:
                            continue
                    mine = Box(c, s, size[me, 0], size[me, 1])
                    there_c, there_s = their_cos[other, step], their_sin[other, step]
                    theirs = Box(there_c, there_s, size[other, 0], size[other, 1])
                    if (
                        overlap(dx, dy, mine, theirs)
                        and not (contact and clearance(dx, dy, mine, theirs) > deepest)
                        and not apart(
                            levels, x[i, step, mode], y[i, step, mode], c, s, there_x, there_y, there_c, there_s
                        )
                    ):
                        first[mode], counts[mode] = step, blame.standing[i] if stood and not now.stands[other] else 1.0
        if candidates:
            for mode in range(modes):
                scores[i, mode] = counts[mode] * (1.0 - first[mode] / steps)
    return scores


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
