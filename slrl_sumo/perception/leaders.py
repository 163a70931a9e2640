"""The leader of each road user: the next one on its own path."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import AHEAD, RouteAhead, beside, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

SIDE_GAP = np.array([0.25, 0.25, 0.1])
"""m of clearance beside a box from which another road user is no leader, by the type of the follower."""
NEAREST = np.array([0.5, 0.5, 0.25])
"""m ahead from which a road user can be a leader: one beside the follower is none."""
ALIKE = 1.1
"""rad between the directions of a path and of a road user on it, beyond which it crosses the path and does not lead."""
STANDING = 0.5
"""m/s below which any road user on the path counts, whatever its direction."""
COS_ALIKE = math.cos(ALIKE)
PEDESTRIAN = int(RoadUserType.PEDESTRIAN)


class _Users(NamedTuple):
    """All road users of a world, (m,) each."""

    type: NDArray[np.int8]
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats


class _Pairs(NamedTuple):
    """Followers and road users beside their paths, (p,), and where these are on the path, (p, 1) each."""

    follower: NDArray[np.intp]
    other: NDArray[np.intp]
    along: Floats
    """m."""
    lateral_offset: Floats
    """m."""
    direction: Floats
    """rad, of the path."""


def leaders(route: RouteAhead, world: WorldState) -> tuple[Floats, Floats]:
    """Gap between boxes along the path (m, inf: no leader within sight) and speed along it (m/s) of the nearest road
    user on the path of each of the n road users of `route`, the first ones of `world`: (n,) each."""
    n = len(route)
    if len(world) < 2:
        return np.full(n, np.inf), np.zeros(n)
    room, reach = SIDE_GAP[world.type] + 0.5 * world.width, 0.5 * np.hypot(world.length, world.width)
    follower, other = beside(route, room, world.x, world.y, reach)
    pairs = _Pairs(follower, other, *on_path(route, world.x[other, None], world.y[other, None], follower))
    return _leaders(n, pairs, _Users(world.type, world.heading, world.speed, world.length, world.width))


@compiled
def _leaders(n: int, pairs: _Pairs, users: _Users) -> tuple[Floats, Floats]:
    gap, leading = np.full(n, math.inf), np.zeros(n)
    for pair in range(len(pairs.follower)):
        ego, other, along = pairs.follower[pair], pairs.other[pair], pairs.along[pair, 0]
        kind, length, width = users.type[ego], users.length[other], users.width[other]
        if not NEAREST[kind] < along < AHEAD + 0.5 * length:
            continue
        turn = users.heading[other] - pairs.direction[pair, 0]
        same, across = math.cos(turn), abs(math.sin(turn))
        ahead, wide = abs(same) * length + across * width, across * length + abs(same) * width
        if abs(pairs.lateral_offset[pair, 0]) - 0.5 * wide - 0.5 * users.width[ego] >= SIDE_GAP[kind]:
            continue
        # Pedestrians walk around a road user in their way, unless it waits where they want to wait.
        if not (same > COS_ALIKE or (kind != PEDESTRIAN and users.speed[other] < STANDING)):
            continue
        between = along - 0.5 * ahead - 0.5 * users.length[ego]
        if between < gap[ego]:
            gap[ego], leading[ego] = between, max(users.speed[other] * same, 0.0)
    return gap, leading
