"""Who touches whom."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.world.geometry import boxes_overlap
from slrl_sumo.world.state import WorldState

COLLISION_DISTANCE = 0.5
"""m between centres: the paper's definition of a collision (section 4.1)."""

Pairs = NDArray[np.intp]


def close_pairs(world: WorldState, distance: float) -> Pairs:
    """Pairs of road users whose centres are closer than `distance` (m): (p, 2) row indices, sorted, smaller first."""
    if len(world) < 2:
        return np.zeros((0, 2), np.intp)
    centres = np.column_stack([world.x, world.y])
    pairs = cKDTree(centres).query_pairs(distance, output_type="ndarray")
    apart = np.hypot(*(centres[pairs[:, 0]] - centres[pairs[:, 1]]).T)
    pairs = np.sort(pairs[apart < distance], axis=1).astype(np.intp)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def colliding_pairs(world: WorldState) -> Pairs:
    """Pairs in collision as the paper counts it: centres closer than 0.5 m. (p, 2), sorted."""
    return close_pairs(world, COLLISION_DISTANCE)


def overlapping_pairs(world: WorldState) -> Pairs:
    """Pairs whose boxes intersect. (p, 2), sorted."""
    if len(world) < 2:
        return np.zeros((0, 2), np.intp)
    reach = np.hypot(world.length, world.width)
    # A few long vehicles must not make everybody's search radius long: ordinary ones pair within their own reach.
    ordinary = max(float(np.median(reach)), 6.0)
    pairs = close_pairs(world, ordinary + 0.01)
    long = np.flatnonzero(reach > ordinary)
    if len(long):
        centres = np.column_stack([world.x, world.y])
        neighbours = cKDTree(centres).query_ball_point(centres[long], 0.5 * (reach[long] + reach.max()) + 0.01)
        extra = np.array([(i, j) for i, near in zip(long, neighbours, strict=True) for j in near if i != j], np.intp)
        if len(extra):
            pairs = np.unique(np.concatenate([pairs, np.sort(extra, axis=1)]), axis=0)
    boxes = np.column_stack([world.x, world.y, world.heading, world.length, world.width])
    return pairs[boxes_overlap(boxes[pairs[:, 0]], boxes[pairs[:, 1]])]
