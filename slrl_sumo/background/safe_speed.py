"""Safe speeds: vehicles stop or pass in time for road users that they would touch."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.forecast import MOMENTS
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats

STOP_SHORT = 1.0
"""Distance (m) before a road user at which vehicles stop, if possible."""
TIME_APART = 0.5
"""Time gap (s) between a vehicle and a road user at the same place; a vehicle that can no longer stop may use less."""


@compiled
def safe_speeds(
    enter: Floats,
    leave: Floats,
    leading: Floats,
    count: NDArray[np.intp],
    certain: Floats,
    speed: Floats,
    limits: Floats,
    dt: float,
    later: float,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Speeds (m/s, (p,)) for the next step with which vehicles stop in time, and whether that needs hard braking, (p,).

    `enter`, `leave`: m driven at first and last touch at each of `MOMENTS`, (p, q). `leading`: speed of the road users
    along the path there, (p, q). `count`: number of predicted moments, (p,). `certain`: time (s) until which a touch
    justifies hard braking, (p,). `speed`: of the vehicles, (p,). `limits`: acceleration, deceleration, emergency
    deceleration, (p, 3). `dt`: the step, s. `later`: time (s) from the vehicles' state to the first moment. The speed
    is inf if the path is free.

    The speed is the safe speed of Krauss' model with a reaction time of one step
    (https://sumo.dlr.de/docs/Car-Following-Models.html). If the deceleration does not suffice and the touch is certain,
    the speed follows from the least sufficient deceleration, up to the emergency deceleration.
    """
    targets, hard = np.full(len(speed), np.inf), np.zeros(len(speed), np.bool_)
    for p, v in enumerate(speed):
        acceleration, comfortable, emergency = limits[p, 0], limits[p, 1], limits[p, 2]
        delay = comfortable * dt
        for m in range(count[p]):
            moment, first, following = MOMENTS[m], enter[p, m], leading[p, m]
            needed = (v * v - following * following) / (2.0 * max(first - SPACING, 1e-3))
            # A touch matters if the vehicle may be at the place then, if the road user stays there (last moment), or if
            # the road user is a leader now ...
            apart = 0.0 if needed > emergency else TIME_APART
            begin, end = moment + later - apart, moment + later + apart
            in_time = first <= v * end + 0.5 * acceleration * end * end + STOP_SHORT
            matters = in_time or m == count[p] - 1 or (m == 0 and following > 0.0)
            # ... and if the vehicle does not pass before.
            if not matters or leave[p, m] + SPACING < v * max(begin, 0.0):
                continue
            gap = max(first - STOP_SHORT, 0.0)
            target = math.sqrt(delay * delay + following * following + 2.0 * comfortable * gap) - delay
            breaks = target < v - comfortable * dt
            if breaks:
                # Hard braking must be needed for certain, and must help: for standing road users, and for moving road
                # users that the vehicle reaches in time without braking, but not with braking.
                time = moment + later
                reached = v * time + 0.5 * acceleration * time * time + SPACING > first
                avoided = v * time - 0.5 * emergency * time * time < first
                sure = count[p] == 1 or (moment <= certain[p] and reached and avoided)
                needed = min(max(needed, comfortable), emergency) if sure and certain[p] >= 0.0 else comfortable
                target = v - needed * dt
            target = max(target, 0.0)
            if target < targets[p]:
                targets[p], hard[p] = target, breaks and needed > comfortable
    return targets, hard
