"""A running simulation as an environment: the scenario's road users are learned during their whole trips."""

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
"""Number of decisions (2 min) for which an empty network waits for a first road user."""


@dataclass(frozen=True)
class TripOutcome:
    """The outcome of a decision of n road users, (n,) each."""

    slots: NDArray[np.intp]
    """Slots of the road users."""
    type: NDArray[np.int8]
    reward: Floats
    terms: dict[str, Floats]
    """The terms of the reward with a weight, before weighting, by name."""
    terminated: NDArray[np.bool_]
    """At the destination, in a new contact by own fault, or permanently off the route or the ground."""
    truncated: NDArray[np.bool_]
    """Handed back to SUMO for another reason."""
    gone: NDArray[np.bool_]
    """Handed back to SUMO, truncated or terminated."""
    reached: NDArray[np.bool_]
    """At the destination."""
    contact: NDArray[np.bool_]
    """In a new contact with a road user that was present before, regardless of the fault."""
    clean: NDArray[np.bool_]
    """Reached the destination without contact and without leaving the own surfaces on the whole trip."""
    steps: NDArray[np.int64]
    """Number of decisions of the current episode so far."""
    speed: Floats
    """Speed (m/s) at the end of the decision."""
    world: WorldState
    """All road users at the end of the decision, the n deciding road users first."""


class TripArena(OpenedSimulation):
    """A scenario with learned road users of its own demand, at most `settings.agents` at a time; a context manager.

    A road user has a slot from its takeover until its hand-back, near its destination or earlier, as in a run. It is
    not moved elsewhere before: it must drive out of a jam. A contact by own fault ends an episode, and the next episode
    of the same road user begins at its position.
    """

    def _start(self) -> None:
        self._wanted = weighted_terms(self.settings.weights)
        # The warm-up is random, from empty streets to those of a rush hour.
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
        """Assign slots to new road users, and compute the situation of all learned road users."""
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
        """Run one decision with `modes` (n,) in 0..modes-1 for the road users in `slots`, in this order."""
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
        # SUMO inserts persons without a check for other road users.
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
        # An arrival terminates: a value for the time after it would be learned only from itself, and diverge.
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
    """Whether each of n road users is in `some`, (n,)."""
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
