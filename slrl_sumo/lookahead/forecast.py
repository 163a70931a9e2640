"""Forecast of road users for the next seconds: along their paths, or at constant speed and yaw rate."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_paths import STEPS, ModePaths
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN

NEAR_PATH, ALONG_PATH = 1.0, 0.35
"""Lateral offset (m) and heading error (rad): the forecast of road users beyond both is at constant yaw rate, not along
the path."""


class PathFollowing(NamedTuple):
    """The paths of n learned road users, and which of these road users follow their paths in the forecast."""

    follows: NDArray[np.bool_]
    """Vehicles that are on their path or in its direction, (n,)."""
    lateral_offset: Floats
    """Present lateral offset, m to the left of the path, (n,)."""
    stop: Floats
    """Distance (m) to the line before which the vehicle must stop, (n,)."""
    x: Floats
    """Points of the paths, (n, POINTS), as in RouteAhead."""
    y: Floats
    spacing: Floats
    """Spacing (m) of these points, (n,)."""


YIELD_BRAKING = 3.0
"""Expected deceleration (m/s²) of yielding vehicles."""


class Boxes(NamedTuple):
    """Expected boxes of m road users after each of STEPS intervals: (m, STEPS) each."""

    x: Floats
    """Centre, m."""
    y: Floats
    cos: Floats
    """Of the heading."""
    sin: Floats
    size: Floats
    """Length and width in m, with a margin, (m, 2)."""


def path_following(context: RouteContext | None, world: WorldState) -> PathFollowing:
    """The paths of the first road users of `world`, one for each of `context`, and which of them follow their paths."""
    if context is None:
        none = RouteAhead.unknown(0)
        return PathFollowing(none.known, np.zeros(0), none.stop, none.x, none.y, none.spacing)
    n, route = len(context), context.route
    heading_error = np.abs(wrap_angle(world.heading[:n] - context.direction))
    follows = route.known & (world.type[:n] != PEDESTRIAN)
    follows &= (np.abs(context.lateral_offset) < NEAR_PATH) | (heading_error < ALONG_PATH)
    return PathFollowing(follows, context.lateral_offset, route.stop, route.x, route.y, route.spacing)


def forecast_boxes(world: WorldState, following: PathFollowing, margin: Floats, *, yielding: bool = False) -> Boxes:
    """Boxes of all m road users of `world` after each interval, larger by `margin`, (m,) in m.

    Path-following vehicles keep their speed along the path up to the line before which they must stop; all others
    keep speed and yaw rate. With `yielding`, path-following vehicles brake to a stop with YIELD_BRAKING instead.
    """
    braking = YIELD_BRAKING if yielding else 0.0
    size = sizes(world, margin)
    return _forecast(world.x, world.y, world.heading, world.speed, world.yaw_rate, following, size, braking)


def sizes(users: WorldState, margin: Floats) -> Floats:
    """Length and width of n road users in m, larger by `margin`, (n,): (n, 2)."""
    return np.column_stack([users.length + margin, users.width + margin])


def bring_to_paths(paths: ModePaths, following: PathFollowing, rows: NDArray[np.intp]) -> None:
    """Move the mode paths of path-following road users onto their routes, in place, because the arrays are large.

    Each mode covers the same distance along the route, and the lateral offset shrinks to 0 within STEPS. `rows`: rows
    in `following` of the road users of `paths`.
    """
    _bring_to_paths(paths, following, rows)


@compiled
def _bring_to_paths(paths: ModePaths, following: PathFollowing, rows: NDArray[np.intp]) -> None:
    n, steps, modes = paths.x.shape
    path_x, path_y = following.x, following.y
    points = path_x.shape[1]
    c, s = np.empty(points), np.empty(points)
    for i in range(n):
        row = rows[i]
        if not following.follows[row]:
            continue
        # Compute directions only as far along the path as needed.
        found = HERE
        for step in range(steps):
            shift = following.lateral_offset[row] * _remaining(step, steps)
            for mode in range(modes):
                k, share = _piece(paths.distance[i, step, mode], points, following.spacing[row])
                while found <= k:
                    c[found], s[found] = _direction(path_x, path_y, row, found)
                    found += 1
                x0, y0 = path_x[row, k], path_y[row, k]
                paths.x[i, step, mode] = x0 + share * (path_x[row, k + 1] - x0) - shift * s[k]
                paths.y[i, step, mode] = y0 + share * (path_y[row, k + 1] - y0) + shift * c[k]
                paths.cos[i, step, mode], paths.sin[i, step, mode] = c[k], s[k]


@compiled
def _forecast(
    world_x: Floats,
    world_y: Floats,
    heading: Floats,
    speed: Floats,
    yaw_rate: Floats,
    following: PathFollowing,
    size: Floats,
    braking: float,
) -> Boxes:
    n, dt = len(world_x), DECISION_INTERVAL
    path_x, path_y = following.x, following.y
    x, y, cos, sin = np.empty((n, STEPS)), np.empty((n, STEPS)), np.empty((n, STEPS)), np.empty((n, STEPS))
    for i in range(n):
        distance = speed[i] * dt
        if i < len(following.follows) and following.follows[i]:
            most = max(following.stop[i], 0.0)
            for step in range(STEPS):
                shift = following.lateral_offset[i] * _remaining(step, STEPS)
                covered = (step + 1) * distance
                if braking > 0.0:
                    time = min((step + 1) * dt, speed[i] / braking)
                    covered = (speed[i] - 0.5 * braking * time) * time
                k, share = _piece(min(covered, most), path_x.shape[1], following.spacing[i])
                c, s = _direction(path_x, path_y, i, k)
                x[i, step] = path_x[i, k] + share * (path_x[i, k + 1] - path_x[i, k]) - shift * s
                y[i, step] = path_y[i, k] + share * (path_y[i, k + 1] - path_y[i, k]) + shift * c
                cos[i, step], sin[i, step] = c, s
            continue
        # The mean heading since now turns half as fast as the heading.
        half_c, half_s = math.cos(0.5 * dt * yaw_rate[i]), math.sin(0.5 * dt * yaw_rate[i])
        c, s = math.cos(heading[i]), math.sin(heading[i])
        mean_c, mean_s = c, s
        for step in range(STEPS):
            mean_c, mean_s = _turned(mean_c, mean_s, half_c, half_s)
            c, s = _turned(c, s, half_c * half_c - half_s * half_s, 2.0 * half_c * half_s)
            x[i, step] = world_x[i] + (step + 1) * distance * mean_c
            y[i, step] = world_y[i] + (step + 1) * distance * mean_s
            cos[i, step], sin[i, step] = c, s
    return Boxes(x, y, cos, sin, size)


@compiled
def _remaining(step: int, steps: int) -> float:
    """Share of the present lateral offset that remains after an interval."""
    return max(0.0, 1.0 - (step + 1) / steps)


@compiled
def _piece(distance: float, points: int, spacing: float) -> tuple[int, float]:
    """The segment of a path `distance` m ahead, and the fraction of it before that place; the last segment goes on."""
    place = distance / spacing + HERE
    k = max(min(int(place), points - 2), 0)
    return k, place - k


@compiled
def _direction(x: Floats, y: Floats, row: int, k: int) -> tuple[float, float]:
    """Cosine and sine of the direction of segment `k` of the path in this row."""
    dx, dy = x[row, k + 1] - x[row, k], y[row, k + 1] - y[row, k]
    length = math.sqrt(dx * dx + dy * dy)
    return (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)


@compiled
def _turned(cos: float, sin: float, by_cos: float, by_sin: float) -> tuple[float, float]:
    return cos * by_cos - sin * by_sin, sin * by_cos + cos * by_sin
