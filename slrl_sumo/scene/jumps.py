"""Jumps of road users between two times, which are not motions."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

# SUMO places road users on lanes: at a lane change, or a change of walking direction, they jump sideways or turn on the
# spot. A motion that a type cannot perform within 0.4 s is a jump of SUMO's model, not a motion to learn: the track is
# split there.
MAX_SPEED = np.array([60.0, 15.0, 5.0])
"""Greatest speed (m/s) by RoadUserType."""
MAX_TURN = np.array([0.8, 1.6, 3.2])
"""Greatest turn (rad) in one interval by RoadUserType."""
MAX_SIDESTEP = np.array([1.5, 1.0, 5.0])
"""Greatest lateral displacement (m) in one interval by RoadUserType."""


def jumped(before: WorldState, after: WorldState) -> list[str]:
    """Ids of road users in both worlds (0.4 s apart) whose motion between them exceeds the limits of their type."""
    row_before = {road_user: i for i, road_user in enumerate(before.ids)}
    rows = np.array([i for i, road_user in enumerate(after.ids) if road_user in row_before], np.intp)
    old = np.array([row_before[after.ids[i]] for i in rows], np.intp)
    odd = beyond_type(
        after.type[rows],
        dx=after.x[rows] - before.x[old],
        dy=after.y[rows] - before.y[old],
        heading=before.heading[old],
        turn=wrap_angle(after.heading[rows] - before.heading[old]),
    )
    return [after.ids[i] for i in rows[odd]]


def beyond_type(
    kind: NDArray[np.int8],
    *,
    dx: Floats,
    dy: Floats,
    heading: Floats,
    turn: Floats,
    seconds: float = DECISION_INTERVAL,
) -> NDArray[np.bool_]:
    """Whether motions within `seconds` (at least 0.4 s) exceed the limits of their type, (n,).

    `kind`: RoadUserType. `dx`, `dy`: displacement, m. `heading`: before the motion, rad. `turn`: during the motion,
    rad, from -pi to pi. All (n,). The limits grow with the time.
    """
    middle = heading + 0.5 * turn
    aside = np.abs(np.cos(middle) * dy - np.sin(middle) * dx)
    share = seconds / DECISION_INTERVAL
    odd = np.hypot(dx, dy) > MAX_SPEED[kind] * seconds
    return odd | (np.abs(turn) > MAX_TURN[kind] * share) | (aside > MAX_SIDESTEP[kind] * share)
