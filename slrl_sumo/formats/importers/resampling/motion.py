"""Headings from motion, for data that has none."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.types import RoadUserType

DIRECTION_SPEED = 0.3
"""m/s. Below it the direction of motion is unreliable, and the heading is held."""

POSITION_NOISE = 0.05
"""m. The direction of a step of d metres is trusted to about POSITION_NOISE / d radians."""

# Usual turn of a heading in one step, by type: per metre driven, and a constant (rad). Cars and bicycles turn only
# while moving, a car along a curve of more than 5 m radius; pedestrians may turn at any speed.
_TURN_PER_METRE = np.array([0.08, 0.15, 0.15])
_TURN_PER_STEP = np.array([0.01, 0.02, 0.12])
_TURN_SLOW = 0.003
"""rad per step below `DIRECTION_SPEED`."""


def heading_from_motion(
    x: Floats, y: Floats, track: Integers, type: NDArray[np.int8], dt: float, still: Floats
) -> Floats:
    """Headings (R,) in rad of tracks given by their positions (R,) in m every `dt` s, sorted by track.

    The result is the most likely one, given that the direction of a step is the mean of the headings at its ends (as in
    `advance`) and more precise the longer the step, and given the usual turns of the type. Steps below
    `DIRECTION_SPEED` carry no information and nearly no turn: the heading is held. A car that drives backwards keeps
    its heading. Tracks that never move take `still` (T,), rad; `type` is (T,) as well.
    """
    rows = len(x)
    step = np.hypot(np.diff(x), np.diff(y))  # from row i to row i + 1
    inside = np.diff(track) == 0
    moving = inside & (step >= DIRECTION_SPEED * dt)
    kind = type[track]

    measured = np.zeros(rows - 1 if rows else 0)
    at = np.flatnonzero(moving)
    direction = np.arctan2(np.diff(y)[at], np.diff(x)[at])
    cars = kind[at] == RoadUserType.CAR
    for chosen, period in ((cars, np.pi), (~cars, 2 * np.pi)):
        measured[at[chosen]] = np.unwrap(direction[chosen], period=period)
    # The axis of a car is known up to half a turn: it drives forwards over most of its path.
    forwards = np.bincount(track[at], step[at] * np.cos(direction - measured[at]), minlength=len(type))
    measured[at] += np.where(forwards < 0, np.pi, 0.0)[track[at]]

    # Least squares over all rows at once; the tracks are separate blocks of one tridiagonal system.
    trust = np.where(moving, (step / POSITION_NOISE) ** 2, 0.0)
    turn = np.where(moving, _TURN_PER_METRE[kind[:-1]] * step + _TURN_PER_STEP[kind[:-1]], _TURN_SLOW)
    stiff = np.where(inside, 1 / turn**2, 0.0)
    has_motion = np.bincount(track[at], minlength=len(type)) > 0
    diagonal = np.where(has_motion[track], 0.0, 1.0)
    right = np.where(has_motion[track], 0.0, still[track])
    stiff *= has_motion[track[:-1]]
    beside = 0.25 * trust - stiff
    for end in (slice(None, -1), slice(1, None)):
        diagonal[end] += 0.25 * trust + stiff
        right[end] += 0.5 * trust * measured
    # The solver takes no system of one row.
    heading = solveh_banded(np.stack([np.r_[0.0, beside], diagonal]), right) if rows > 1 else right / diagonal
    return wrap_angle(heading)
