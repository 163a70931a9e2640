"""The teacher: costs of modes from which the policy learns at first."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.agent.mode_cost import CostWeights, cost_on_route, cost_without_route
from slrl_sumo.learning.rewards.transition import RewardContext, lanes_here


def teacher_costs(situation: Situation, weights: CostWeights | None, ground: RewardContext) -> NDArray[np.float32]:
    """Cost of each mode for each of n road users, (n, modes), not negative; zeros without `weights`.

    The teacher has the same knowledge as the selector: no routes in the preset `paper`.
    """
    rollouts = situation.rollouts
    assert rollouts is not None
    if weights is None:
        return np.zeros(rollouts.collision.shape, np.float32)
    users = situation.scene.world.take(situation.scene.rows)
    if rollouts.route is not None:
        return cost_on_route(rollouts, weights, users.type, users.speed).astype(np.float32)
    lane_heading, limit, on_lane = lanes_here(users, ground.points)
    desired = np.minimum(ground.desired[users.type], limit)
    turned = users.heading - lane_heading
    return cost_without_route(rollouts, weights, desired, turned, on_lane).astype(np.float32)
