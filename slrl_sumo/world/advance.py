"""The motion of one decision interval."""

from dataclasses import replace

import numpy as np

from slrl_sumo.world.geometry import Floats, cos_sin, wrap_angle
from slrl_sumo.world.state import WorldState

HALT, INTENT = 0.5, 0.15
"""m/s, and m/s² that somebody needs to mean to drive on."""


def advance(state: WorldState, acceleration: Floats, yaw_rate: Floats, max_speed: Floats, dt: float) -> WorldState:
    """Move every road user by one interval.

    `acceleration` (m/s²), `yaw_rate` (rad/s) and `max_speed` (m/s) are (n,) arrays for the road users of `state`.
    The new speed is kept within [0, max_speed]; the displacement is new speed x dt along the mean heading of the
    interval, so that speed is exactly distance over time (as SUMO's Euler update has it) and nobody slides sideways.
    Returns the state at `state.time + dt`, with the acceleration and yaw rate that were really carried out.
    """
    speed = np.clip(state.speed + acceleration * dt, 0.0, max_speed)
    turn = yaw_rate * dt
    c, s = cos_sin(state.heading + 0.5 * turn)
    return replace(
        state,
        time=state.time + dt,
        x=state.x + speed * dt * c,
        y=state.y + speed * dt * s,
        heading=wrap_angle(state.heading + turn),
        speed=speed,
        acceleration=(speed - state.speed) / dt,
        yaw_rate=np.asarray(yaw_rate, np.float64),
    )


def halting(speed: Floats, acceleration: Floats, dt: float) -> Floats:
    """`acceleration` (m/s², of the shape of `speed` in m/s), but a stop for who would be slower than HALT after `dt` s
    and hardly speeds up.

    Models that learned means of what people did approach a stand for ever: those that crawl mean to stop.
    """
    ends = (acceleration < INTENT) & (speed + acceleration * dt < HALT)
    return np.where(ends, -speed / dt, acceleration)
