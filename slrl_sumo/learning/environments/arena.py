"""A running simulation as an environment: each learned road user is a slot with its own episodes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Agent, Situation, consider
from slrl_sumo.agent.mode_cost import CostWeights
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.agent.selection import GivenModes
from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.learning.environments.teacher import teacher_costs
from slrl_sumo.learning.own_functions import called
from slrl_sumo.learning.rewards.fault import at_fault
from slrl_sumo.learning.rewards.terms import RewardWeights, weighted
from slrl_sumo.learning.rewards.transition import RewardContext, RewardFunction, Transition, recorded_speed
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.contacts import contact_pairs, ids_of
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.placement.spawn import type_counts
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.session import SumoSession

EPISODE_STEPS = 128
"""Decisions of an episode (paper, section 4.1)."""

STANDING_STARTS = 0.25
"""Share of episodes with routes that begin at a stand."""


@dataclass(frozen=True)
class ArenaSettings:
    """Settings of an arena, in addition to the scenario and the models."""

    agents: int = 64
    mix: tuple[float, float, float] | None = None
    """Shares of cars, bicycles and pedestrians; None: the default mix, as far as the network has room for it."""
    weights: RewardWeights = field(default_factory=RewardWeights)
    desired_speed: tuple[float, float, float] | None = None
    """Desired speed by type, m/s; None: the mean speed of moving road users in the bundle's recordings."""
    episode_steps: int = EPISODE_STEPS
    warm_up: float = 60.0
    """Duration (s) of plain SUMO traffic before learned road users are added."""
    teacher: CostWeights | None = None
    """Weights of the teacher's costs of modes; None: no teacher. For training only."""
    preset: str = "paper"
    """Preset of the observations, one of perception.presets.PRESETS, which decides on routes."""
    image: bool = True
    """Whether images are drawn."""
    state: str = "paper"
    """The vector (`features.STATES`) that the bundle's models and the preset need (`presets.vector_for`)."""
    takeover: tuple[float, float, float] | None = None
    """With trips: shares of cars, bicycles and pedestrians that are learned; None: all types with models."""
    trips: bool = False
    """Whether the scenario's road users are learned, at most `agents` at a time, from departure to destination
    (TripArena); otherwise `agents` spawned road users that restart elsewhere when their episodes end."""
    staggered: bool = False
    """Whether first episodes are shortened at random, so that the episodes of all slots end at different steps."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a decision; arrays have one entry per slot, (n,)."""

    situation: Situation
    """Situation of all slots for the next decision; after the end of an episode, the start of the next one."""
    reward: Floats
    terms: dict[str, Floats]
    """The terms of the reward before weighting, by name."""
    terminated: NDArray[np.bool_]
    """Whether the episode ended by a contact through own fault, or by loss: off the ground, or removed by SUMO."""
    truncated: NDArray[np.bool_]
    """Whether the episode's time is over."""
    final: Situation | None
    """Last situation of the episodes that have ended, in the order of their slots; None if no episode has ended."""
    world: WorldState
    """All road users at the end of the decision, before new episodes begin elsewhere."""
    steps: NDArray[np.int64]
    """Number of decisions of the episode, before a new one began."""
    speed: Floats
    """Speed (m/s) at the end of the decision."""


class OpenedSimulation(ABC):
    """A simulation that is open inside a `with` block, set up by `_start`. SUMO allows one per process.

    `reward`: replaces the weighted sum of the terms. `image`: whether images are drawn; None: as in `settings`.
    `exclude`: ids of road users that are neither taken over nor held for learned road users.
    """

    def __init__(
        self,
        scenario: Scenario,
        bundle: ModelBundle,
        settings: ArenaSettings,
        seed: int,
        *,
        reward: RewardFunction | None = None,
        image: bool | None = None,
        exclude: tuple[str, ...] = (),
    ) -> None:
        self.bundle, self.settings = bundle, settings
        self._modes = GivenModes(settings.preset)
        self._modes.needs_image = settings.image if image is None else image
        self._own_reward, self._exclude = reward, exclude
        self._session = SumoSession(scenario, seed=seed % 2**31)
        self._scenario, self._seed = scenario, seed

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

    @abstractmethod
    def _start(self) -> None: ...

    def reward(self, transition: Transition, terms: dict[str, Floats]) -> Floats:
        """The reward of each road user of a transition with these terms, (n,)."""
        if self._own_reward is None:
            return weighted(terms, self.settings.weights)
        returned = called("reward", self._own_reward, transition)
        try:
            reward = np.asarray(returned, np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"it returned no numbers ({error}); return one per road user", argument="reward") from None
        if reward.shape != (n := len(transition.modes),):
            raise InputError(
                f"it returned an array of shape {reward.shape}; return one number per road user, ({n},)",
                argument="reward",
            )
        if len(odd := np.flatnonzero(~np.isfinite(reward))):
            raise InputError(
                f"it returned {reward[odd[0]]} for {transition.world.ids[odd[0]]}; return finite numbers",
                argument="reward",
            )
        return reward

    @property
    def seconds_left(self) -> float:
        """Time (s) until the scenario ends; infinite without an end."""
        end = self._scenario.seconds("end")
        return np.inf if end is None else end - self._session.time


