"""Who moves learned road users: a selector with the models of a bundle, or the lane follower."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.deadlock import DeadlockTimer, going
from slrl_sumo.agent.guard import allowed_modes
from slrl_sumo.agent.lane_driver import LaneDriver
from slrl_sumo.agent.selectors import PolicySelector, PriorSelector, Selector
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.lookahead.leaders import leaders
from slrl_sumo.lookahead.lookahead import look_ahead, told
from slrl_sumo.lookahead.route_fit import RouteContext
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import Capability, capability_of, fitted
from slrl_sumo.perception.observation import Way, observe
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.advance import advance, halting
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network

SELECTORS = ("prior", "greedy", "sampled", "lane")
"""`prior`: the bundle's mode classifier; `greedy` and `sampled`: the most probable mode of its trained policy, or one
drawn from it; `lane`: the baseline that follows lanes and routes, without models."""

GUARDED = "+guard"
"""What is appended to a selector's name where tables show it with the guard."""
LONGEST = 8.0
"""m: models that learned from cars turn buses and lorries with trailers into the next lane."""
EASING = 3.0
"""m/s²."""

Modes = NDArray[np.int64] | None


class Driver(Protocol):
    """Says where the learned road users are one decision interval later."""

    max_speed: Floats
    """m/s that each type does at most, (3,)."""
    max_length: float
    """m that the vehicles may be long that it drives: others are not taken over."""

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """The n learned road users, which are the first rows of `world`, 0.4 s later, and their modes (n,) if any."""
        ...

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """Whose trip is nearly over, (n,), so that SUMO should finish it."""
        ...

    def astray(self, learned: WorldState) -> NDArray[np.bool_]:
        """Who has turned off its route and cannot go on, (n,), so that SUMO should put it back there."""
        ...

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is remembered of road users that are no longer learned."""
        ...


class ModelDriver:
    """The method: observe, let the selector choose a mode, move by that mode's displacement model.

    With `routes` (selectors of the preset `extended`, and the `guard`) road users know where they are going.
    """

    def __init__(
        self,
        bundle: ModelBundle,
        selector: Selector,
        routes: Routes | None = None,
        *,
        guard: bool = False,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        self._stopwatch = stopwatch or Stopwatch()
        self._bundle, self._selector, self._routes, self._guard = bundle, selector, routes, guard
        self._patience = DeadlockTimer()
        self.way: Way | None = None
        """What the selector saw of the routes at the last decision; None where it sees none (preset `paper`)."""
        self._able = None if routes is None else capability_of(bundle)
        self.max_speed = bundle.max_speed
        self.max_length = LONGEST

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """See Driver."""
        rows = np.arange(len(learned))
        selector = self._selector
        context = self._prospects(world, len(learned))
        extended = selector.preset == "extended"
        self.way = context.way if extended and context is not None else None
        observation = observe(world, rows, roadmap, selector.needs_image, self.way)
        allowed = ahead = None
        if context is not None:
            ahead = look_ahead(self._bundle, observation, world, rows, roadmap, context, touching=self._guard)
            routed = told(observation, ahead)
            assert routed.ahead is not None
            if ahead.touching is not None:
                allowed = allowed_modes(routed.ahead, learned.type, context.route, ahead.touching)
            allowed = going(routed.ahead, self._patience.tolerance(learned, context), allowed)
            observation = routed if extended else observation
        if selector.looks_ahead and observation.ahead is None:
            ahead = look_ahead(self._bundle, observation, world, rows, roadmap)
            observation = told(observation, ahead)
        self._stopwatch.lap("observe")
        modes = selector.choose(observation, learned.ids, allowed)
        self._stopwatch.lap("decide")
        if ahead is None:
            acceleration, yaw_rate = self._bundle.motion(observation, modes)
        else:
            acceleration, yaw_rate = ahead.acceleration[rows, modes], ahead.yaw_rate[rows, modes]
        if context is not None:
            acceleration = halting(learned.speed, acceleration, DECISION_INTERVAL)
        # Who was taken over at a higher speed comes down to what the models know as one brakes, not at once.
        max_speed = np.maximum(self.max_speed[learned.type], learned.speed - EASING * DECISION_INTERVAL)
        return advance(learned, acceleration, yaw_rate, max_speed, DECISION_INTERVAL), modes

    def _prospects(self, world: WorldState, n: int) -> RouteContext | None:
        if self._routes is None or self._able is None:
            return None
        return route_context(self._routes, world, n, self._able)

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver: without routes no destination is known."""
        if self._routes is None:
            return np.zeros(len(learned), np.bool_)
        return self._routes.near_end(learned.ids)

    def astray(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver."""
        if self._routes is None:
            return np.zeros(len(learned), np.bool_)
        return self._routes.off_route(learned.ids)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        if self._routes is not None:
            self._routes.forget(ids)


def route_context(routes: Routes, world: WorldState, n: int, able: Capability) -> RouteContext:
    """What lies ahead of the first `n` road users of `world` on their routes, as their models can drive it."""
    route = fitted(routes.ahead(world, n), world, able)
    return RouteContext(route, leaders(route, world), able)


class RouteDriver:
    """The baseline `lane`: everybody follows the own lane and route."""

    def __init__(self, lanes: LaneDriver) -> None:
        self._lanes = lanes
        self.max_speed: Floats = np.full(len(RoadUserType), np.inf)
        self.max_length = np.inf

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """See Driver."""
        others = world.take(np.arange(len(learned), len(world)))
        return self._lanes.drive(learned, DECISION_INTERVAL, others), None

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver: SUMO finishes trips, because only it can take a road user off the network as arrived."""
        return self._lanes.near_end(learned.ids)

    def astray(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver: it keeps to its lanes."""
        return np.zeros(len(learned), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        self._lanes.forget(ids)


def usual_selector(bundle: ModelBundle) -> str:
    """The selector where none is named: the trained one, by its most probable modes, else the prior."""
    return "prior" if bundle.policy is None else "greedy"


def make_driver(
    selector: str,
    bundle: ModelBundle,
    api: SumoApi,
    network: Network,
    seed: int,
    *,
    guard: bool = False,
    stopwatch: Stopwatch | None = None,
) -> Driver:
    """The driver of one of SELECTORS, in a simulation seen through `api`.

    With `guard` modes that lead into a conflict are not chosen (see agent.guard); a `stopwatch` is told where
    the time goes. Raises InputError for any other name, and for a guard of `lane`, which has no modes.
    """
    if selector == "lane":
        if guard:
            raise InputError("--guard: --selector lane chooses no modes; leave the guard out, or take another selector")
        return RouteDriver(LaneDriver(api, network))
    chooser: Selector
    if selector == "prior":
        chooser = PriorSelector(bundle, seed)
    elif selector in ("greedy", "sampled"):
        chooser = PolicySelector(bundle, seed, sample=selector == "sampled")
    else:
        raise InputError(f"--selector {selector}: there is none of that name; use {' or '.join(SELECTORS)}")
    routes = Routes(api, network) if guard or chooser.preset == "extended" else None
    return ModelDriver(bundle, chooser, routes, guard=guard, stopwatch=stopwatch)
