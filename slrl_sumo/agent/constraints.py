"""Constraints: named rules that are not learned, the switches for them, and their effect on a motion."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.scene.advance import halting
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL

EASING = 3.0
"""Deceleration (m/s²) of road users above the top speed of their models."""


@dataclass(frozen=True)
class Constraints:
    """The rules that apply in addition to the policy; the fields are their names, in the order of application.

    All rules except `speed_cap` need routes, and have no effect without routes.
    """

    path_smoothing: bool = True
    """Smooth paths, and lower speeds before curves, so that the models can follow (agent.path_smoothing)."""
    braking_residual: bool = True
    """Brake as hard as recorded road users in the mode that brakes hardest (agent.braking)."""
    steering_residual: bool = True
    """Correct the yaw rate within a mode towards the path, within bounds (agent.steering)."""
    guard: bool = False
    """Exclude modes that lead into a conflict (agent.guard)."""
    deadlock_release: bool = True
    """Force road users to move that stand without a reason, or block each other (agent.deadlock)."""
    speed_cap: bool = True
    """Limit acceleration to the top speed of the models; faster road users decelerate to it at EASING."""
    standing_still: bool = True
    """Stop road users that crawl and do not accelerate: models of mean motion approach a standstill for ever."""


def constraints_of(guard: bool, without: Sequence[str]) -> Constraints:
    """The default constraints, with or without the guard; the constraints named in `without` are switched off.

    Raises InputError for unknown names.
    """
    names = [field.name for field in fields(Constraints) if field.name != "guard"]
    for name in without:
        if name not in names:
            raise InputError(
                f"there is no constraint of that name; use {', '.join(names)}", argument="without", value=name
            )
    return Constraints(guard=guard, **dict.fromkeys(without, False))


def stand_still(speed: Floats, acceleration: Floats, max_speed: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Acceleration (m/s², (n,)) under `standing_still`, and whether it changes the speed of each road user, (n,).

    `speed` (m/s): now. `max_speed` (m/s): of the next interval.
    """
    constrained = halting(speed, acceleration, DECISION_INTERVAL)
    reached, free = (np.clip(speed + a * DECISION_INTERVAL, 0.0, max_speed) for a in (constrained, acceleration))
    return constrained, reached != free


def cap_speed(speed: Floats, acceleration: Floats, top_speed: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Highest speed (m/s, (n,)) of the next interval under `speed_cap`, and whether it slows each road user down, (n,).

    `top_speed`: top speeds of their models, m/s, (n,).
    """
    cap = np.maximum(top_speed, speed - EASING * DECISION_INTERVAL)
    return cap, speed + acceleration * DECISION_INTERVAL > cap
