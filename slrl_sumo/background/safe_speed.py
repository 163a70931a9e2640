"""Speeds at which vehicles stop or pass in time for the road users that they would touch."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.forecast import MOMENTS
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats

STOP_SHORT = 1.0
"""m before a road user at which vehicles stop, where they can."""
TIME_APART = 0.5
"""s between a vehicle and a road user at the same place. A vehicle that can no longer stop may pass with less."""


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
    """Speeds for the next step that let vehicles stop in time, (p,) in m/s, and where that is harder than `decel`.

    `enter`, `leave`: m driven at first and last touch at each of `MOMENTS`, (p, q); `leading`: speed of the road users
    along the path there, (p, q); `count`: how many of the moments are predicted, (p,); `certain`: s until which a touch
    justifies hard braking, (p,); `speed`: of the vehicles, (p,); `limits`: acceleration, deceleration, emergency
    deceleration, (p, 3); `dt`: the step, s; `later`: s from the vehicles' state to the first moment. inf where the path
    is free. The speed is Krauss' safe speed with a reaction time of one step
    (https://sumo.dlr.de/docs/Car-Following-Models.html); where `decel` does not suffice and the touch is certain, it
    follows from the least sufficient deceleration, up to the emergency deceleration.
    """
    targets, hard = np.full(len(speed), np.inf), np.zeros(len(speed), np.bool_)
    for p, v in enumerate(speed):
        acceleration, comfortable, emergency = limits[p, 0], limits[p, 1], limits[p, 2]
        delay = comfortable * dt
        for m in range(count[p]):
            moment, first, following = MOMENTS[m], enter[p, m], leading[p, m]
            needed = (v * v - following * following) / (2.0 * max(first - SPACING, 1e-3))
            # A touch matters if the vehicle may be there then, if the road user stays there (last moment), or if it is
            # a leader now ...
            apart = 0.0 if needed > emergency else TIME_APART
            begin, end = moment + later - apart, moment + later + apart
            in_time = first <= v * end + 0.5 * acceleration * end * end + STOP_SHORT
            matters = in_time or m == count[p] - 1 or (m == 0 and following > 0.0)
            # ... and if the vehicle has not passed before.
            if not matters or leave[p, m] + SPACING < v * max(begin, 0.0):
                continue
            gap = max(first - STOP_SHORT, 0.0)
            target = math.sqrt(delay * delay + following * following + 2.0 * comfortable * gap) - delay
            breaks = target < v - comfortable * dt
            if breaks:
                # Hard braking must be certain to be needed, and to help: standing road users, or moving ones that the
                # vehicle reaches while they are there, but does not reach if it brakes.
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
