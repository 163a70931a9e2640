"""Who drives or stands ahead of road users on their own path."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slrl_sumo.world.geometry import Floats, wrap_angle
from slrl_sumo.world.route import AHEAD, RouteAhead, on_path
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

SIDE_GAP = np.array([0.25, 0.25, 0.1])
"""m that must stay free beside a box for others to be no leader, by the type of who follows."""
NEAREST = np.array([0.5, 0.5, 0.25])
"""m ahead from which somebody leads: who is beside us is nobody's leader."""
ALIKE = 1.1
"""rad between the directions of a path and of somebody on it, beyond which that one crosses it, and does not lead."""
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
    middle = np.column_stack([route.x[:, route.x.shape[1] // 2], route.y[:, route.y.shape[1] // 2]])
    everyone = cKDTree(np.column_stack([world.x, world.y]))
    pairs = cKDTree(middle).sparse_distance_matrix(everyone, 0.75 * AHEAD + 10.0, output_type="ndarray")
    ego, other = pairs["i"], pairs["j"]
    chosen = route.known[ego] & (ego != other)
    ego, other = ego[chosen], other[chosen]
    if not len(ego):
        return Leaders(gap, speed)
    mine = route.take(ego)
    along, aside, direction = (c[:, 0] for c in on_path(mine, world.x[other][:, None], world.y[other][:, None]))
    turn = wrap_angle(world.heading[other] - direction)
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
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
    speed[ego[order]] = np.maximum(world.speed[other[order]] * np.cos(turn[order]), 0.0)
    return Leaders(gap, speed)
