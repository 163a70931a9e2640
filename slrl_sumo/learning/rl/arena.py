"""One running simulation as an environment: each learned road user is a slot with episodes of its own."""

from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Agent, Situation, consider
from slrl_sumo.agent.driver import ModelDriver
from slrl_sumo.agent.mode_cost import CostWeights, cost_on_route, cost_without_route
from slrl_sumo.agent.selectors import GivenModes
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.learning.rl import rewards
from slrl_sumo.learning.rl.rewards import RewardWeights
from slrl_sumo.lookahead.route_fit import allowed_speed
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.ego_image import ego_picture
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.scene import Scene
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.contacts import contact_pairs, ids_of
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.spawn import type_counts
from slrl_sumo.sumo.lanes import LanePoints
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.session import SumoSession

EPISODE_STEPS = 128
"""Decisions of an episode (paper, section 4.1)."""

HORIZON = 4.8
"""s from a window's moment to its destination (paper, section 3.2)."""
STANDING_STARTS = 0.25
"""Share of episodes in the preset `extended` that begin at a stand."""
MOVING_DISTANCE = rewards.SLOW * HORIZON


@dataclass(frozen=True)
class ArenaSettings:
    """What happens in the arena, besides the scenario and the models."""

    agents: int = 64
    mix: tuple[float, float, float] | None = None
    """Shares of cars, bicycles and pedestrians; None is the usual mix, as far as the network has room for it."""
    weights: RewardWeights = field(default_factory=RewardWeights)
    desired_speed: tuple[float, float, float] | None = None
    """m/s per type; None is the mean of what the bundle's recordings show of road users in motion."""
    episode_steps: int = EPISODE_STEPS
    warm_up: float = 60.0
    """s of plain SUMO before learned road users are added, so that there is traffic."""
    teacher: CostWeights | None = None
    """Weights of the teacher's costs of modes; None: no teacher. For training only."""
    extended: bool = False
    """Whether road users have routes and see them (preset `extended`)."""
    staggered: bool = False
    """Whether first episodes are cut short at random, so that not all slots end theirs at the same step."""


@dataclass(frozen=True)
class Outcome:
    """What one decision led to; all arrays have one entry per slot, (n,)."""

    situation: Situation
    """What all slots decide from next; where an episode has ended, the start of the next one."""
    reward: Floats
    terms: dict[str, Floats]
    """The terms of the reward before weighting, by name."""
    terminated: NDArray[np.bool_]
    """In contact with a road user, or lost: off the ground, or away from SUMO."""
    truncated: NDArray[np.bool_]
    """The episode's time is over."""
    final: Situation | None
    """The last look of the episodes that have ended, in the order of their slots; None where none has."""
    world: WorldState
    """All road users at the end of the decision, before new episodes begin elsewhere."""
    steps: NDArray[np.int64]
    """Decisions of the current episode so far, before a new one began."""
    speed: Floats
    """m/s at the end of the decision."""


