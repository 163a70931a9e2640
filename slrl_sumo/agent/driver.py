"""The interface of drivers of learned road users: a bundle's models with a selector, or the lane-following baseline."""

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
    """Chosen modes, (n,); None if the driver has no modes."""
    changed: Changed
    """Decisions that each constraint has changed."""
    context: RouteContext | None = None
    """Routes at the decision; None if the driver knows no routes."""


class Driver(Protocol):
    """Moves the learned road users by one decision interval."""

    max_speed: Floats
    """Top speed of each type, m/s, (3,)."""
    hardest_braking: Floats
    """Acceleration of each type in emergency braking, m/s², (3,)."""
    has_models: bool
    """Whether learned models move the road users: then vehicles unlike the recorded vehicles are not taken over."""
    refusals: Refusals
    """Road users for which SUMO has refused a call."""

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """The first `n` road users of `world`, the learned road users, 0.4 s later."""
        ...

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users are so near the end of their trip that SUMO should finish it, (n,)."""
        ...

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users have left their route and cannot return, (n,), so that SUMO should put them back."""
        ...

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which of n road users have a turn ahead that is too sharp for their models, (n,), so that SUMO should
        drive."""
        ...

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the state of road users that are no longer learned."""
        ...
