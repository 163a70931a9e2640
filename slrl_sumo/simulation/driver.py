"""Who moves learned road users: a selector with the models of a bundle, or the lane follower."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.selector import PolicySelector, PriorSelector, Selector
from slrl_sumo.perception.observation import observe
from slrl_sumo.simulation.lookahead import with_ahead
from slrl_sumo.sumo.lanedriver import LaneDriver
from slrl_sumo.sumo.network import Network
from slrl_sumo.world.advance import advance
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL

SELECTORS = ("prior", "greedy", "sampled", "lane")
"""`prior`: the bundle's mode classifier; `greedy` and `sampled`: the most probable mode of its trained policy, or one
drawn from it; `lane`: the baseline that follows lanes and routes, without models."""

Modes = NDArray[np.int64] | None


class Driver(Protocol):
    """Says where the learned road users are one decision interval later."""

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """The n learned road users, which are the first rows of `world`, 0.4 s later, and their modes (n,) if any."""
        ...

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """Whose trip is nearly over, (n,), so that SUMO should finish it."""
        ...

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is remembered of road users that are no longer learned."""
        ...


class ModelDriver:
    """The method: observe, let the selector choose a mode, move by that mode's displacement model."""

    def __init__(self, bundle: ModelBundle, selector: Selector) -> None:
        self._bundle, self._selector = bundle, selector

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """See Driver."""
        rows = np.arange(len(learned))
        observation = observe(world, rows, roadmap, with_image=self._selector.needs_image)
        if self._selector.looks_ahead:
            observation = with_ahead(self._bundle, observation, world, rows, roadmap)
        modes = self._selector.choose(observation, learned.ids)
        acceleration, yaw_rate = self._bundle.motion(observation, modes)
        max_speed = self._bundle.max_speed[learned.type]
        return advance(learned, acceleration, yaw_rate, max_speed, DECISION_INTERVAL), modes

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver: the models know no destination."""
        return np.zeros(len(learned), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver: nothing is remembered."""


class RouteDriver:
    """The baseline `lane`: everybody follows the own lane and route."""

    def __init__(self, lanes: LaneDriver) -> None:
        self._lanes = lanes

    def drive(self, world: WorldState, learned: WorldState, roadmap: RoadMap) -> tuple[WorldState, Modes]:
        """See Driver."""
        others = world.take(np.arange(len(learned), len(world)))
        return self._lanes.drive(learned, DECISION_INTERVAL, others), None

    def near_end(self, learned: WorldState) -> NDArray[np.bool_]:
        """See Driver: SUMO finishes trips, because only it can take a road user off the network as arrived."""
        return self._lanes.near_end(learned.ids)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        self._lanes.forget(ids)


def usual_selector(bundle: ModelBundle) -> str:
    """The selector where none is named: the trained one, by its most probable modes, else the prior."""
    return "prior" if bundle.policy is None else "greedy"


def make_driver(selector: str, bundle: ModelBundle, api: Any, network: Network, seed: int) -> Driver:
    """The driver of one of SELECTORS, in a simulation seen through `api`. Raises InputError for any other name."""
    if selector == "lane":
        return RouteDriver(LaneDriver(api, network))
    if selector == "prior":
        return ModelDriver(bundle, PriorSelector(bundle, seed))
    if selector in ("greedy", "sampled"):
        return ModelDriver(bundle, PolicySelector(bundle, seed, sample=selector == "sampled"))
    raise InputError(f"--selector {selector}: there is none of that name; use {' or '.join(SELECTORS)}")
