"""Forecast of learned road users: along the path with a route, else with the present motion."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.kernels import moved, wrapped
from slrl_sumo.scene.route import HERE, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN

FORECAST_HORIZON = 4.0
"""Time (s) for which road users are predicted on their paths: a car brakes comfortably from 14 m/s within 3.1 s."""
MOTION_HORIZON = 1.5
"""Time (s) for which the present motion of a road user without a route is a valid prediction."""
MOMENTS = np.linspace(0.0, FORECAST_HORIZON, 11)
FORECAST_STANDING_SPEED = 0.05
"""Speed (m/s) below which road users are expected to stand; within FORECAST_HORIZON they would move by 0.2 m."""
SHARPEST_TURN = 1.0
"""Greatest expected yaw rate (rad/s)."""
RETURN_DISTANCE = 15.0
"""Distance (m) within which a road user beside its path, or turned away from it, is expected to return."""
ASTRAY, AGAINST = 5.0, 1.0
"""Lateral offset (m) and heading error (rad) from which a road user does not follow its path."""
STOPPING_DECELERATION = np.array([4.5, 3.0, 0.4])
"""Deceleration (m/s²) by RoadUserType with which a road user can stop to let a vehicle pass. Pedestrians walk on: for
1.6 s at 1.3 m/s."""


class Forecast(NamedTuple):
    """n road users at the q `MOMENTS`."""

    boxes: Floats
    """x, y (m), heading (rad), length, width (m), (n, q, 5)."""
    predicted: NDArray[np.intp]
    """Number of predicted moments, (n,): 1 for standing road users."""
    committed: Floats
    """Time (s) that a road user needs to stop, (n,): its motion until then is certain."""


class _Paths(NamedTuple):
    """Paths of n road users, see RouteAhead and RouteContext, and their positions on the paths, (n,)."""

    followed: NDArray[np.bool_]
    x: Floats
    y: Floats
    spacing: Floats
    along: Floats
    """m."""
    lateral_offset: Floats
    direction: Floats
    stop: Floats
    """Distance (m) to the stop position."""
    leader_gap: Floats
    leader_speed: Floats


def forecast(users: WorldState, context: RouteContext | None = None) -> Forecast:
    """Expected boxes of n road users at `MOMENTS`, at constant speed.

    `context`: their routes, as at the last decision. Road users follow their paths up to where they have to stop, and
    not through their leaders. Road users without a route keep their yaw rate, limited to `SHARPEST_TURN`, pedestrians
    their heading.
    """
    now = np.stack([users.x, users.y, users.heading, users.length, users.width])
    rate = np.where(users.type == PEDESTRIAN, 0.0, users.yaw_rate)
    boxes, count = _forecast(now, users.speed, rate, _paths(users, context), MOMENTS)
    return Forecast(boxes, count, users.speed / (2.0 * STOPPING_DECELERATION[users.type]))


def _paths(users: WorldState, context: RouteContext | None) -> _Paths:
    n = len(users)
    if context is None or not n:
        none = np.zeros(n)
        return _Paths(np.zeros(n, np.bool_), np.zeros((n, 1)), np.zeros((n, 1)), *(none,) * 7)
    route = context.route
    along, offset, direction = (a[:, 0] for a in on_path(route, users.x[:, None], users.y[:, None]))
    # A road user far beside its path, or turned away from it, does not follow the path.
    turned = np.abs(wrap_angle(users.heading - direction))
    followed = route.known & (np.abs(offset) < ASTRAY) & (turned < AGAINST)
    return _Paths(
        followed, route.x, route.y, route.spacing, along, offset, direction,
        context.stop_distance - along, context.leader_gap - along, context.leader_speed,
    )  # fmt: skip


@compiled
def _forecast(
    now: Floats, speed: Floats, yaw_rate: Floats, paths: _Paths, moments: Floats
) -> tuple[Floats, NDArray[np.intp]]:
    """Boxes (n, q, 5) and the numbers of predicted boxes, (n,); `now`: (5, n)."""
    n, q = now.shape[1], len(moments)
    boxes, count = np.empty((n, q, 5)), np.ones(n, np.intp)
    for i in range(n):
        x, y, heading = now[0, i], now[1, i], now[2, i]
        rate = min(max(yaw_rate[i], -SHARPEST_TURN), SHARPEST_TURN)
        for m, seconds in enumerate(moments):
            boxes[i, m, 3], boxes[i, m, 4] = now[3, i], now[4, i]
            driven = speed[i] * seconds
            if speed[i] > FORECAST_STANDING_SPEED and (paths.followed[i] or seconds <= MOTION_HORIZON):
                count[i] = m + 1
            if paths.followed[i]:
                boxes[i, m, 0], boxes[i, m, 1], boxes[i, m, 2] = _on_the_way(paths, i, heading, speed[i], seconds)
                continue
            half = 0.5 * rate * seconds
            if half != 0.0:
                driven *= math.sin(half) / half
            boxes[i, m, 0], boxes[i, m, 1], boxes[i, m, 2] = moved(x, y, heading, driven, 2.0 * half)
    return boxes, count


@compiled
def _on_the_way(paths: _Paths, i: int, heading: float, speed: float, seconds: float) -> tuple[float, float, float]:
    """x, y (m) and heading (rad) of road user `i` on its path after `seconds`."""
    driven = speed * seconds
    # A line counts only if the road user can still stop before it.
    if paths.stop[i] >= speed * speed / (2.0 * STOPPING_DECELERATION[0]):
        driven = min(driven, paths.stop[i])
    driven = max(min(driven, paths.leader_gap[i] + paths.leader_speed[i] * seconds), 0.0)
    # The path continues straight beyond its ends.
    points, spacing = paths.x.shape[1], paths.spacing[i]
    k = min(max(int((paths.along[i] + driven) / spacing + HERE), 0), points - 2)
    share = paths.along[i] + driven - (k - HERE) * spacing
    dx, dy = paths.x[i, k + 1] - paths.x[i, k], paths.y[i, k + 1] - paths.y[i, k]
    norm = max(math.sqrt(dx * dx + dy * dy), 1e-6)
    dx, dy = dx / norm, dy / norm
    kept = max(1.0 - driven / RETURN_DISTANCE, 0.0)
    lateral = paths.lateral_offset[i] * kept
    x, y = paths.x[i, k] + share * dx - lateral * dy, paths.y[i, k] + share * dy + lateral * dx
    along = math.atan2(dy, dx)
    return x, y, along + wrapped(heading - paths.direction[i]) * kept
