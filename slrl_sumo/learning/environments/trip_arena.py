"""One running simulation as an environment: the scenario's own road users are learned for the whole of their trips."""

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Agent, Situation
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.learning.environments.arena import OpenedSimulation, touching
from slrl_sumo.learning.environments.teacher import teacher_costs
from slrl_sumo.learning.rewards.fault import at_fault
from slrl_sumo.learning.rewards.terms import weighted_terms
from slrl_sumo.learning.rewards.transition import RewardContext, Transition, recorded_speed
from slrl_sumo.routing.routes import Routes
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.takeover import Takeover

EMPTY = 300
"""Decisions (2 min) for which an empty network waits for a first road user."""


@dataclass(frozen=True)
class TripOutcome:
    """What one decision led to, for the n road users that took it, (n,) each."""

    slots: NDArray[np.intp]
    """Their slots."""
    type: NDArray[np.int8]
    reward: Floats
    terms: dict[str, Floats]
    """The terms of the reward with a weight, before weighting, by name."""
    terminated: NDArray[np.bool_]
    """At the destination, in contact with a road user anew by own fault, or off the route or the ground for good."""
    truncated: NDArray[np.bool_]
    """SUMO's again for another reason."""
    gone: NDArray[np.bool_]
    """SUMO's again, whether truncated or terminated."""
    reached: NDArray[np.bool_]
    """At the destination."""
    contact: NDArray[np.bool_]
    """In contact anew with a road user that was there before, by whose fault ever."""
    clean: NDArray[np.bool_]
    """Reached the destination, and on the whole trip without contact and never off the own surface."""
    steps: NDArray[np.int64]
    """Decisions of the current episode so far."""
    speed: Floats
    """m/s at the end of the decision."""
    world: WorldState
    """All road users at the end of the decision, first the n that took it."""


class TripArena(OpenedSimulation):
    """A scenario whose own road users are learned, at most `settings.agents` at a time; a context manager.

    A road user has a slot from its takeover until SUMO has it again: near its destination, or where a run hands it
    back. It is not put elsewhere before: out of a jam it must drive. A contact by own fault ends an episode, and the
    next one of the same road user begins where it is.
    """

    def _start(self) -> None:
        self._wanted = weighted_terms(self.settings.weights)
        # From empty streets to those of a rush hour.
        warm_up = np.random.default_rng([self._seed, 1]).uniform(0.0, 2.0 * self.settings.warm_up)
        while self._session.time < warm_up:
            self._session.step()
        api, network = self._session.api, self._session.network
        self.driver = ModelDriver(Agent(self.bundle, self._modes), Routes(api, network))
        everywhere = parse_region(None, network)
        shares = self.settings.takeover or self.bundle.types
        takeover = Takeover(np.array(shares, np.float64), everywhere, self._seed, self.settings.agents)
        self.simulation = CoSimulation(self._session, self.driver, takeover=takeover, exclude=self._exclude)
        desired = np.array(self.settings.desired_speed or recorded_speed(self.bundle))
        self._ground = RewardContext(self.simulation.points, desired, self.bundle, self.driver.agent.capability)
        self._slot: dict[str, int] = {}
        self._steps: dict[str, int] = {}
        self._unclean: set[str] = set()
        self.simulation.start()
        for _ in range(EMPTY):
            if len(self.simulation.population.world):
                break
            self.simulation.decide()
        self._touching = touching(self.simulation.world)
        self._look()

    def _look(self) -> None:
        """Give slots to new road users, and look at what all learned ones decide from next."""
        ids = self.simulation.population.world.ids
        gone = self._slot.keys() - set(ids)
        for road_user in gone:
            del self._slot[road_user], self._steps[road_user]
        self._unclean -= gone
        taken = set(self._slot.values())
        free = iter([slot for slot in range(self.settings.agents) if slot not in taken])
        for road_user in ids:
            if road_user not in self._slot:
                self._slot[road_user], self._steps[road_user] = next(free), 0
        self.slots = np.array([self._slot[road_user] for road_user in ids], np.intp)
        self.situation: Situation | None = None
        if ids:
            self.situation = self.driver.consider(self.simulation.world, len(ids), self.simulation.road_map)

    def teacher_costs(self) -> NDArray[np.float32]:
        """Cost of each mode of each learned road user now, (n, modes), not negative; zeros without a teacher."""
        if self.situation is None:
            return np.zeros((0, self.bundle.config.modes), np.float32)
        return teacher_costs(self.situation, self.settings.teacher, self._ground)

    def step(self, modes: NDArray[np.int64]) -> TripOutcome:
        """One decision: `modes` (n,) in 0..modes-1 for the road users in `slots`, in that order."""
        before, begin, slots, n = self.situation, self.simulation.world, self.slots, len(self.slots)
        self._modes.modes = modes
        ids = self.simulation.population.world.ids
        near_end = self.driver.near_end(ids)
        decision = self.simulation.decide()
        world = decision.steps[-1].world
        learned = world.take(np.arange(n))
        anew = touching(world) - self._touching
        self._touching = touching(self.simulation.world)
        if before is None:
            self._look()
            return _nothing(self._wanted, world)
        # SUMO inserts persons without a look at who is there.
        present = set(begin.ids)
        contact = _among(ids, {user for pair in anew if present.issuperset(pair) for user in pair})
        hit = _among(ids, at_fault(anew, begin, world))
        lost = decision.lost | _among(ids, set(decision.returned_to_route))
        gone = ~_among(ids, self.simulation.population.ids)
        reached = gone & ~lost & (near_end | _among(ids, set(decision.arrived)))
        transition = Transition(self._ground, before, modes, world, decision, hit, lost, reached)
        terms = transition.terms(self._wanted)
        for row in np.flatnonzero(contact | lost | decision.left_surface):
            self._unclean.add(ids[row])
        clean = reached & ~_among(ids, self._unclean)
        # The last value cannot stand for the time after an arrival: learned from itself alone, it diverges.
        terminated = hit | lost | reached
        for user in ids:
            self._steps[user] += 1
        steps = np.array([self._steps[user] for user in ids], np.int64)
        for row in np.flatnonzero(terminated):
            self._steps[ids[row]] = 0
        self._look()
        return TripOutcome(
            slots=slots,
            type=learned.type,
            reward=self.reward(transition, terms),
            terms=terms,
            terminated=terminated,
            truncated=gone & ~terminated,
            gone=gone,
            reached=reached,
            contact=contact,
            clean=clean,
            steps=steps,
            speed=learned.speed,
            world=world,
        )


def _among(ids: tuple[str, ...], some: Set[str]) -> NDArray[np.bool_]:
    """Which of n road users are among `some`, (n,)."""
    return np.array([user in some for user in ids], np.bool_)


def _nothing(wanted: tuple[str, ...], world: WorldState) -> TripOutcome:
    """An outcome without road users."""
    no, none = np.zeros(0, np.bool_), np.zeros(0)
    terms = dict.fromkeys(wanted, none)
    return TripOutcome(
        slots=np.zeros(0, np.intp),
        type=np.zeros(0, np.int8),
        reward=none,
        terms=terms,
        terminated=no,
        truncated=no,
        gone=no,
        reached=no,
        contact=no,
        clean=no,
        steps=np.zeros(0, np.int64),
        speed=none,
        world=world,
    )
