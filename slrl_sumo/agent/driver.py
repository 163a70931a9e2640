"""Drivers of learned road users in SUMO: the models of a bundle with a selector, or the lane-following baseline."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.decide import Agent, Changed, Situation, consider, decide
from slrl_sumo.agent.lane_driver import LaneDriver
from slrl_sumo.agent.path_smoothing import too_sharp
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.agent.selection import Modes, Selector
from slrl_sumo.agent.selectors import PolicySelector, PriorSelector
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.jobs.row_threads import RowThreads
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.bundle_folder import usual_of
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.past_motion import PastMotion
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.scene import Scene
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals

SELECTORS = ("prior", "rule", "greedy", "sampled", "lane")
"""`prior`: the bundle's mode classifier; `rule`: the mode of the least cost, without learning; `greedy` and `sampled`:
the most probable mode of its trained policy, or one sampled from it; `lane`: the baseline that follows lanes, without
models."""

TRAINED = ("greedy", "sampled")
"""Those that need the bundle's trained policy."""

GUARDED = "+guard"
"""Suffix of a selector's name in tables where it runs with the guard."""


@dataclass(frozen=True, eq=False)
class Moved:
    """n learned road users one decision interval later."""

    users: WorldState
    modes: Modes | None
    """Their modes, (n,); None where the driver knows no modes."""
    changed: Changed
    """Which decisions each constraint has changed."""
    context: RouteContext | None = None
    """Their routes at the decision; None where the driver knows no routes."""


class Driver(Protocol):
    """Decides where the learned road users are one decision interval later."""

    max_speed: Floats
    """Top speed of each type, m/s, (3,)."""
    has_models: bool
    """Whether learned models move the road users, so that vehicles unlike the recorded ones are not taken over."""
    refusals: Refusals
    """Road users for which SUMO has refused a call."""

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """The first `n` road users of `world`, which are the learned ones, 0.4 s later."""
        ...

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users are so near the end of their trip that SUMO should finish it, (n,)."""
        ...

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users have left their route and cannot go on, (n,), so that SUMO should put them back."""
        ...

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users have a turn ahead that is too sharp for them, (n,), so that SUMO should drive it."""
        ...

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the memory of road users that are no longer learned."""
        ...


class ModelDriver:
    """The method: considers all modes, decides for one, moves by its displacement model.

    `routes`: of selectors that know their route, and for the guard; None: road users know no routes.
    """

    has_models = True

    def __init__(self, agent: Agent, routes: Routes | None = None, *, stopwatch: Stopwatch | None = None) -> None:
        self.agent = agent
        self.situation: Situation | None = None
        """What the last decision was, or the next one will be, taken from."""
        self.max_speed = agent.bundle.max_speed
        self._routes = routes
        self.refusals = Refusals() if routes is None else routes.refusals
        self._considered: WorldState | None = None
        self._stopwatch = stopwatch or Stopwatch()
        vector = vector_for(agent.bundle.config.preset, agent.selector.preset)
        self._past = None if vector == "paper" else PastMotion()

    def scene(self, world: WorldState, n: int, road_map: RoadMap, rows: NDArray[np.intp] | None = None) -> Scene:
        """The scene of the first `n` road users of `world`, or `rows` of them, with their routes as they are now."""
        past = None if self._past is None else self._past.of(world, n)
        rows = np.arange(n) if rows is None else rows
        if self._routes is None:
            return Scene(world, rows, road_map, past=past)
        expected = self._routes.at_kerb(world, n)
        places = None if expected is world else (world.x, world.y)
        return Scene(expected, rows, road_map, self._routes.ahead(expected, n), past=past, places=places)

    def consider(self, world: WorldState, n: int, road_map: RoadMap) -> Situation:
        """Look ahead of time at what the next `drive` decides from, if `world` is its world."""
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
        """What the road users `rows` saw at the last decision, in the preset of the selector, also where that reads no
        image; None before the first decision."""
        situation = self.situation
        if situation is None:
            return None
        if situation.observation.image is not None:
            return situation.observation.image[rows]
        context = situation.context if PRESETS[self.agent.selector.preset].knows_route else None
        return observe(replace(situation.scene, rows=rows), context=context).image

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: without routes no destination is known."""
        return np.zeros(len(ids), np.bool_) if self._routes is None else self._routes.near_end(ids)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver."""
        return np.zeros(len(ids), np.bool_) if self._routes is None else self._routes.off_route(ids)

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: as the last decision saw it."""
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


class RouteDriver:
    """The baseline `lane`: each road user follows its lane and route."""

    has_models = False

    def __init__(self, lanes: LaneDriver) -> None:
        self._lanes = lanes
        self.max_speed: Floats = np.full(len(RoadUserType), np.inf)
        self.refusals = lanes.refusals

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """See Driver."""
        learned, others = world.take(np.arange(n)), world.take(np.arange(n, len(world)))
        return Moved(self._lanes.drive(learned, DECISION_INTERVAL, others), None, {})

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: SUMO finishes trips, because only SUMO can take a road user off the network as arrived."""
        return self._lanes.near_end(ids)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: it keeps to its lanes."""
        return np.zeros(len(ids), np.bool_)

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: no turn is too sharp."""
        return np.zeros(len(ids), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        self._lanes.forget(ids)


def unknown_selector(name: str) -> InputError:
    """The error where there is no selector `name`."""
    return InputError(f"there is none of that name; use {' or '.join(SELECTORS)}", argument="selector", value=name)


def usual_selector(bundle: ModelBundle) -> str:
    """The selector where none is named: the trained one, unless its bundle names another; without one `rule`."""
    return "rule" if bundle.policy is None and bundle.network is None else usual_of(bundle.policy_training or {})


def make_selector(name: str, bundle: ModelBundle, seed: int) -> Selector:
    """The selector `prior`, `rule`, `greedy` or `sampled`. Raises InputError where the bundle has no trained policy for
    the last two."""
    if name == "rule":
        return RuleSelector()
    uniform = np.random.default_rng(seed).random
    if name == "prior":
        return PriorSelector(bundle, uniform)
    return PolicySelector(bundle, uniform if name == "sampled" else None)


def make_driver(
    selector: str,
    bundle: ModelBundle,
    api: SumoApi,
    network: Network,
    seed: int,
    *,
    constraints: Constraints | None = None,
    stopwatch: Stopwatch | None = None,
    threads: int = 1,
) -> Driver:
    """The driver of one of SELECTORS, in a simulation seen through `api`; a `stopwatch` measures its parts. Road
    users are distributed over so many `threads`.

    Raises InputError for any other name, and for a guard of `lane`, which has no modes.
    """
    constraints = constraints or Constraints()
    if selector == "lane":
        if constraints.guard:
            raise InputError(
                "`selector='lane'` chooses no modes; leave the guard out, or take another selector", argument="guard"
            )
        return RouteDriver(LaneDriver(api, network))
    if selector not in SELECTORS:
        raise unknown_selector(selector)
    chooser = make_selector(selector, bundle, seed)
    routes = Routes(api, network) if constraints.guard or PRESETS[chooser.preset].knows_route else None
    return ModelDriver(Agent(bundle, chooser, constraints, threads=RowThreads(threads)), routes, stopwatch=stopwatch)
