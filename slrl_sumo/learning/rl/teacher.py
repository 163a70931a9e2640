"""What speaks against each mode, for a teacher who looks ahead: pure functions on what modes lead to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

EASY = 0.8
"""Strain (see lookahead.route_fit.strain) up to which braking need not be harder."""
TURNING = 2.0
"""m/s from which steering counts in full: who hardly moves goes nowhere else for it."""
LEAST = 0.05


@dataclass(frozen=True)
class TeacherWeights:
    """What speaks against a mode; 0 switches a part off."""

    meeting: float = 50.0
    """Meeting somebody, the more the sooner."""
    off_surface: float = 10.0
    speed: float = 8.0
    """Relative to the desired speed."""
    lane: float = 2.0
    """Turning away from the lane's direction, for who is on one; without routes only."""
    steer: float = 60.0
    """Per rad from the heading that leads back to the path; pedestrians a third."""
    brake: float = 30.0
    """Braking too late for lines and leaders."""


def wandering(
    ahead: Floats, weights: TeacherWeights, desired: Floats, turned: Floats, on_lane: NDArray[np.bool_]
) -> Floats:
    """Against each mode of n road users without a route, (n, modes), 0 or more.

    `ahead` (n, modes, 4) as lookahead.lookahead.Lookahead has it; `desired` (n,) m/s; `turned` (n,) rad between
    heading and lane; `on_lane` (n,).
    """
    meeting, off_surface, speed, turn = np.moveaxis(ahead, -1, 0)
    wanted = desired[:, None]
    against = weights.meeting * meeting + weights.off_surface * off_surface
    against += weights.speed * np.abs(speed - wanted) / wanted
    aside = 1.0 - np.cos(turned[:, None] + turn)
    return np.asarray(against + weights.lane * np.where(on_lane[:, None], aside, 0.0))


def on_route(ahead: Floats, weights: TeacherWeights, kind: NDArray[np.int8], speed: Floats) -> Floats:
    """Against each mode of n road users with a route, (n, modes), 0 or more.

    `ahead` (n, modes, 9): the columns of Lookahead and RouteFit; `kind` (n,) types; `speed` (n,) m/s now.
    """
    meeting, off_surface, _, _, steer, _, pace, brake, follow = np.moveaxis(ahead, -1, 0)
    walks = (kind == RoadUserType.PEDESTRIAN)[:, None]
    moving = np.where(walks, 0.33, np.clip(speed[:, None] / TURNING, LEAST, 1.0))
    against = weights.meeting * meeting + np.where(walks, 0.4, 1.0) * weights.off_surface * off_surface
    against += weights.steer * steer * moving + weights.speed * np.abs(pace)
    late = np.maximum(brake - EASY, 0.0) + np.maximum(follow - EASY, 0.0)
    return np.asarray(against + weights.brake * late)
