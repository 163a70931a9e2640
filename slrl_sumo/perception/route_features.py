"""The route of a road user as numbers (presets `extended` and `image`)."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import HERE, RouteAhead

FAR = 60.0
"""Greatest distance (m) to lines and leaders; larger distances are clipped."""
MOST_PATH = 10.0
"""Greatest coordinate (tens of m) of points of the path; larger coordinates are clipped."""
TURN = 0.3
"""Deviation (rad) of a path from which it turns."""
SHARP = math.sin(TURN) / (math.sin(TURN) + math.cos(TURN))
"""TURN as a ratio: lateral over lateral plus longitudinal."""
BACK = 2.0 - 1e-9
"""A turn straight back on the scale of SHARP."""

ROUTE_FEATURES: tuple[str, ...] = (
    "known",
    "lateral_offset",
    "heading_error",
    "turn_distance",
    "turn",
    "stop",
    "line",
    "green",
    "yellow",
    "red",
    "desired_speed",
    "left",
    "leader_gap",
    "leader_speed",
)
"""Columns of `route_features`: 1 where there is a route; lateral offset (m) and heading error (rad) to the left of the
path; distance to the next turn, and the largest turn (rad) of the known path; distances to the stop position and to the
next line, one-hot signal there; speed allowed by limits, junctions and curves; distance to the destination; gap to the
leader on the path, and its speed. Distances are in tens of metres, speeds in tens of m/s, at most FAR."""


PATH_POINTS = (2, 4, 7, 11, 16, 22, 30, 40)
"""Indices, from HERE on, of the points of the path ahead: up to 40 m, for fast vehicles up to their sight."""
PATH_FEATURES: tuple[str, ...] = tuple(f"path_{k}_{column}" for k in PATH_POINTS for column in ("ahead", "left"))
"""Columns of `path_features`: the PATH_POINTS in the ego frame, tens of m."""


def path_features(route: RouteAhead, x: Floats, y: Floats, heading: Floats) -> NDArray[np.float32]:
    """The paths ahead of n road users as PATH_FEATURES, (n, 16); 0 without a route.

    `x`, `y` (m) and `heading` (rad): positions and headings of the road users, (n,).
    """
    chosen = HERE + np.array(PATH_POINTS)
    dx, dy = route.x[:, chosen] - x[:, None], route.y[:, chosen] - y[:, None]
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    points = np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1).reshape(len(x), len(PATH_FEATURES)) / 10.0
    points[~route.known] = 0.0
    return points.clip(-MOST_PATH, MOST_PATH).astype(np.float32)


def route_features(heading: Floats, context: RouteContext) -> NDArray[np.float32]:
    """The routes of n road users with these headings (rad, (n,)), (n, 14), columns as in ROUTE_FEATURES."""
    route = context.route
    heading_error = wrap_angle(heading - context.direction)
    # Distances (m) and speeds (m/s) that are clipped at FAR, in the order of their columns.
    far = np.column_stack(
        [
            route.stop,
            route.line,
            route.desired_speed,
            route.remaining_distance,
            context.leader_gap,
            context.leader_speed,
        ]
    )
    offset, direction = context.lateral_offset, context.direction
    return _table(route.known, route.x, route.y, route.spacing, route.signal, offset, heading_error, direction, far)


@compiled
def _table(
    known: NDArray[np.bool_],
    x: Floats,
    y: Floats,
    spacing: Floats,
    signal: NDArray[np.int8],
    lateral_offset: Floats,
    heading_error: Floats,
    direction: Floats,
    far: Floats,
) -> NDArray[np.float32]:
    table = np.zeros((len(known), 14), np.float32)
    for i in range(len(known)):
        if not known[i]:
            continue
        until, turn = _turns(x[i], y[i], direction[i])
        table[i, 0], table[i, 1], table[i, 2] = 1.0, min(max(lateral_offset[i], -5.0), 5.0), heading_error[i]
        table[i, 3], table[i, 4] = until * spacing[i] / 10.0, turn
        table[i, 5], table[i, 6] = min(far[i, 0], FAR) / 10.0, min(far[i, 1], FAR) / 10.0
        if signal[i] > 0:
            table[i, 6 + signal[i]] = 1.0
        for k in range(2, far.shape[1]):
            table[i, 8 + k] = min(far[i, k], FAR) / 10.0
    return table


@compiled
def _turns(x: Floats, y: Floats, direction: float) -> tuple[int, float]:
    """Number of segments from HERE to the first segment that turns by more than TURN, and the largest turn (rad).

    Turns are relative to `direction` (rad). Without a turn, the number is that of the segments up to the end.
    """
    c, s = math.cos(direction), math.sin(direction)
    until, most, most_ahead, most_aside = len(x) - 1 - HERE, -1.0, 1.0, 0.0
    for k in range(HERE, len(x) - 1):
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        # This measure grows with the angle, from 0 (straight on) to 2 (straight back), without libm.
        sharp = abs(aside) / (abs(ahead) + abs(aside))
        sharp = sharp if ahead >= 0.0 else 2.0 - sharp
        if sharp > most:
            most, most_ahead, most_aside = sharp, ahead, aside
        if sharp > SHARP:
            until = min(until, k - HERE)
    # Straight back counts as to the left, whatever the last bits of the coordinates.
    return until, math.pi if most > BACK else math.atan2(most_aside, most_ahead)