class Arena:
    """A scenario with learned road users whose modes are given from outside; a context manager.

    Road users come back at a new place when their episode ends, so the slots are always filled; the scene loops on
    itself (paper, section 3.4). One arena per process: SUMO allows no more.
    """

    def __init__(self, scenario: Scenario, bundle: ModelBundle, settings: ArenaSettings, seed: int) -> None:
        self.bundle, self.settings = bundle, settings
        self._session = SumoSession(scenario, seed=seed % 2**31)
        self._scenario, self._seed = scenario, seed
        self._random = np.random.default_rng([seed, 1])
        self._modes = GivenModes("extended" if settings.extended else "paper")
        self._desired = np.array(settings.desired_speed or recorded_speed(bundle))

    def __enter__(self) -> Self:
        self._session.__enter__()
        try:
            self._start()
        except BaseException:
            self._session.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.__exit__(kind, error, trace)

    def _start(self) -> None:
        while self._session.time < self.settings.warm_up:
            self._session.step()
        routes = Routes(self._session.api, self._session.network) if self.settings.extended else None
        self.driver = ModelDriver(Agent(self.bundle, self._modes), routes)
        self.simulation = CoSimulation(self._session, self.driver)
        self._points = self.simulation.points
        mix = None if self.settings.mix is None else np.array(self.settings.mix)
        counts, _ = type_counts(self.settings.agents, mix, self._points, str(self._scenario.config), self.bundle)
        self.simulation.spawn(counts, self.bundle.max_speed, self._seed)
        self.simulation.start()
        n = len(self.simulation.population.world)
        self._steps = np.zeros(n, np.int64)
        self._limit = np.full(n, self.settings.episode_steps)
        if self.settings.staggered:
            self._limit = self._random.integers(1, self.settings.episode_steps + 1, n)
        # Road users that start in contact with each other have not collided by driving.
        self._touching = _touching(self.simulation.world)
        self._row = {road_user: row for row, road_user in enumerate(self.simulation.population.world.ids)}
        self._was_off = np.zeros(n, np.bool_)
        self._stop_some(np.arange(n))
        self.consider()

    def _stop_some(self, rows: NDArray[np.intp]) -> None:
        """Let some new episodes begin at a stand: road users with a route wait, and must start again."""
        if not self.settings.extended:
            return
        learned = self.simulation.population.world
        speed = learned.speed.copy()
        speed[rows[self._random.random(len(rows)) < STANDING_STARTS]] = 0.0
        background = self.simulation.world.take(np.arange(len(learned), len(self.simulation.world)))
        self.simulation.population.world = replace(learned, speed=speed)
        self.simulation.world = self.simulation.population.world.join(background)

    def consider(self) -> None:
        """Look anew at what all slots decide from."""
        simulation = self.simulation
        self.situation = self.driver.consider(simulation.world, len(simulation.population.world), simulation.road_map)

    def _last_look(self, rows: NDArray[np.intp]) -> Situation:
        """What the slots `rows` see at the end of their episodes."""
        simulation = self.simulation
        n = len(simulation.population.world)
        scene = self.driver.scene(simulation.world, n, simulation.road_map, rows)
        return consider(scene, self.driver.agent, last_look=True)

    def teacher_costs(self) -> NDArray[np.float32]:
        """Cost of each mode of each slot now, (n, modes), not negative; zeros without a teacher."""
        weights, rollouts = self.settings.teacher, self.situation.rollouts
        learned = self.simulation.population.world
        if weights is None:
            return np.zeros((len(learned), self.bundle.config.modes), np.float32)
        assert rollouts is not None
        if self.settings.extended:
            return cost_on_route(rollouts, weights, learned.type, learned.speed).astype(np.float32)
        lane_heading, limit, on_lane = lanes_here(learned, self._points)
        desired = np.minimum(self._desired[learned.type], limit)
        turned = learned.heading - lane_heading
        return cost_without_route(rollouts, weights, desired, turned, on_lane).astype(np.float32)

    @property
    def world(self) -> WorldState:
        """All road users as they are now, those of the slots first."""
        return self.simulation.world

    def step(self, modes: NDArray[np.int64]) -> Outcome:
        """One decision: `modes` (n,) in 0..modes-1 for the road users as they were observed last."""
        before, log_probability = self.situation, self._log_prior(modes)
        self._modes.modes = modes
        decision = self.simulation.decide()
        n = len(modes)
        self._steps += 1
        touching = _touching(self.simulation.world)
        hit = np.zeros(n, np.bool_)
        hit[[self._row[user] for pair in touching - self._touching for user in pair if user in self._row]] = True
        learned = self.simulation.population.world
        lost = decision.lost | (decision.wrapped_around & self._was_off)
        terms = self._terms(before, decision, hit, lost, log_probability)
        self._was_off = ~OWN_SURFACE[learned.type, decision.surface]
        terminated = hit | lost
        truncated = (self._steps >= self._limit) & ~terminated
        ended = np.flatnonzero(terminated | truncated)
        steps, speed, world, final = self._steps.copy(), learned.speed, self.simulation.world, None
        if len(ended):
            final = self._last_look(ended)
            self.simulation.start_anew(ended, self.bundle.max_speed, self._random)
            self._stop_some(ended)
            self.driver.forget(tuple(learned.ids[row] for row in ended))
            self._steps[ended], self._limit[ended] = 0, self.settings.episode_steps
            self._was_off[ended] = False
            touching = _touching(self.simulation.world)
        self.consider()
        self._touching = touching
        reward = rewards.weighted(terms, self.settings.weights)
        return Outcome(self.situation, reward, terms, terminated, truncated, final, world, steps, speed)

    def _log_prior(self, modes: NDArray[np.int64]) -> Floats:
        """Log probability of each mode under the bundle's prior, (n,)."""
        with torch.inference_mode():
            every = torch.log_softmax(self.bundle.prior.logits(*tensors(self.situation.observation)), -1)
            return every.double().numpy()[np.arange(len(modes)), modes]

    def _terms(
        self,
        before: Situation,
        decision: Decision,
        hit: NDArray[np.bool_],
        lost: NDArray[np.bool_],
        log_probability: Floats,
    ) -> dict[str, Floats]:
        """All terms of the reward, (n,) each."""
        learned = self.simulation.population.world
        lane_heading, limit, on_lane = lanes_here(learned, self._points)
        desired = np.minimum(self._desired[learned.type], limit)
        n = len(learned)
        on_way = {name: np.zeros(n) for name in ("progress", "off_path", "red", "priority")}
        if before.context is not None:
            desired, on_way = self._on_way(before.scene, before.context, learned, decision)
        return {
            "close": rewards.close(self.simulation.world, len(learned)),
            "off_surface": rewards.off_surface(learned.type, decision.surface),
            "moving": rewards.moving(learned.speed),
            "alive": rewards.alive(len(learned)),
            "contact": rewards.contact(hit),
            "lost": rewards.lost(lost),
            "danger": rewards.danger(self.simulation.world, len(learned)),
            "speed": rewards.speed_kept(learned.speed, desired),
            "wrong_way": rewards.wrong_way(learned.heading, lane_heading, on_lane),
            "comfort": rewards.comfort(learned.speed, learned.acceleration, learned.yaw_rate),
            "realism": rewards.realism(log_probability),
            **on_way,
        }

    def _on_way(
        self, scene: Scene, before: RouteContext, learned: WorldState, decision: Decision
    ) -> tuple[Floats, dict[str, Floats]]:
        """The speeds (m/s) that were right for the routes as they were `before` the decision, in `scene`, and the terms
        about them, (n,) each."""
        route = before.route
        allowed = allowed_speed(before, self.driver.agent.capability, scene.world.take(scene.rows))
        covered, aside, _ = (c[:, 0] for c in on_path(route, learned.x[:, None], learned.y[:, None]))
        known = route.known & ~decision.wrapped_around
        gives_way = known & np.isfinite(route.stop) & (route.signal == 0)
        terms = {
            "progress": rewards.progress(covered, allowed * DECISION_INTERVAL, known),
            "off_path": rewards.off_path(aside, known),
            "red": rewards.passed(covered, route.line, known & route.closed),
            "priority": rewards.passed(covered, route.line, gives_way),
        }
        return np.where(known, allowed, learned.speed), terms

    def picture(self, slot: int) -> NDArray[np.uint8]:
        """The image of a slot, enlarged for display, (rows, cols, 3) RGB."""
        image = self.situation.observation.image
        assert image is not None
        return ego_picture(image[slot])


