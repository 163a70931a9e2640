"""Costs of modes, as pure functions on their rollouts: the selector `rule` minimises them; imitation begins there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.off_surface import JUST_OFF
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

EASY = 0.8
"""Stop or follow ratio (see lookahead.route_fit) up to which braking need not be harder."""
TURNING = 2.0
"""m/s from which steering counts in full: a road user that hardly moves does not change its place by it."""
LEAST = 0.05


@dataclass(frozen=True)
class CostWeights:
    """Weights of the costs of a mode; 0 switches a cost off."""

    collision: float = 50.0
    """Of a collision, the higher the sooner it comes."""
    off_surface: float = 10.0
    """Of being off the own surface; with a route of being just off it, by 1 m four times as much."""
    speed: float = 8.0
    """Of the difference to the desired speed, relative to it."""
    lane: float = 2.0
    """Of turning away from the direction of the lane; without routes only."""
    heading_error: float = 600.0
    """Per rad², from the heading that leads back to the path; a third of it for pedestrians, at most `speed` per rad.
    Squared, because a small error is made good in the next decision: with an error in proportion, cars speed up only
    straight on."""
    braking: float = 30.0
    """Of braking too late for stop lines and leaders."""


def cost_without_route(
    rollouts: ModeRollouts, weights: CostWeights, desired: Floats, turned: Floats, on_lane: NDArray[np.bool_]
) -> Floats:
    """Costs of the modes of n road users without a route, (n, modes), not negative.

    `desired` (n,) m/s; `turned` (n,) rad between heading and lane; `on_lane` (n,): where there is a lane.
    """
    wanted = desired[:, None]
    cost = weights.collision * rollouts.collision + weights.off_surface * rollouts.off_surface
    cost += weights.speed * np.abs(rollouts.speed - wanted) / wanted
    deviation = 1.0 - np.cos(turned[:, None] + rollouts.turn)
    return np.asarray(cost + weights.lane * np.where(on_lane[:, None], deviation, 0.0))


def cost_on_route(rollouts: ModeRollouts, weights: CostWeights, kind: NDArray[np.int8], speed: Floats) -> Floats:
    """Costs of the modes of n road users with a route, (n, modes), not negative.

    `kind` (n,) types; `speed` (n,) m/s now.
    """
    fit = rollouts.route
    assert fit is not None
    walking = (kind == RoadUserType.PEDESTRIAN)[:, None]
    moving = np.where(walking, 0.33, np.clip(speed[:, None] / TURNING, LEAST, 1.0))
    cost = weights.collision * rollouts.collision
    cost += weights.off_surface / JUST_OFF * rollouts.off_surface
    turned = weights.heading_error * fit.heading_error**2 * moving
    # Of a pedestrian no more than the velocity differs from that along the path, so that it walks around what is in its
    # way: with the square it stood still before it, and crowds at corners jammed. Nothing where it stops: one that
    # cannot turn at its pace stops to turn, as it must with the straight modes of `shared-space` at a sharp corner.
    most = weights.speed * fit.heading_error * np.clip(1.0 + fit.speed_error, 0.0, 1.0)
    turned = np.where(walking, np.minimum(turned, most), turned)
    cost += turned + weights.speed * np.abs(fit.speed_error)
    # What the leader's braking gives is not shortened: at 33 m/s that would make 1.1 s of headway 1.9 s.
    behind = fit.follow_ratio - (1.0 - EASY) * fit.leader_ratio
    late = np.maximum(fit.stop_ratio - EASY, 0.0) + np.maximum(behind - EASY, 0.0)
    return np.asarray(cost + weights.braking * late)
