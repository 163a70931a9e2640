"""Transitions of the learned road users of a simulation, and their terms of the reward."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.ground.surfaces import OWN_SURFACE, Surface
from slrl_sumo.learning.rewards import terms as rewards
from slrl_sumo.learning.rewards.terms import TERMS
from slrl_sumo.lookahead.off_surface import JUST_OFF, OWN, WALK, distance_off
from slrl_sumo.lookahead.route_fit import allowed_speed
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.capability import Capability
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, POINTS, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.events import Decision
from slrl_sumo.sumo.network.lanes import LanePoints

DESTINATION_HORIZON = 4.8
"""Time (s) from the present moment of a window to its destination (paper, section 3.2)."""
MOVING_DISTANCE = rewards.REWARDED_SPEED * DESTINATION_HORIZON


@dataclass(frozen=True)
class RewardContext:
    """Data of a simulation for the terms: points on its lanes by type, desired speeds (m/s) by type, and models."""

    points: tuple[LanePoints, ...]
    desired: Floats
    bundle: ModelBundle
    capability: Capability


@dataclass(frozen=True, eq=False)
class Transition:
    """A decision of n road users, the first road users of `world`, and its outcome."""

    ground: RewardContext
    before: Situation
    modes: NDArray[np.int64]
    """Chosen modes, (n,)."""
    world: WorldState
    """All road users after the decision."""
    decision: Decision
    hit: NDArray[np.bool_]
    """In a new contact by own fault, (n,)."""
    lost: NDArray[np.bool_]
    """Off the ground, or off the route, (n,)."""
    reached: NDArray[np.bool_] | None = None
    """At the destination, (n,); None for road users without trips."""

    def terms(self, wanted: Collection[str] = TERMS) -> dict[str, Floats]:
        """The `wanted` terms of the reward before weighting, (n,) each, by name."""
        return {name: self._by_name[name]() for name in TERMS if name in wanted}

    @cached_property
    def _by_name(self) -> dict[str, Callable[[], Floats]]:
        n, learned = len(self.modes), self.users
        return {
            "close": lambda: rewards.close(self.world, n),
            "off_surface": self._off_surface,
            "moving": lambda: rewards.moving(learned.speed),
            "alive": lambda: rewards.alive(n),
            "contact": lambda: rewards.contact(self.hit),
            "lost": lambda: rewards.lost(self.lost),
            "danger": lambda: rewards.danger(self.world, n),
            "speed": lambda: rewards.speed_kept(learned.speed, self._desired),
            "wrong_way": lambda: rewards.wrong_way(learned.heading, self._lanes[0], self._lanes[2]),
            "comfort": lambda: rewards.comfort(learned.speed, learned.acceleration, learned.yaw_rate),
            "realism": lambda: rewards.realism(self._log_probability),
            "progress": lambda: self._along["progress"],
            "excess": lambda: self._along["excess"],
            "off_path": lambda: self._along["off_path"],
            "red": lambda: self._along["red"],
            "priority": lambda: self._along["priority"],
            "arrival": lambda: rewards.arrival(self.reached, n),
        }

    @cached_property
    def users(self) -> WorldState:
        """The n road users after the decision."""
        return self.world.take(np.arange(len(self.modes)))

    @cached_property
    def _lanes(self) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        return lanes_here(self.users, self.ground.points)

    @cached_property
    def _log_probability(self) -> Floats:
        """Log probability of each chosen mode under the bundle's prior, (n,)."""
        with torch.inference_mode():
            every = torch.log_softmax(self.ground.bundle.prior.logits(*tensors(self.before.observation)), -1)
            return every.double().numpy()[np.arange(len(self.modes)), self.modes]

    @cached_property
    def _allowed(self) -> Floats:
        """Allowed speeds (m/s) on the routes before the decision, (n,)."""
        context, scene = self.before.context, self.before.scene
        assert context is not None
        return allowed_speed(context, self.ground.capability, scene.world.take(scene.rows))

    @cached_property
    def _known(self) -> NDArray[np.bool_]:
        assert self.before.context is not None
        return self.before.context.route.known & ~self.decision.wrapped_around

    @cached_property
    def _desired(self) -> Floats:
        learned = self.users
        if self.before.context is None:
            return np.minimum(self.ground.desired[learned.type], self._lanes[1])
        return np.where(self._known, self._allowed, learned.speed)

    def _off_surface(self) -> Floats:
        """The term `off_surface`.

        With a route, the penalty grows with the distance, like the cost in the lookahead, and carriageways, cycleways
        and crossings belong to pedestrians only where their path leads over these: with a tenth of the penalty (paper,
        r2), pedestrians waited for their signal in the way of turning cars.
        """
        surface, context, users = self.decision.surface, self.before.context, self.users
        if context is None:
            return rewards.off_surface(users.type, surface)
        route, road_map, (along, _) = context.route, self.before.scene.road_map, self._on_path
        on_foot = self._known & (users.type == RoadUserType.PEDESTRIAN)
        rows = np.flatnonzero(on_foot & ~OWN[WALK, surface])
        points = np.clip(HERE + np.rint(along[rows] / route.spacing[rows]).astype(np.intp), 0, POINTS - 1)
        there = road_map.surface_at(route.x[rows, points], route.y[rows, points])
        foreign = surface.copy()
        foreign[rows[OWN[WALK, there]]] = Surface.NONE
        penalty = rewards.off_surface(users.type, foreign)
        off = np.flatnonzero(self._known & ~OWN_SURFACE[users.type, surface])
        penalty[off] *= distance_off(road_map, users.type[off], users.x[off], users.y[off]) / JUST_OFF
        return penalty

    @cached_property
    def _on_path(self) -> tuple[Floats, Floats]:
        """Position (m along the path) and lateral offset (m to the left), (n,) each; needs routes."""
        context, learned = self.before.context, self.users
        assert context is not None
        along, aside, _ = on_path(context.route, learned.x[:, None], learned.y[:, None])
        return along[:, 0], aside[:, 0]

    @cached_property
    def _along(self) -> dict[str, Floats]:
        """The terms about the route; zeros without routes."""
        context, learned = self.before.context, self.users
        if context is None:
            return {name: np.zeros(len(learned)) for name in ("progress", "excess", "off_path", "red", "priority")}
        route, known = context.route, self._known
        # Count from the former projection, not from 0: a road user that stood inside a corner was penalised for a red
        # signal in each decision.
        before, (after, aside) = context.along, self._on_path
        covered = after - before
        wanted = self._allowed * DECISION_INTERVAL
        gives_way = known & np.isfinite(route.stop) & (route.signal == 0)
        return {
            "progress": rewards.progress(covered, wanted, known),
            "excess": rewards.excess(covered, wanted, known),
            "off_path": rewards.off_path(aside, known),
            "red": rewards.passed(before, after, route.line, known & route.stop_at_signal),
            "priority": rewards.passed(before, after, route.line, gives_way),
        }


