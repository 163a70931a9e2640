"""The motion of one decision interval."""

from dataclasses import replace

import numpy as np

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import moved, wrapped
from slrl_sumo.scene.state import WorldState

HALT, INTENT = 0.5, 0.15
"""m/s, and m/s² that somebody needs to mean to drive on."""


def advance(state: WorldState, acceleration: Floats, yaw_rate: Floats, max_speed: Floats, dt: float) -> WorldState:
    """Move every road user by one interval.

    `acceleration` (m/s²), `yaw_rate` (rad/s) and `max_speed` (m/s): (n,) arrays for the road users of `state`, or
    (1,) for all of them; ValueError for any other shape.
    The new speed is kept within [0, max_speed]; the displacement is new speed x dt along the mean heading of the
    interval, so that speed is exactly distance over time (as SUMO's Euler update has it) and nobody slides sideways.
    Returns the state at `state.time + dt`, with the acceleration and yaw rate that were really carried out.
    """
    # Copies: what is broadcast cannot be written to, and would be compiled for once more; nor is it the caller's then.
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
    """`acceleration` (m/s², of the shape of `speed` in m/s), but a stop for who would be slower than HALT after `dt` s
    and hardly speeds up.

    Models that learned means of what people did approach a stand for ever: those that crawl mean to stop.
    """
    ends = (acceleration < INTENT) & (speed + acceleration * dt < HALT)
    return np.where(ends, -speed / dt, acceleration)
