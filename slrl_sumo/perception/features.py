"""What a road user knows as numbers: its own motion and how many others are near (paper, section 3.1)."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

RADII = (5.0, 10.0, 20.0)
"""Distances in m within which others are counted, from centre to centre, inclusive."""

FEATURES: tuple[str, ...] = (
    "speed",
    "acceleration",
    "car",
    "bicycle",
    "pedestrian",
    "heading",
    "vru_5",
    "vru_10",
    "vru_20",
    "other_5",
    "other_10",
    "other_20",
)
"""Columns of `features`: m/s, m/s², one-hot type, rad, then counts of VRUs and of all others within each radius."""


def features(world: WorldState, rows: NDArray[np.intp], scene: NDArray[np.int64] | None = None) -> NDArray[np.float32]:
    """The vector of the road users `rows` of `world`, (len(rows), 12), columns as in FEATURES, not normalised.

    All road users of the world are counted, learned or background, except the road user itself. Where `world` holds
    several scenes that do not see each other, `scene` (n,) says which one each road user belongs to.
    """
    table = np.zeros((len(rows), len(FEATURES)), np.float32)
    if len(rows) == 0:
        return table
    own_type = world.type[rows]
    table[:, 0] = world.speed[rows]
    table[:, 1] = world.acceleration[rows]
    table[np.arange(len(rows)), 2 + own_type] = 1.0
    table[:, 5] = world.heading[rows]
    table[:, 6:] = _counts(world, rows, scene)
    return table


def _counts(world: WorldState, rows: NDArray[np.intp], scene: NDArray[np.int64] | None) -> NDArray[np.intp]:
    """VRUs within each radius, then non-VRUs within each radius, (len(rows), 6)."""
    # Scenes lie one above the other, out of sight: within one the distances are those in the plane, to the bit.
    height = [] if scene is None else [4 * RADII[-1] * scene]
    everyone = np.stack([world.x, world.y, *height], axis=1)
    # One search for the largest radius, then counting by ring: several times quicker than a search per radius and kind.
    # Distances are compared again below, so the search may be a little wider than the radius.
    pairs = cKDTree(everyone[rows]).sparse_distance_matrix(
        cKDTree(everyone), RADII[-1] * (1 + 1e-9), output_type="ndarray"
    )
    ego, other = pairs["i"], pairs["j"]
    ring = np.searchsorted(RADII, pairs["v"])  # 0: within the first radius, …, len(RADII): beyond the last
    kind = (world.type[other] == RoadUserType.CAR).astype(np.intp)
    counted = (ring < len(RADII)) & (rows[ego] != other)
    cell = ((ego * 2 + kind) * len(RADII) + ring)[counted]
    by_ring = np.bincount(cell, minlength=len(rows) * 2 * len(RADII)).reshape(len(rows), 2, len(RADII))
    return by_ring.cumsum(axis=2).reshape(len(rows), 2 * len(RADII))
