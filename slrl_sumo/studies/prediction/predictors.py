"""Predictors of the road users of rollouts: constant velocity, the best mode in hindsight, or a selector of a
bundle."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.decide import Agent, consider, decide
from slrl_sumo.agent.selection import Selector, Uniform
from slrl_sumo.agent.selectors import PolicySelector, PriorSelector
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation, observe
from slrl_sumo.perception.scene import Scene
from slrl_sumo.routing.expected_routes import ExpectedRoute, routes_ahead
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.prediction.rollout import Moment, Motion, Move

Expected = Sequence[ExpectedRoute | None] | None
"""Expected routes of the members of a cast; None for members without one."""
ON_EXPECTED_ROUTES = Constraints(deadlock_release=False)
"""Constraints of predictions: road users with and without routes decide together, and road users may stand
throughout."""


def constant_velocity(moment: Moment) -> Motion:
    """All road users keep speed and heading."""
    still = np.zeros(len(moment.rows))
    return still, still, np.full(len(moment.rows), np.inf)


def step_oracle(bundle: ModelBundle, ground: RoadMap) -> Move:
    """At each step, the mode with the next position nearest to the true position, without regard to later steps.

    This needs the truth and is no prediction. The lower bound of predictions that hold one mode is the best `held_mode`
    over all modes.
    """

    def move(moment: Moment) -> Motion:
        observation = _observed(bundle, moment, ground)
        acceleration, yaw_rate = bundle.motions(observation.vector, observation.type)
        top = bundle.max_speed[observation.type]
        world, rows = moment.world, moment.rows
        # As `advance` moves them.
        speed = np.clip(world.speed[rows, None] + acceleration * DECISION_INTERVAL, 0.0, top[:, None])
        middle = world.heading[rows, None] + 0.5 * yaw_rate * DECISION_INTERVAL
        x = world.x[rows, None] + speed * DECISION_INTERVAL * np.cos(middle)
        y = world.y[rows, None] + speed * DECISION_INTERVAL * np.sin(middle)
        best = np.hypot(x - moment.next_x[:, None], y - moment.next_y[:, None]).argmin(1)[:, None]
        return np.take_along_axis(acceleration, best, 1)[:, 0], np.take_along_axis(yaw_rate, best, 1)[:, 0], top

    return move


def prior_central(bundle: ModelBundle, ground: RoadMap) -> Move:
    """The prior's single prediction: at each step its most central mode (see agent.selectors.central)."""
    return _decided(bundle, ground, lambda uniform: PriorSelector(bundle, uniform, sample=False), np.zeros((0, 0, 2)))


def held_mode(bundle: ModelBundle, ground: RoadMap, mode: int) -> Move:
    """All road users hold one mode of their type."""

    def move(moment: Moment) -> Motion:
        observation = _observed(bundle, moment, ground)
        motion = bundle.motion(observation, np.full(len(observation), mode))
        return *motion, bundle.max_speed[observation.type]

    return move


class PriorRanked:
    """Each road user holds the mode with the rank `rank` (U,), by member of the cast.

    Ranks refer to the prior's probabilities at its first decision; 0 is the most probable mode.
    """

    def __init__(self, bundle: ModelBundle, ground: RoadMap, rank: NDArray[np.int64]) -> None:
        self._bundle, self._ground, self._rank = bundle, ground, rank
        self._held = np.full(len(rank), -1)
        self.probability = np.ones(len(rank))
        """Probabilities of the held modes, (U,); 1 for road users that were never moved."""

    def __call__(self, moment: Moment) -> Motion:
        """Hold the modes (see Move)."""
        observation, users = _observed(self._bundle, moment, self._ground), moment.users
        rows = np.flatnonzero(self._held[users] < 0)
        new = users[rows]
        vector, kind = (values[rows] for values in tensors(observation))
        with torch.inference_mode():
            probability = torch.softmax(self._bundle.prior.logits(vector, kind).double(), -1)
            sorted_, order = probability.sort(stable=True, descending=True)
        chosen = np.arange(len(new)), self._rank[new]
        self._held[new], self.probability[new] = order.numpy()[chosen], sorted_.numpy()[chosen]
        held = self._held[users]
        return *self._bundle.motion(observation, held), self._bundle.max_speed[observation.type]


def prior_sampled(bundle: ModelBundle, ground: RoadMap, draws: Floats) -> Move:
    """Modes drawn from the prior and held as in a run (see PriorSelector).

    `draws` (U, steps, 2) from [0, 1), by member of the cast and step: for the mode, and whether the old one is held.
    """
    return _decided(bundle, ground, lambda uniform: PriorSelector(bundle, uniform), draws)


def policy_central(bundle: ModelBundle, ground: RoadMap, expected: Expected = None) -> Move:
    """The trained policy's single prediction: at each step its most central mode, as for the prior.

    `expected`: expected routes of the members of the cast; None without routes.
    """
    return _decided(bundle, ground, lambda uniform: PolicySelector(bundle, middle=True), np.zeros((0, 0)), expected)


def policy_chosen(bundle: ModelBundle, ground: RoadMap, draws: Floats | None, expected: Expected = None) -> Move:
    """Modes of the trained policy, which reads the ground, as in a run (see PolicySelector).

    `draws` (U, steps) from [0, 1) by member of the cast and step; None takes the most probable mode. `expected`: see
    policy_central. Raises InputError if the bundle has no policy.
    """
    if draws is None:
        return _decided(bundle, ground, lambda uniform: PolicySelector(bundle), np.zeros((0, 0)), expected)
    return _decided(bundle, ground, lambda uniform: PolicySelector(bundle, uniform), draws, expected)


def _decided(
    bundle: ModelBundle,
    ground: RoadMap,
    make_selector: Callable[[Uniform], Selector],
    draws: Floats,
    expected: Expected = None,
) -> Move:
    """The decision of a run, with random numbers that belong to members of the cast."""
    now: list[Moment] = []
    rules = Constraints() if expected is None else ON_EXPECTED_ROUTES
    agent = Agent(bundle, make_selector(lambda shape: draws[now[-1].users, now[-1].step].T), rules)

    def move(moment: Moment) -> Motion:
        now[:] = [moment]
        scene = _scene(moment, ground)
        if expected is not None:
            routes: list[ExpectedRoute | None] = [None] * len(moment.world)
            for row, user in zip(moment.rows.tolist(), moment.users.tolist(), strict=True):
                routes[row] = expected[user]
            scene = replace(scene, route=routes_ahead(routes, moment.world), group=None)
        motion = decide(consider(scene, agent), agent, moment.users.tolist())
        return motion.acceleration, motion.yaw_rate, motion.max_speed

    if expected is None:
        return move
    return lambda moment: _scene_by_scene(moment, move)


def _scene_by_scene(moment: Moment, move: Move) -> Motion:
    """The motion of road users, computed for each scene separately: with routes, all road users of a world interact."""
    result = np.empty((3, len(moment.rows)))
    for part, places in moment.scenes():
        result[:, places] = move(part)
    acceleration, yaw_rate, top = result
    return acceleration, yaw_rate, top


def _scene(moment: Moment, ground: RoadMap) -> Scene:
    return Scene(moment.world, moment.rows, ground, group=moment.scene, past=moment.past)


def _observed(bundle: ModelBundle, moment: Moment, ground: RoadMap) -> Observation:
    return observe(_scene(moment, ground), with_image=False, state=bundle.config.preset)
