"""The driver of learned road users: rolls out all modes, chooses a mode, and moves by its displacement model."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Agent, Situation, consider, decide
from slrl_sumo.agent.driver import Moved
from slrl_sumo.agent.path_smoothing import too_sharp
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.past_motion import PastMotion
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.perception.scene import Scene
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.refusals import Refusals


class ModelDriver:
    """The method of this package: rolls out all modes, chooses a mode, and moves by its displacement model.

    `routes`: for selectors that know the route, and for the constraints; None: road users know no routes.
    """

    has_models = True

    def __init__(self, agent: Agent, routes: Routes | None = None, *, stopwatch: Stopwatch | None = None) -> None:
        self.agent = agent
        self.situation: Situation | None = None
        """Inputs of the last decision, or of the next one after `consider`."""
        self.max_speed = agent.bundle.max_speed
        self.hardest_braking = agent.bundle.hardest_braking
        self._routes = routes
        self.refusals = Refusals() if routes is None else routes.refusals
        self._considered: WorldState | None = None
        self._stopwatch = stopwatch or Stopwatch()
        vector = vector_for(agent.bundle.config.preset, agent.selector.preset)
        self._past = None if vector == "paper" else PastMotion()

    def scene(self, world: WorldState, n: int, road_map: RoadMap, rows: NDArray[np.intp] | None = None) -> Scene:
        """The scene of the first `n` road users of `world`, or of `rows` among them, with their present routes."""
        past = None if self._past is None else self._past.of(world, n)
        rows = np.arange(n) if rows is None else rows
        if self._routes is None:
            return Scene(world, rows, road_map, past=past)
        expected = self._routes.at_kerb(world, n)
        places = None if expected is world else (world.x, world.y)
        return Scene(expected, rows, road_map, self._routes.ahead(expected, n), past=past, places=places)

    def consider(self, world: WorldState, n: int, road_map: RoadMap) -> Situation:
        """Compute the inputs of the next decision in advance; `drive` uses them if it gets the same `world`."""
        self.situation = consider(self.scene(world, n, road_map), self.agent)
        self._considered = world
        return self.situation

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """See Driver."""
        situation = self.situation
        if situation is None or self._considered is not world:
            situation = self.consider(world, n, road_map)
        self._considered = None
        self._stopwatch.lap("observe")
        users = world.take(np.arange(n))
        motion = decide(situation, self.agent, users.ids)
        self._stopwatch.lap("decide")
        moved = advance(users, motion.acceleration, motion.yaw_rate, motion.max_speed, DECISION_INTERVAL)
        return Moved(moved, motion.modes, motion.changed, situation.context)

    def images(self, rows: NDArray[np.intp]) -> NDArray[np.uint8] | None:
        """Ego images of the road users `rows` at the last decision, in the preset of the selector.

        They are also drawn for selectors that read no image. None before the first decision.
        """
        situation = self.situation
        if situation is None:
            return None
        if situation.observation.image is not None:
            return situation.observation.image[rows]
        context = situation.context if PRESETS[self.agent.selector.preset].knows_route else None
        return observe(replace(situation.scene, rows=rows), context=context).image

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: without routes, no destination is known."""
        return np.zeros(len(ids), np.bool_) if self._routes is None else self._routes.near_end(ids)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver."""
        return np.zeros(len(ids), np.bool_) if self._routes is None else self._routes.off_route(ids)

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: from the last decision."""
        situation = self.situation
        if situation is None or situation.context is None or situation.scene.route is None:
            return np.zeros(len(ids), np.bool_)
        rows = np.flatnonzero(too_sharp(situation.scene.route, situation.context.route))
        sharp = {situation.scene.world.ids[row] for row in rows}
        return np.array([road_user in sharp for road_user in ids], np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        self.agent.deadlock.forget(ids)
        if self._routes is not None:
            self._routes.forget(ids)
