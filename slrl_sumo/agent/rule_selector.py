"""The selector `rule`: the mode of the least cost, without any learning."""

from collections.abc import Hashable, Sequence

import numpy as np

from slrl_sumo.agent.mode_cost import CostWeights, cost_on_route, cost_without_route
from slrl_sumo.agent.selection import Mask, Modes
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.models.motion_models import SPEED
from slrl_sumo.perception.observation import Observation

SLOWEST = 0.5
"""Least desired speed (m/s) without a route: speed differences are relative to the desired speed."""


class RuleSelector:
    """Chooses the mode of the least cost over the named fields of the mode rollouts (see agent.mode_cost).

    It is the baseline without learning that a trained policy has to exceed. Without routes, as in recordings, road
    users keep their speed.
    """

    needs_image = False
    needs_rollouts = True
    preset = "extended"

    def __init__(self, weights: CostWeights | None = None) -> None:
        self._weights = weights or CostWeights()

    def choose(
        self,
        observation: Observation,
        rollouts: ModeRollouts | None,
        ids: Sequence[Hashable] | None = None,
        masks: Sequence[Mask] = (),
    ) -> list[Modes]:
        """See Selector."""
        if rollouts is None:
            raise ValueError("this selector needs mode rollouts")
        speed = observation.vector[:, SPEED].astype(np.float64)
        if rollouts.route is None:
            nothing = np.zeros(len(observation))
            desired, on_lane = np.maximum(speed, SLOWEST), np.zeros(len(observation), np.bool_)
            cost = cost_without_route(rollouts, self._weights, desired, nothing, on_lane)
        else:
            cost = cost_on_route(rollouts, self._weights, observation.type, speed)
        allowed = [cost, *(np.where(mask, cost, np.inf) for mask in masks)]
        return [np.asarray(each.argmin(axis=1), np.int64) for each in allowed]
