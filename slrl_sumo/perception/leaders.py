"""Leaders: the next road user on the path of each ego road user."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import apart
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.route import AHEAD, SPACING, RouteAhead, beside, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN

SIDE_GAP = np.array([0.25, 0.25, 0.1])
"""Lateral clearance (m) from which another road user is no leader, by the type of the follower; 0 for vehicles beside a
standing road user."""
NEAREST = np.array([0.5, 0.5, 0.25])
"""Least distance (m) ahead of a leader, by the type of the follower: a road user beside the follower is no leader."""
ALIKE = 1.1
"""Angle (rad) between the directions of a path and of a road user on it beyond which the road user crosses the path and
is no leader."""
BESIDE = 0.3
"""Distance (m) by which a road user beside the follower may reach into its way without being its leader."""
IN_WAY = 10.0
"""Distance (m) ahead within which a road user is in the way: it must clear the path first."""
APPROACH = 3.0
"""Distance (m) along its path in which a vehicle beside the path comes 1 m nearer to it, as in a lane change at 3 to
5 m/s. Until then the vehicle needs the room between: otherwise a vehicle that leaves a queue hits the last vehicle of
the queue with its corner."""
FARTHEST = 5.0
"""Greatest lateral offset (m) for which a vehicle needs room to return to its path."""
STANDING = 0.5
"""Speed (m/s) below which any road user on the path of a vehicle counts as leader, whatever its direction."""
BRAKES = 4.0
"""Greatest expected deceleration (m/s²) of a leader."""
COS_ALIKE = math.cos(ALIKE)


class _Users(NamedTuple):
    """All road users of a world, (m,) each."""

    type: NDArray[np.int8]
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats


class _Pairs(NamedTuple):
    """Pairs of a follower and a road user near its path, (p,), and the positions of the latter on the path, (p, 1)."""

    follower: NDArray[np.intp]
    other: NDArray[np.intp]
    along: Floats
    """Distance along the path, m."""
    lateral_offset: Floats
    """Lateral offset from the path, m."""
    direction: Floats
    """Direction of the path, rad."""


class Leaders(NamedTuple):
    """Leaders of n road users, and the road users that are in the way of vehicles."""

    gap: Floats
    """Gap (m) between the boxes along the path, (n,); inf without a leader within sight."""
    speed: Floats
    """Speed (m/s) of the leader along the path, (n,)."""
    row: NDArray[np.int64]
    """Row of the leader in the world, (n,); -1 without a leader."""
    stop: Floats
    """Distance (m) to the nearest position where a road user on the path could come to a stop, (n,); inf without one.
    It need not be the leader: a road user that stands farther ahead counts, too, before the leader leaves the path."""
    stop_speed: Floats
    """Speed (m/s) of that road user along the path, (n,)."""
    in_way: NDArray[np.int64]
    """Sorted `way_code` of each pair of a vehicle and a road user in its way, (p,): the box of the latter is on the
    path of the vehicle, within IN_WAY m ahead of its front, whatever the direction."""


@compiled
def way_code(ego: int, other: int, users: int) -> int:
    """One number for the pair of rows `ego` and `other` of a world with `users` road users."""
    return ego * users + other


def leaders(
    route: RouteAhead, world: WorldState, lateral_offset: Floats, threads: RowThreads = ONE, levels: Levels = FLAT
) -> Leaders:
    """The leaders of the n road users of `route`, the first road users of `world`.

    A leader is the nearest road user on the path and on the same level (`levels`). `lateral_offset`: m to the left of
    the own path, (n,).
    """
    n = len(route)
    if len(world) < 2:
        return Leaders(
            np.full(n, np.inf), np.zeros(n), np.full(n, -1), np.full(n, np.inf), np.zeros(n), np.zeros(0, np.int64)
        )
    aside = np.zeros(len(world))
    driving = world.type[:n] != PEDESTRIAN
    aside[:n] = np.where(driving & route.known, np.clip(lateral_offset, -FARTHEST, FARTHEST), 0.0)
    room, reach = SIDE_GAP[world.type] + 0.5 * world.width + np.abs(aside), 0.5 * np.hypot(world.length, world.width)

    def paired(some: slice) -> _Pairs:
        follower, other = beside(route, room, world.x, world.y, reach, some)
        return _Pairs(follower, other, *on_path(route, world.x[other, None], world.y[other, None], follower))

    parts = threads.each(paired, n)
    pairs = parts[0] if len(parts) == 1 else _Pairs(*map(np.concatenate, zip(*parts, strict=True)))
    users = _Users(world.type, world.x, world.y, world.heading, world.speed, world.length, world.width)
    gap, speed, row, stop, stop_speed, in_way = _leaders(n, pairs, users, aside, route.spacing, levels)
    return Leaders(gap, speed, row, stop, stop_speed, np.sort(in_way))


@compiled
def _leaders(
    n: int, pairs: _Pairs, users: _Users, aside: Floats, spacing: Floats, levels: Levels
) -> tuple[Floats, Floats, NDArray[np.int64], Floats, Floats, NDArray[np.int64]]:
    gap, leading, row = np.full(n, math.inf), np.zeros(n), np.full(n, -1)
    stop, stopping = np.full(n, math.inf), np.zeros(n)
    in_way, found = np.empty(len(pairs.follower), np.int64), 0
    for pair in range(len(pairs.follower)):
        ego, other, along = pairs.follower[pair], pairs.other[pair], pairs.along[pair, 0]
        kind, length, width = users.type[ego], users.length[other], users.width[other]
        if not NEAREST[kind] < along < AHEAD * spacing[ego] / SPACING + 0.5 * length:
            continue
        turn = users.heading[other] - pairs.direction[pair, 0]
        same, across = math.cos(turn), abs(math.sin(turn))
        ahead, wide = abs(same) * length + across * width, across * length + abs(same) * width
        between = along - 0.5 * ahead - 0.5 * users.length[ego]
        # Lateral range that the follower sweeps on its return to the path.
        span = aside[ego] * max(1.0 - max(between, 0.0) / (APPROACH * abs(aside[ego])), 0.0) if aside[ego] else 0.0
        off = pairs.lateral_offset[pair, 0]
        clear = abs(off - min(max(off, min(span, 0.0)), max(span, 0.0))) - 0.5 * wide - 0.5 * users.width[ego]
        stands = kind != PEDESTRIAN and users.speed[other] < STANDING
        if clear >= (0.0 if stands else SIDE_GAP[kind]) or _on_another_level(levels, users, other, pairs, pair):
            continue
        if kind != PEDESTRIAN and between < IN_WAY:
            in_way[found] = way_code(ego, other, len(users.type))
            found += 1
        # Pedestrians walk around a moving road user in their way; a standing one may wait where they want to wait.
        walks = kind == PEDESTRIAN and users.speed[other] >= STANDING
        if walks or not (same > COS_ALIKE or stands):
            continue
        # A road user beside the follower is no leader, unless the follower would drive into it.
        if between < 0.0 and clear > -BESIDE:
            continue
        theirs = max(users.speed[other] * same, 0.0)
        if between < gap[ego]:
            gap[ego], leading[ego], row[ego] = between, theirs, other
        if between + theirs * theirs / (2.0 * BRAKES) < stop[ego]:
            stop[ego], stopping[ego] = between + theirs * theirs / (2.0 * BRAKES), theirs
    return gap, leading, row, stop, stopping, in_way[:found]


@compiled
def _on_another_level(levels: Levels, users: _Users, other: int, pairs: _Pairs, pair: int) -> bool:
    """Whether a road user is above or below the path beside it."""
    if len(levels.x) == 0:
        return False
    x, y, aside = users.x[other], users.y[other], pairs.lateral_offset[pair, 0]
    theirs_c, theirs_s = math.cos(users.heading[other]), math.sin(users.heading[other])
    c, s = math.cos(pairs.direction[pair, 0]), math.sin(pairs.direction[pair, 0])
    return apart(levels, x, y, theirs_c, theirs_s, x + aside * s, y - aside * c, c, s)