RewardFunction = Callable[[Transition], NDArray[Any]]
"""A user's reward function: from a transition to one number for each of its n road users, (n,)."""


def lanes_here(users: WorldState, points: tuple[LanePoints, ...]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Heading (rad) and speed limit (m/s) of the nearest lane for the type of each of n road users, and whether the
    road user is on a lane with a direction, (n,) each.

    Pedestrians walk in both directions; junctions have no lanes here.
    """
    heading, limit = np.zeros(len(users)), np.full(len(users), np.inf)
    on_lane = np.zeros(len(users), np.bool_)
    for kind, source in enumerate(points):
        rows = np.flatnonzero(users.type == kind)
        if not len(rows) or not len(source):
            continue
        nearest, under = source.nearest_lanes(users.x[rows], users.y[rows])
        heading[rows] = source.heading[nearest]
        limit[rows] = source.max_speed(nearest)
        if kind != RoadUserType.PEDESTRIAN:
            on_lane[rows] = under
    return heading, limit, on_lane


def recorded_speed(bundle: ModelBundle) -> tuple[float, float, float]:
    """Mean speed (m/s) by type of moving road users in the recordings of the bundle.

    A road user moves if it covers more than 2.4 m in the 4.8 s of a window (0.5 m/s, the paper's r3).
    """
    types = bundle.training.get("types", {})
    recorded = [types.get(name, {}).get("moving_speed_mps") for name in TYPE_NAMES]
    if all(speed for speed, served in zip(recorded, bundle.types, strict=True) if served):
        car, bicycle, pedestrian = (speed or 0.0 for speed in recorded)  # 0 for types that the bundle lacks
        return car, bicycle, pedestrian
    # Older bundles lack this record: their modes are clusters of positions.
    distance = np.hypot(bundle.mode_centres[..., 0], bundle.mode_centres[..., 1])
    count = np.where(distance > MOVING_DISTANCE, bundle.mode_counts, 0)
    car, bicycle, pedestrian = (distance * count).sum(1) / np.maximum(count.sum(1), 1) / DESTINATION_HORIZON
    return float(car), float(bicycle), float(pedestrian)
