"""Where everybody is expected in the next seconds: along their paths, or straight on."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.collision import Boxes, sizes
from slrl_sumo.lookahead.mode_rollout import STEPS, ModeRollouts
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import HERE, SPACING, RouteAhead, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

BESIDE, ASKEW = 1.0, 0.35
"""m and rad: who is farther off its path in both is led on as it is, not along the path."""


@dataclass(frozen=True, eq=False)
class Kept:
    """Which of the road users with `route` keep to their paths, (n,), and m to the left of them now, (n,)."""

    route: RouteAhead
    keeps: NDArray[np.bool_]
    beside: Floats


def paths_kept(route: RouteAhead, users: WorldState) -> Kept:
    """Who of the first road users of `users`, those of `route`, keeps to its path: vehicles that are on it, or go back
    to it, so that they will be found there."""
    n = len(route)
    keeps, beside = np.zeros(n, np.bool_), np.zeros(n)
    rows = np.flatnonzero(route.known & (users.type[:n] != RoadUserType.PEDESTRIAN))
    _, aside, direction = (c[:, 0] for c in on_path(route, users.x[rows, None], users.y[rows, None], rows))
    keeps[rows] = (np.abs(aside) < BESIDE) | (np.abs(wrap_angle(users.heading[rows] - direction)) < ASKEW)
    beside[rows] = aside
    return Kept(route, keeps, beside)


def bring_to_paths(on: ModeRollouts, kept: Kept, rows: NDArray[np.intp]) -> None:
    """Changes the courses `on` of the road users `rows`: as far along the paths for who keeps to one; it comes back to
    it from beside. In place: courses are large."""
    x, y = kept.route.x, kept.route.y
    _bring_to_paths(on.x, on.y, on.cos, on.sin, on.way, rows, kept.keeps, kept.beside, x, y, SPACING, HERE)


def boxes(world: WorldState, kept: Kept | None, margin: Floats) -> Boxes:
    """Of all road users, `margin` of their type, (3,), larger, after each interval at constant speed and yaw rate.

    Vehicles that keep to their paths follow them, up to lines at which they must stop.
    """
    if kept is None:
        kept = Kept(RouteAhead.unknown(0), np.zeros(0, np.bool_), np.zeros(0))
    route = kept.route
    places = _led_on(
        world.x,
        world.y,
        world.heading,
        world.speed,
        world.yaw_rate,
        kept.keeps,
        kept.beside,
        route.stop,
        route.x,
        route.y,
        SPACING,
        HERE,
        STEPS,
        DECISION_INTERVAL,
    )
    return Boxes(*places, sizes(world, margin))


@compiled
def _bring_to_paths(
    x: Floats,
    y: Floats,
    cos: Floats,
    sin: Floats,
    way: Floats,
    rows: NDArray[np.intp],
    keeps: NDArray[np.bool_],
    beside: Floats,
    path_x: Floats,
    path_y: Floats,
    spacing: float,
    here: int,
) -> None:
    """`bring_to_paths` of the fields of ModeRollouts, Kept and RouteAhead."""
    n, steps, modes = x.shape
    points = path_x.shape[1]
    c, s = np.empty(points), np.empty(points)
    for i in range(n):
        row = rows[i]
        if not keeps[row]:
            continue
        # Directions are found as far as they are needed.
        found = here
        for step in range(steps):
            shift = beside[row] * _back(step, steps)
            for mode in range(modes):
                k, share = _piece(way[i, step, mode], spacing, here, points)
                while found <= k:
                    c[found], s[found] = _direction(path_x, path_y, row, found)
                    found += 1
                x0, y0 = path_x[row, k], path_y[row, k]
                x[i, step, mode] = x0 + share * (path_x[row, k + 1] - x0) - shift * s[k]
                y[i, step, mode] = y0 + share * (path_y[row, k + 1] - y0) + shift * c[k]
                cos[i, step, mode], sin[i, step, mode] = c[k], s[k]


@compiled
def _led_on(
    world_x: Floats,
    world_y: Floats,
    heading: Floats,
    speed: Floats,
    yaw_rate: Floats,
    keeps: NDArray[np.bool_],
    beside: Floats,
    stop: Floats,
    path_x: Floats,
    path_y: Floats,
    spacing: float,
    here: int,
    steps: int,
    dt: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """x, y, cos and sin of `boxes`."""
    n = len(world_x)
    x, y, cos, sin = np.empty((n, steps)), np.empty((n, steps)), np.empty((n, steps)), np.empty((n, steps))
    for i in range(n):
        distance = speed[i] * dt
        if i < len(keeps) and keeps[i]:
            most = max(stop[i], 0.0)
            for step in range(steps):
                shift = beside[i] * _back(step, steps)
                k, share = _piece(min((step + 1) * distance, most), spacing, here, path_x.shape[1])
                c, s = _direction(path_x, path_y, i, k)
                x[i, step] = path_x[i, k] + share * (path_x[i, k + 1] - path_x[i, k]) - shift * s
                y[i, step] = path_y[i, k] + share * (path_y[i, k + 1] - path_y[i, k]) + shift * c
                cos[i, step], sin[i, step] = c, s
            continue
        # The mean heading since now turns half as fast as the heading.
        half_c, half_s = math.cos(0.5 * dt * yaw_rate[i]), math.sin(0.5 * dt * yaw_rate[i])
        c, s = math.cos(heading[i]), math.sin(heading[i])
        mean_c, mean_s = c, s
        for step in range(steps):
            mean_c, mean_s = _turned(mean_c, mean_s, half_c, half_s)
            c, s = _turned(c, s, half_c * half_c - half_s * half_s, 2.0 * half_c * half_s)
            x[i, step] = world_x[i] + (step + 1) * distance * mean_c
            y[i, step] = world_y[i] + (step + 1) * distance * mean_s
            cos[i, step], sin[i, step] = c, s
    return x, y, cos, sin


@compiled
def _back(step: int, steps: int) -> float:
    """How far who is beside its path still is after an interval, relative to now."""
    return max(0.0, 1.0 - (step + 1) / steps)


@compiled
def _piece(way: float, spacing: float, here: int, points: int) -> tuple[int, float]:
    """The piece of a path `way` m ahead, and how much of it lies behind that place; the last one goes on straight."""
    place = way / spacing + here
    k = max(min(int(place), points - 2), 0)
    return k, place - k


@compiled
def _direction(x: Floats, y: Floats, row: int, k: int) -> tuple[float, float]:
    """Cosine and sine of the direction of piece `k` of one of several paths."""
    dx, dy = x[row, k + 1] - x[row, k], y[row, k + 1] - y[row, k]
    length = math.sqrt(dx * dx + dy * dy)
    return (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)


@compiled
def _turned(cos: float, sin: float, by_cos: float, by_sin: float) -> tuple[float, float]:
    return cos * by_cos - sin * by_sin, sin * by_cos + cos * by_sin
