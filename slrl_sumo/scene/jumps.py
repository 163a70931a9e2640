"""Jumps of road users between two moments, which are no motion."""

import numpy as np

from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

# SUMO places road users on lanes, so those that change lane or walking direction at once jump sideways or turn on the
# spot. What a type cannot do within 0.4 s is a jump of the model, not a motion to learn: the track is split there.
MAX_SPEED = np.array([60.0, 15.0, 5.0])
"""m/s per RoadUserType."""
MAX_TURN = np.array([0.8, 1.6, 3.2])
"""rad in one interval per RoadUserType."""
MAX_SIDESTEP = np.array([1.5, 1.0, 5.0])
"""m across the heading in one interval per RoadUserType."""


def jumped(before: WorldState, after: WorldState) -> list[str]:
    """Ids in both worlds (0.4 s apart) whose motion between them is more than their type can do."""
    row_before = {road_user: i for i, road_user in enumerate(before.ids)}
    rows = np.array([i for i, road_user in enumerate(after.ids) if road_user in row_before], np.intp)
    old = np.array([row_before[after.ids[i]] for i in rows], np.intp)
    dx, dy = after.x[rows] - before.x[old], after.y[rows] - before.y[old]
    kind = after.type[rows]
    turn = np.abs(wrap_angle(after.heading[rows] - before.heading[old]))
    middle = before.heading[old] + 0.5 * wrap_angle(after.heading[rows] - before.heading[old])
    aside = np.abs(np.cos(middle) * dy - np.sin(middle) * dx)
    odd = np.hypot(dx, dy) > MAX_SPEED[kind] * DECISION_INTERVAL
    odd |= (turn > MAX_TURN[kind]) | (aside > MAX_SIDESTEP[kind])
    return [after.ids[i] for i in rows[odd]]
