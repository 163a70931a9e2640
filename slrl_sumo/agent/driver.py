"""What drives learned road users: the models of a bundle with a selector, or the lane-following baseline."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Changed
from slrl_sumo.agent.selection import Modes
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.refusals import Refusals


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
