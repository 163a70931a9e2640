"""The feature vector: own motion, and numbers of road users nearby (paper, section 3.1)."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CAR = int(RoadUserType.CAR)
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

    All road users of the world count, learned or background, except the road user itself. Where `world` holds several
    separate scenes, `scene` (n,) is the scene of each road user.
    """
    scene = np.zeros(len(world), np.int64) if scene is None else scene
    # Scene by scene, from west to east: near road users are neighbours in this order.
    order = np.lexsort((world.x, scene))
    own = np.column_stack([world.speed[rows], world.acceleration[rows], world.heading[rows]])
    return _table(own, world.x, world.y, world.type, scene, rows, order)


@compiled
def _table(
    own: Floats,
    x: Floats,
    y: Floats,
    kinds: NDArray[np.int8],
    scene: NDArray[np.int64],
    rows: NDArray[np.intp],
    order: NDArray[np.intp],
) -> NDArray[np.float32]:
    """`own`: speed, acceleration and heading of `rows`, (len(rows), 3); `order`: all road users by scene, then by x."""
    table = np.zeros((len(rows), 2 + 3 + 1 + 2 * len(RADII)), np.float32)
    place = np.empty(len(order), np.intp)
    place[order] = np.arange(len(order))
    for i in range(len(rows)):
        ego = rows[i]
        table[i, 0], table[i, 1], table[i, 5] = own[i, 0], own[i, 1], own[i, 2]
        table[i, 2 + kinds[ego]] = 1.0
        for step in (-1, 1):
            k = place[ego] + step
            while 0 <= k < len(order):
                other = order[k]
                dx, dy = x[other] - x[ego], y[other] - y[ego]
                if abs(dx) > RADII[-1] or scene[other] != scene[ego]:
                    break
                distance = math.sqrt(dx * dx + dy * dy)
                first = 6 + len(RADII) * (kinds[other] == CAR)
                for ring in range(len(RADII)):
                    table[i, first + ring] += distance <= RADII[ring]
                k += step
    return table