class Arena(OpenedSimulation):
    """A scenario with learned road users with externally given modes; a context manager.

    Road users restart at a new place when their episode ends, so that all slots are always in use; the scene is a torus
    (paper, section 3.4).
    """

    def _start(self) -> None:
        self._random = np.random.default_rng([self._seed, 1])
        while self._session.time < self.settings.warm_up:
            self._session.step()
        routes = Routes(self._session.api, self._session.network) if PRESETS[self.settings.preset].knows_route else None
        self.driver = ModelDriver(Agent(self.bundle, self._modes), routes)
        self.simulation = CoSimulation(self._session, self.driver, exclude=self._exclude)
        desired = np.array(self.settings.desired_speed or recorded_speed(self.bundle))
        self._ground = RewardContext(self.simulation.points, desired, self.bundle, self.driver.agent.capability)
        mix = None if self.settings.mix is None else np.array(self.settings.mix)
        counts, _ = type_counts(
            self.settings.agents, mix, self.simulation.points, str(self._scenario.config), self.bundle
        )
        self.simulation.spawn(counts, self.bundle.max_speed, self._seed)
        self.simulation.start()
        n = len(self.simulation.population.world)
        self._steps = np.zeros(n, np.int64)
        self._limit = np.full(n, self.settings.episode_steps)
        if self.settings.staggered:
            self._limit = self._random.integers(1, self.settings.episode_steps + 1, n)
        # Contacts at the start are not caused by driving.
        self._touching = touching(self.simulation.world)
        self._row = {road_user: row for row, road_user in enumerate(self.simulation.population.world.ids)}
        self._was_off = np.zeros(n, np.bool_)
        self._stop_some(np.arange(n))
        self.consider()

    def _stop_some(self, rows: NDArray[np.intp]) -> None:
        """Let some new episodes begin at a stand: road users with a route must learn to start."""
        if not PRESETS[self.settings.preset].knows_route:
            return
        learned = self.simulation.population.world
        speed = learned.speed.copy()
        speed[rows[self._random.random(len(rows)) < STANDING_STARTS]] = 0.0
        background = self.simulation.world.take(np.arange(len(learned), len(self.simulation.world)))
        self.simulation.population.world = replace(learned, speed=speed)
        self.simulation.world = self.simulation.population.world.join(background)

    def consider(self) -> None:
        """Compute the situation of all slots again."""
        simulation = self.simulation
        self.situation = self.driver.consider(simulation.world, len(simulation.population.world), simulation.road_map)

    def _last_look(self, rows: NDArray[np.intp]) -> Situation:
        """The situation of the slots `rows` at the end of their episodes."""
        simulation = self.simulation
        n = len(simulation.population.world)
        scene = self.driver.scene(simulation.world, n, simulation.road_map, rows)
        return consider(scene, self.driver.agent, last_look=True)

    def teacher_costs(self) -> NDArray[np.float32]:
        """Cost of each mode of each slot now, (n, modes), not negative; zeros without a teacher."""
        return teacher_costs(self.situation, self.settings.teacher, self._ground)

    @property
    def world(self) -> WorldState:
        """All road users now, those of the slots first."""
        return self.simulation.world

    def step(self, modes: NDArray[np.int64]) -> Outcome:
        """Run one decision with `modes` (n,) in 0..modes-1, chosen from the last situation."""
        before, begin = self.situation, self.simulation.world
        self._modes.modes = modes
        decision = self.simulation.decide()
        n = len(modes)
        self._steps += 1
        in_contact = touching(self.simulation.world)
        hit = np.zeros(n, np.bool_)
        blamed = at_fault(in_contact - self._touching, begin, self.simulation.world)
        hit[[self._row[user] for user in blamed if user in self._row]] = True
        learned = self.simulation.population.world
        lost = decision.lost | (decision.wrapped_around & self._was_off)
        transition = Transition(self._ground, before, modes, self.simulation.world, decision, hit, lost)
        terms = transition.terms()
        reward = self.reward(transition, terms)
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
            in_contact = touching(self.simulation.world)
        self.consider()
        self._touching = in_contact
        return Outcome(self.situation, reward, terms, terminated, truncated, final, world, steps, speed)


def touching(world: WorldState) -> set[tuple[str, str]]:
    """Pairs of road users in contact: boxes that overlap, or centres closer than 0.5 m."""
    return ids_of(np.concatenate(contact_pairs(world)), world)
