"""Rules that are not learned, by name: which ones are on, and what they do to a motion."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.scene.advance import halting
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL

EASING = 3.0
"""m/s²: deceleration of road users above their models' top speed."""


@dataclass(frozen=True)
class Constraints:
    """Which rules apply beside the policy; the fields are their names, in the order in which they apply.

    All but `speed_cap` need routes, and do nothing without them.
    """

    path_smoothing: bool = True
    """Paths are as round, and speeds in curves as low, as the models need (agent.path_smoothing)."""
    steering_residual: bool = True
    """Inside a mode, vehicles correct their steering towards their path, within bounds (lookahead.steering)."""
    braking_residual: bool = True
    """Inside the mode that brakes hardest, road users brake as hard as recorded ones did (lookahead.braking)."""
    guard: bool = False
    """No modes that lead into a conflict (agent.guard)."""
    deadlock_release: bool = True
    """Road users that stand for no reason, or for each other, go on (agent.deadlock)."""
    standing_still: bool = True
    """Road users that crawl and do not speed up stop: models of mean motion approach a stand for ever."""
    speed_cap: bool = True
    """No road user accelerates beyond its models' top speed; faster ones decelerate at EASING to it."""


def constraints_of(guard: bool, without: Sequence[str]) -> Constraints:
    """The usual constraints, with the guard or not, and those named in `without` switched off. Raises InputError for
    unknown names."""
    names = [field.name for field in fields(Constraints) if field.name != "guard"]
    for name in without:
        if name not in names:
            raise InputError(
                f"there is no constraint of that name; use {', '.join(names)}", argument="without", value=name
            )
    return Constraints(guard=guard, **dict.fromkeys(without, False))


def stand_still(speed: Floats, acceleration: Floats, max_speed: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Acceleration (m/s², (n,)) under `standing_still`, and for which road users it ends in another speed, (n,).

    `speed` (m/s) now; `max_speed` (m/s) of the next interval.
    """
    constrained = halting(speed, acceleration, DECISION_INTERVAL)
    reached, free = (np.clip(speed + a * DECISION_INTERVAL, 0.0, max_speed) for a in (constrained, acceleration))
    return constrained, reached != free


def cap_speed(speed: Floats, acceleration: Floats, top_speed: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Highest speed (m/s, (n,)) of the next interval under `speed_cap`, and which road users it slows down, (n,).

    `top_speed`: of their models, m/s, (n,).
    """
    cap = np.maximum(top_speed, speed - EASING * DECISION_INTERVAL)
    return cap, speed + acceleration * DECISION_INTERVAL > cap