def lanes_here(users: WorldState, points: tuple[LanePoints, ...]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Heading (rad) and speed limit (m/s) of the nearest lane for the type of each of n road users, and whether it is
    on a lane with a direction, (n,) each. Pedestrians walk either way; junctions have no lanes here."""
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
    """m/s per type: the mean, over the recordings that the bundle was fitted to, of road users in motion.

    A road user is in motion if it comes farther than 2.4 m in the 4.8 s of a window (0.5 m/s, the paper's r3).
    """
    types = bundle.training.get("types", {})
    recorded = [types.get(name, {}).get("moving_speed_mps") for name in TYPE_NAMES]
    if all(speed for speed, served in zip(recorded, bundle.types, strict=True) if served):
        car, bicycle, pedestrian = (speed or 0.0 for speed in recorded)  # 0 for types that the bundle lacks
        return car, bicycle, pedestrian
    # Bundles that were fitted before this was written down: their modes are clusters of positions.
    distance = np.hypot(bundle.mode_centres[..., 0], bundle.mode_centres[..., 1])
    count = np.where(distance > MOVING_DISTANCE, bundle.mode_counts, 0)
    car, bicycle, pedestrian = (distance * count).sum(1) / np.maximum(count.sum(1), 1) / HORIZON
    return float(car), float(bicycle), float(pedestrian)


def _touching(world: WorldState) -> set[tuple[str, str]]:
    """Pairs of road users in contact: boxes that overlap, or centres closer than 0.5 m."""
    return ids_of(np.concatenate(contact_pairs(world)), world)
