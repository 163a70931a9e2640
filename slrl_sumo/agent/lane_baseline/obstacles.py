"""Road users on the paths of driven vehicles, including road users that SUMO has on other lanes or on none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.forecast import forecast
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.safe_speed import safe_speeds
from slrl_sumo.background.swept_boxes import sweep
from slrl_sumo.background.swept_conflicts import approaching, conflicts, cosine_at_touch, speed_along, touched
from slrl_sumo.scene.geometry import Floats, cos_sin, front_from_centre
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

STANDING = 0.3
"""Speed (m/s) below which a road user stands."""
MARGIN = 0.3
"""Lateral clearance (m) to standing persons."""
GRAZE = 0.4
"""Distance (m) by which boxes of vehicles may overlap."""


@dataclass(frozen=True)
class Approach:
    """The paths and limits of n driven vehicles, as arguments of `swept_boxes.sweep`."""

    rows: NDArray[np.intp]
    """Rows of the vehicles in the world, (n,)."""
    path_x: Floats
    """Points ahead every `SPACING` m, (n, k), the first beside the front."""
    path_y: Floats
    room: Floats
    """Distance (m) to the end of the path, (n,)."""
    speed: Floats
    limits: Floats
    """Acceleration, deceleration, emergency deceleration, (n, 3), m/s²."""
    ignores_standing: NDArray[np.bool_]
    """Whether the vehicle ignores standing vehicles, (n,)."""


def slowed(approach: Approach, world: WorldState, dt: float, levels: Levels = FLAT) -> tuple[Floats, NDArray[np.bool_]]:
    """Speeds (m/s) that road users on the paths allow, and whether the decisive road user stands, (n,) each.

    The speed is inf on free paths. Persons are predicted as in `yielding`; vehicles count at their present positions.
    """
    rows, n = approach.rows, len(approach.rows)
    length, heading = world.length[rows], world.heading[rows]
    front_x, front_y = front_from_centre(world.x[rows], world.y[rows], heading, length)
    size = np.column_stack([length, world.width[rows]])
    ahead = sweep(approach.path_x, approach.path_y, approach.room, front_x, front_y, heading, size)
    reach = SPACING * approach.path_x.shape[1] + 0.5 * length
    spread = 0.5 * world.length + 2.0
    dx, dy = world.x[rows][:, None] - world.x, world.y[rows][:, None] - world.y
    near = dx * dx + dy * dy < (reach[:, None] + spread) ** 2
    near[np.arange(n), rows] = False
    walks = world.type == RoadUserType.PEDESTRIAN
    stands = (world.speed < STANDING) & ~walks
    near &= ~(approach.ignores_standing[:, None] & stands[None, :])
    # Road users behind a vehicle are no obstacles.
    c, s = cos_sin(heading[:, None])
    near &= -(c * dx + s * dy) > -0.5 * length[:, None] - spread
    safe, standing = np.full(n, np.inf), np.zeros(n, np.bool_)
    boxes, moments, _ = forecast(world)
    moments = np.where(walks, moments, 1)
    # In SUMO's networks, boxes of vehicles that drive straight on overlap boxes of vehicles that wait to turn.
    boxes[~walks, :, 3:] -= GRAZE
    narrow = ahead._replace(width=np.maximum(ahead.width - GRAZE, 0.3))
    for others, mine in ((walks, ahead), (~walks, narrow)):
        vehicle, other = np.nonzero(near & others)
        close = approaching(approach.path_x, approach.path_y, size, vehicle, boxes, other, MARGIN)
        vehicle, other = vehicle[close], other[close]
        if not len(vehicle):
            continue
        count, certain = moments[other], np.full(len(other), np.inf)
        margin = np.where((count == 1) & walks[other], MARGIN, 0.0)
        enter, leave = conflicts(mine, vehicle, boxes, other, moments, margin, levels)
        cosine = cosine_at_touch(mine, vehicle, touched(enter), boxes, other)
        leading = speed_along(cosine, world.speed[other])
        mine_speed, limits = approach.speed[vehicle], approach.limits[vehicle]
        target, _ = safe_speeds(enter, leave, leading, count, certain, mine_speed, limits, dt, 0.0)
        np.minimum.at(safe, vehicle, target)
        decides = target <= safe[vehicle] + 1e-9
        standing[vehicle[decides]] = stands[other[decides]]
    return safe, standing
