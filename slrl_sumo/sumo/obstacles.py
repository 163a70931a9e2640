"""What lies on the ways of driven vehicles, whether SUMO has it on their lane or not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.paths import SPACING, sweep
from slrl_sumo.sumo.yielding import MOMENTS, meetings, predicted, safe_speeds
from slrl_sumo.world.geometry import Floats, front_from_centre
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

STANDING = 0.3
"""m/s."""


@dataclass(frozen=True)
class Approach:
    """The ways of n driven vehicles, as `paths.sweep` wants them."""

    rows: NDArray[np.intp]
    """Their rows in the world, (n,)."""
    path_x: Floats
    """Points ahead every `SPACING` m, (n, k), the first beside the front."""
    path_y: Floats
    room: Floats
    """m to the end of the way, (n,)."""
    speed: Floats
    limits: Floats
    """Acceleration, deceleration, emergency deceleration, (n, 3), m/s²."""
    heedless: NDArray[np.bool_]
    """Who does not mind vehicles that stand, (n,)."""


def slowed(approach: Approach, world: WorldState, dt: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Speeds (n,) that what lies on the ways allows (m/s, inf where nothing does), and where that is who stands, (n,).

    Persons are predicted as in `yielding`, vehicles are looked at where they are now.
    """
    rows, n, m = approach.rows, len(approach.rows), len(world)
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
    near &= ~(approach.heedless[:, None] & stands[None, :])
    # Behind us is nobody whom we could meet.
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    near &= -(c * dx + s * dy) > -0.5 * length[:, None] - spread
    vehicle, other = np.nonzero(near)
    safe, standing = np.full(n, np.inf), np.zeros(n, np.bool_)
    if not m or not len(vehicle):
        return safe, standing
    enter, leave = meetings(ahead, vehicle, predicted(world, MOMENTS), other, walks & (world.speed > 0.05))
    place = np.where(np.isfinite(enter), enter / SPACING, 0.0).astype(np.intp)
    turn = world.heading[other][:, None] - ahead.heading[vehicle[:, None], place]
    leading = np.maximum(world.speed[other][:, None] * np.cos(turn), 0.0)
    target, _ = safe_speeds(enter, leave, approach.speed[vehicle], leading, approach.limits[vehicle], dt)
    np.minimum.at(safe, vehicle, target)
    decides = target <= safe[vehicle] + 1e-9
    np.logical_or.at(standing, vehicle[decides], stands[other[decides]])
    return safe, standing
