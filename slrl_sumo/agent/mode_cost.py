"""Costs of modes, as pure functions of their rollouts: the selector `rule` minimises them, and imitation starts from
it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.off_surface import JUST_OFF
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import PEDESTRIAN

EASY = 0.8
"""Stop or follow ratio (see lookahead.route_fit) up to which harder braking is not needed."""
TURNING = 2.0
"""Speed (m/s) from which steering counts in full: steering hardly moves a slow road user."""
LEAST = 0.05


@dataclass(frozen=True)
class CostWeights:
    """Weights of the costs of a mode; 0 switches a cost off."""

    collision: float = 50.0
    """Weight of the collision score, which is higher for earlier collisions."""
    off_surface: float = 10.0
    """Weight of leaving the own surfaces. With a route, a place 1 m off costs four times as much as a place just
    off."""
    speed: float = 8.0
    """Weight of the relative difference to the desired speed."""
    lane: float = 2.0
    """Weight of the deviation from the direction of the lane; without routes only."""
    heading_error: float = 600.0
    """Weight (per rad²) of the squared heading error; a third of it for pedestrians, at most `speed` per rad. The error
    is squared because the next decision corrects a small error: with a linear cost, cars accelerate only straight
    ahead."""
    braking: float = 30.0
    """Weight of braking too late for stop lines and leaders."""


def cost_without_route(
    rollouts: ModeRollouts, weights: CostWeights, desired: Floats, turned: Floats, on_lane: NDArray[np.bool_]
) -> Floats:
    """Costs of the modes of n road users without a route, (n, modes), not negative.

    `desired` (n,): desired speed, m/s. `turned` (n,): angle (rad) between heading and lane. `on_lane` (n,): whether
    there is a lane.
    """
    wanted = desired[:, None]
    cost = weights.collision * rollouts.collision + weights.off_surface * rollouts.off_surface
    cost += weights.speed * np.abs(rollouts.speed - wanted) / wanted
    deviation = 1.0 - np.cos(turned[:, None] + rollouts.turn)
    return np.asarray(cost + weights.lane * np.where(on_lane[:, None], deviation, 0.0))


def cost_on_route(rollouts: ModeRollouts, weights: CostWeights, kind: NDArray[np.int8], speed: Floats) -> Floats:
    """Costs of the modes of n road users with a route, (n, modes), not negative.

    `kind` (n,): types. `speed` (n,): present speed, m/s.
    """
    fit = rollouts.route
    assert fit is not None
    walking = (kind == PEDESTRIAN)[:, None]
    moving = np.where(walking, 0.33, np.clip(speed[:, None] / TURNING, LEAST, 1.0))
    cost = weights.collision * rollouts.collision
    cost += weights.off_surface / JUST_OFF * rollouts.off_surface
    turned = weights.heading_error * fit.heading_error**2 * moving
    # The heading error of a pedestrian costs at most the difference between its velocity and the velocity along the
    # path, so that it walks around obstacles: with the squared error, pedestrians stood still before obstacles, and
    # crowds at corners jammed. A stop costs nothing here: a pedestrian that cannot turn at its speed stops to turn, as
    # with the straight modes of `shared-space` at a sharp corner.
    most = weights.speed * fit.heading_error * np.clip(1.0 + fit.speed_error, 0.0, 1.0)
    turned = np.where(walking, np.minimum(turned, most), turned)
    cost += turned + weights.speed * np.abs(fit.speed_error)
    # EASY does not apply to the leader's stopping distance: at 33 m/s, a headway of 1.1 s would become 1.9 s.
    behind = fit.follow_ratio - (1.0 - EASY) * fit.leader_ratio
    late = np.maximum(fit.stop_ratio - EASY, 0.0) + np.maximum(behind - EASY, 0.0)
    return np.asarray(cost + weights.braking * late)
