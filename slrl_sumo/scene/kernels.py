"""Angles, boxes, levels and motion of single road users, for compiled loops of other modules."""

import math

from slrl_sumo.scene import geometry, levels
from slrl_sumo.scene.compiled import compiled

wrapped = compiled(geometry.wrapped)
overlap = compiled(geometry.overlap)
clearance = compiled(geometry.clearance)
apart = compiled(levels.apart)


@compiled
def moved(x: float, y: float, heading: float, distance: float, turn: float) -> tuple[float, float, float]:
    """Position (m) and heading (rad, not wrapped) after `distance` m and a `turn` (rad) at constant speed and yaw rate.

    The displacement is `distance` long, along the mean heading.
    """
    middle = heading + 0.5 * turn
    return x + distance * math.cos(middle), y + distance * math.sin(middle), heading + turn
