"""The motion of one decision interval."""

from dataclasses import replace

import numpy as np

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import moved, wrapped
from slrl_sumo.scene.state import WorldState

HALT, INTENT = 0.5, 0.15
"""Speed (m/s) and acceleration (m/s²) below which, both together, a road user stops."""


def advance(state: WorldState, acceleration: Floats, yaw_rate: Floats, max_speed: Floats, dt: float) -> WorldState:
    """Move each road user by one interval.

    `acceleration` (m/s²), `yaw_rate` (rad/s) and `max_speed` (m/s): (n,) arrays for the road users of `state`, or
    (1,) for all road users; ValueError for any other shape.
    The new speed is clipped to [0, max_speed]. The displacement is new speed x dt along the mean heading of the
    interval, so that speed is exactly distance over time (as in SUMO's Euler update) and road users do not slide
    sideways. Returns the state at `state.time + dt`, with the resulting acceleration and yaw rate.
    """
    # Copy the arrays: numba would compile the kernel again for read-only broadcast arrays, and the returned yaw rates
    # must not be the caller's array.
    felt, turning, top = (
        np.array(np.broadcast_to(given, len(state)), np.float64) for given in (acceleration, yaw_rate, max_speed)
    )
    x, y, heading, speed, done = _advance(state.x, state.y, state.heading, state.speed, felt, turning, top, dt)
    return replace(
        state,
        time=state.time + dt,
        x=x,
        y=y,
        heading=heading,
        speed=speed,
        acceleration=done,
        yaw_rate=turning,
    )


@compiled
def _advance(
    x: Floats, y: Floats, heading: Floats, speed: Floats, acceleration: Floats, yaw_rate: Floats, top: Floats, dt: float
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """x, y, heading, speed and acceleration of `advance`."""
    n = len(x)
    to_x, to_y, to_heading, to_speed, done = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        after = min(max(speed[i] + acceleration[i] * dt, 0.0), top[i])
        to_x[i], to_y[i], end = moved(x[i], y[i], heading[i], after * dt, yaw_rate[i] * dt)
        to_heading[i] = wrapped(end)
        to_speed[i], done[i] = after, (after - speed[i]) / dt
    return to_x, to_y, to_heading, to_speed, done


def halting(speed: Floats, acceleration: Floats, dt: float) -> Floats:
    """`acceleration` (m/s², of the shape of `speed` in m/s), with a stop for crawling road users.

    A road user stops if it would be slower than HALT after `dt` s and accelerates by less than INTENT. Models of mean
    motion approach a standstill for ever: crawling means stopping.
    """
    ends = (acceleration < INTENT) & (speed + acceleration * dt < HALT)
    return np.where(ends, -speed / dt, acceleration)
