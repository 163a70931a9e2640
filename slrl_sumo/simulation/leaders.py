"""Who drives or stands ahead of road users on their own path."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.world.geometry import Floats, cos_sin, wrap_angle
from slrl_sumo.world.route import AHEAD, HERE, POINTS, SPACING, RouteAhead, on_path
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

SIDE_GAP = np.array([0.25, 0.25, 0.1])
"""m that must stay free beside a box for others to be no leader, by the type of who follows."""
NEAREST = np.array([0.5, 0.5, 0.25])
"""m ahead from which somebody leads: who is beside us is nobody's leader."""
ALIKE = 1.1
"""rad between the directions of a path and of somebody on it, beyond which that one crosses it, and does not lead."""
PIECE = 8
"""Points of a path that one box is laid round."""
STANDING = 0.5
"""m/s below which whoever is on the path counts, whatever the direction."""


@dataclass(frozen=True, eq=False)
class Leaders:
    """Of n road users with routes: the gap between boxes along the path (m, inf: nobody within sight), and the
    leader's speed along it (m/s)."""

    gap: Floats
    speed: Floats


def leaders(route: RouteAhead, world: WorldState) -> Leaders:
    """The nearest road user on the path of each of the first n road users of `world`, n being those of `route`."""
    n = len(route)
    gap, speed = np.full(n, np.inf), np.zeros(n)
    if not route.known.any() or len(world) < 2:
        return Leaders(gap, speed)
    ego, other = _near(route, world)
    if not len(ego):
        return Leaders(gap, speed)
    along, aside, direction = (c[:, 0] for c in on_path(route, world.x[other, None], world.y[other, None], ego))
    turn = wrap_angle(world.heading[other] - direction)
    same, across = cos_sin(turn)
    c, s = np.abs(same), np.abs(across)
    length, width = world.length[other], world.width[other]
    beside = np.abs(aside) - 0.5 * (s * length + c * width) - 0.5 * world.width[ego]
    between = along - 0.5 * (c * length + s * width) - 0.5 * world.length[ego]
    kind = world.type[ego]
    ahead = (along > NEAREST[kind]) & (along < AHEAD + 0.5 * length)
    # People walk round who stands in their way, unless it waits where they want to wait.
    drives = kind != RoadUserType.PEDESTRIAN
    leads = (np.abs(turn) < ALIKE) | (drives & (world.speed[other] < STANDING))
    rows = np.flatnonzero((beside < SIDE_GAP[kind]) & ahead & leads)
    order = rows[np.argsort(-between[rows], kind="stable")]
    # The nearest one is written last.
    gap[ego[order]] = between[order]
    speed[ego[order]] = np.maximum(world.speed[other[order]] * same[order], 0.0)
    return Leaders(gap, speed)


def _near(route: RouteAhead, world: WorldState) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs that may matter, (p,) each: who has a route, and who may touch its way somewhere ahead."""
    middle = np.column_stack([route.x[:, POINTS // 2], route.y[:, POINTS // 2]])
    everyone = cKDTree(np.column_stack([world.x, world.y]))
    pairs = cKDTree(middle).sparse_distance_matrix(everyone, 0.75 * AHEAD + 10.0, output_type="ndarray")
    ego, other = pairs["i"], pairs["j"]
    # Most others that are near are beside every piece of the path: a circle round all of it, and boxes round every
    # PIECE points, say so without a look at all of its points.
    ends = [(first, min(first + PIECE, POINTS - 1)) for first in range(HERE, POINTS - 1, PIECE)]
    low_x, high_x, low_y, high_y = (
        np.stack([f(points[:, first : last + 1], axis=1) for first, last in ends], axis=1)
        for points in (route.x, route.y)
        for f in (np.min, np.max)
    )
    left, right, below, above = low_x.min(axis=1), high_x.max(axis=1), low_y.min(axis=1), high_y.max(axis=1)
    radius = 0.5 * np.hypot(right - left, above - below)
    diagonal, half = SIDE_GAP.max() + 0.5 * np.hypot(world.length, world.width), 0.5 * world.length + SPACING
    beyond = (diagonal[other] + 0.5 * world.width[ego]) * _outside_corners(route)[ego] + half[other]
    dx, dy = (0.5 * (left + right))[ego] - world.x[other], (0.5 * (below + above))[ego] - world.y[other]
    near = (dx * dx + dy * dy <= (radius[ego] + beyond) ** 2) & route.known[ego] & (ego != other)
    ego, other, beyond = ego[near], other[near], beyond[near]
    x, y = world.x[other, None], world.y[other, None]
    outside = np.maximum(low_x[ego] - x, x - high_x[ego])
    outside = np.maximum(outside, np.maximum(low_y[ego] - y, y - high_y[ego]))
    chosen = (outside <= beyond[:, None]).any(axis=1)
    return ego[chosen], other[chosen]


def _outside_corners(route: RouteAhead) -> Floats:
    """How many times as far from a path as beside it somebody may be, outside its sharpest corner, (n,)."""
    dx, dy = np.diff(route.x), np.diff(route.y)
    length = np.hypot(dx, dy)
    both = length[:, 1:] * length[:, :-1]
    turn = np.divide(
        dx[:, 1:] * dx[:, :-1] + dy[:, 1:] * dy[:, :-1], both, out=np.full_like(both, -1.0), where=both > 0
    )
    # Who lies behind the piece after the corner counts as ahead of the one before it.
    return np.asarray(1.0 / np.maximum(turn.min(axis=1), 1e-6))
