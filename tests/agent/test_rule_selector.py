"""The selector `rule`: the least cost, also under masks and without a route."""

import numpy as np
import pytest

from slrl_sumo.agent.mode_cost import CostWeights, cost_on_route
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.route_fit import RouteFit
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats


def drawn(n: int, modes: int, *, route: bool) -> tuple[Observation, ModeRollouts]:
    """Road users of all types at 5 m/s, and rollouts with random fields."""
    rng = np.random.default_rng(3)
    kind = (np.arange(n) % 3).astype(np.int8)
    vector = np.zeros((n, len(FEATURES)), np.float32)
    vector[:, 0] = 5.0
    fields: list[Floats] = [rng.random((n, modes)) for _ in range(6)]
    fit = RouteFit(*(rng.random((n, modes)) for _ in RouteFit._fields)) if route else None
    return Observation(vector, None, kind), ModeRollouts(*fields, route=fit)


def test_the_mode_of_the_least_cost_is_chosen_of_those_that_are_allowed() -> None:
    seen, rollouts = drawn(30, 7, route=True)
    cost = cost_on_route(rollouts, CostWeights(), seen.type, np.full(30, 5.0))
    mask = np.random.default_rng(4).random((30, 7)) < 0.5
    mask[:, 3] = True
    free, masked = RuleSelector().choose(seen, rollouts, masks=[mask])
    assert free.tolist() == cost.argmin(axis=1).tolist()
    assert masked.tolist() == np.where(mask, cost, np.inf).argmin(axis=1).tolist()
    assert (free != masked).any()
    collision_only = CostWeights(**{name: 0.0 for name in vars(CostWeights()) if name != "collision"})
    (safest,) = RuleSelector(collision_only).choose(seen, rollouts)
    assert safest.tolist() == rollouts.collision.argmin(axis=1).tolist()


def test_without_a_route_road_users_keep_their_speed_and_avoid_collisions() -> None:
    seen, _ = drawn(1, 3, route=False)
    one, none = np.ones((1, 3)), np.zeros((1, 3))
    calm = ModeRollouts(one, none, none, none, np.array([[2.0, 5.0, 8.0]]), none)
    assert RuleSelector().choose(seen, calm)[0].tolist() == [1]
    ahead = ModeRollouts(one, none, np.array([[0.0, 0.9, 0.9]]), none, np.array([[2.0, 5.0, 8.0]]), none)
    assert RuleSelector().choose(seen, ahead)[0].tolist() == [0]
    with pytest.raises(ValueError, match="rollouts"):
        RuleSelector().choose(seen, None)
