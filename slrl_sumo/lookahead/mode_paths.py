"""Mode paths: the positions of road users in the next seconds under each mode."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.advance import HALT, INTENT
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN

STEPS = 8
"""Horizon in decision intervals: 3.2 s."""
HELD = 5
"""Intervals for which a mode's acceleration and yaw rate are held; speed and heading are constant afterwards."""
MOST_TURNED = 0.8
"""Greatest turn (rad) of pedestrians on a route, unless a single interval turns them further. Modes turn by up to
4 rad/s: held for 2 s, that is a circle without contacts, although pedestrians decide again after 0.4 s."""


class ModePaths(NamedTuple):
    """n road users under each mode after each of STEPS, or fewer, intervals: (n, STEPS, modes) each."""

    x: Floats
    """m."""
    y: Floats
    cos: Floats
    """Of the heading."""
    sin: Floats
    speed: Floats
    """m/s."""
    distance: Floats
    """Distance (m) covered so far."""


def mode_paths(
    users: WorldState,
    acceleration: Floats,
    yaw_rate: Floats,
    max_speed: Floats,
    *,
    on_route: bool,
    steps: int = STEPS,
) -> ModePaths:
    """Move n road users under each mode, as `advance` does, for a number of intervals (`steps`).

    `acceleration` (m/s²) and `yaw_rate` (rad/s), (n, modes), are held for HELD intervals, up to the speed `max_speed`
    (m/s, (n,)). With `on_route`, slow road users stop as in `scene.advance.halting`, and pedestrians turn by at most
    MOST_TURNED.
    """
    intent = INTENT if on_route else -np.inf
    turning = np.full(yaw_rate.shape, HELD)
    if on_route:
        walks = users.type == PEDESTRIAN
        turning[walks] = turns_held(yaw_rate[walks])
    # numpy's tan takes a tenth of the time of a compiled cosine and sine (see geometry.cos_sin).
    tan = np.tan(0.25 * DECISION_INTERVAL * yaw_rate)
    place = users.x, users.y, users.heading, users.speed
    return _mode_paths(*place, acceleration, tan, max_speed, turning, intent, steps)


def turns_held(yaw_rate: Floats) -> NDArray[np.int64]:
    """Intervals for which a pedestrian on a route turns at each `yaw_rate` (rad/s)."""
    intervals = MOST_TURNED / np.maximum(np.abs(yaw_rate) * DECISION_INTERVAL, 1e-6)
    return np.clip(intervals, 1, HELD).astype(np.int64)


@compiled
def _mode_paths(
    x: Floats,
    y: Floats,
    heading: Floats,
    speed: Floats,
    acceleration: Floats,
    tan: Floats,
    max_speed: Floats,
    turning: NDArray[np.int64],
    intent: float,
    steps: int,
) -> ModePaths:
    """Compiled loop of `mode_paths`.

    `tan`: tangent of a quarter of the turn in an interval, (n, modes). `turning`: number of intervals with this turn,
    (n, modes). Below the acceleration `intent` (m/s²), road users that would be slower than HALT stop.
    """
    n, modes = acceleration.shape
    dt = DECISION_INTERVAL
    at_x, at_y, at_cos = np.empty((n, steps, modes)), np.empty((n, steps, modes)), np.empty((n, steps, modes))
    at_sin, at_speed, at_way = np.empty((n, steps, modes)), np.empty((n, steps, modes)), np.empty((n, steps, modes))
    for i in range(n):
        begin_c, begin_s = math.cos(heading[i]), math.sin(heading[i])
        for mode in range(modes):
            gain, stops = dt * acceleration[i, mode], acceleration[i, mode] < intent
            px, py, way, now, c, s = x[i], y[i], 0.0, speed[i], begin_c, begin_s
            square = tan[i, mode] ** 2
            half_c, half_s = (1.0 - square) / (1.0 + square), 2.0 * tan[i, mode] / (1.0 + square)
            for step in range(steps):
                if step < HELD:
                    after = now + gain
                    now = min(max(after, 0.0), max_speed[i])
                    if stops and after < HALT:
                        now = 0.0
                if step < turning[i, mode]:
                    # Half a turn to the mean heading of the interval, and one more to the heading at its end.
                    middle_c, middle_s = c * half_c - s * half_s, s * half_c + c * half_s
                    c, s = middle_c * half_c - middle_s * half_s, middle_s * half_c + middle_c * half_s
                else:
                    middle_c, middle_s = c, s
                distance = now * dt
                px, py, way = px + distance * middle_c, py + distance * middle_s, way + distance
                at_x[i, step, mode], at_y[i, step, mode] = px, py
                at_cos[i, step, mode], at_sin[i, step, mode] = c, s
                at_speed[i, step, mode], at_way[i, step, mode] = now, way
    return ModePaths(at_x, at_y, at_cos, at_sin, at_speed, at_way)
