"""The learned road users of one simulation as slots: arrays of one row per slot."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.errors import SumoError
from slrl_sumo.learning.environments.arena import Arena, Outcome
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.models.policy import PolicyConfig

Arrays = dict[str, NDArray[Any]]

OBSERVED = ("vector", "image", "rollouts", "action_mask", "route", "active")
"""Arrays that an observation may have. `active`: which slots have a road user; all of them where it is missing."""


class SpawnedSlots:
    """The slots of an Arena, whose road users come back elsewhere when their episodes end: every slot has one."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._features = _features(arena.settings.extended)

    def look(self) -> Arrays:
        """The observation of all slots, `type` and `teacher_costs`."""
        arena = self._arena
        seen = _seen(arena.situation, self._features)
        return seen | {"type": arena.situation.observation.type, "teacher_costs": arena.teacher_costs()}

    def step(self, modes: NDArray[np.int64]) -> Arrays:
        """One decision, `modes` (n,); arrays whose names begin with final_ have rows of the ended episodes only."""
        return _flat(self._arena.step(modes), self._features) | {"teacher_costs": self._arena.teacher_costs()}


class TripSlots:
    """The slots of a TripArena: road users have them for their trips, and some slots have none."""

    def __init__(self, arena: TripArena) -> None:
        self._arena = arena
        self._features = _features(True)
        self._last: Arrays = {}

    def look(self) -> Arrays:
        """The observation of all slots, `type` and `teacher_costs`; zeros where a slot has no road user.

        Raises SumoError where the scenario has no road user that can be learned.
        """
        arena = self._arena
        slots, active = arena.slots, np.zeros(arena.settings.agents, np.bool_)
        active[slots] = True
        if arena.situation is not None:
            rows = _seen(arena.situation, self._features) | {"type": arena.situation.observation.type}
            rows["teacher_costs"] = arena.teacher_costs()
            self._last = {name: self._spread(values, slots) for name, values in rows.items()} | {
                "active": active.astype(np.int8)
            }
        elif self._last:
            self._last = {name: np.zeros_like(values) for name, values in self._last.items()}
        else:
            raise SumoError("the scenario has no road users that can be learned; train in another one")
        self._last["action_mask"][~active] = 1
        return self._last

    def step(self, modes: NDArray[np.int64]) -> Arrays:
        """As SpawnedSlots.step; the last observation of an episode is the one before the road user left."""
        arena, before = self._arena, self._last
        outcome = arena.step(modes[arena.slots])
        by_row: Arrays = {
            "type": outcome.type,
            "reward": outcome.reward,
            "terminated": outcome.terminated,
            "truncated": outcome.truncated,
            "gone": outcome.gone,
            "reached": outcome.reached,
            "clean": outcome.clean,
            "speed_mps": outcome.speed,
            "steps": outcome.steps,
            **outcome.terms,
        }
        every = {name: self._spread(values, outcome.slots) for name, values in by_row.items()}
        ended = every["terminated"] | every["truncated"]
        every |= {f"final_{name}": before[name][ended] for name in OBSERVED if name in before}
        every["replaced"] = np.zeros(len(ended), np.bool_)
        return self.look() | every

    def _spread(self, values: NDArray[Any], slots: NDArray[np.intp]) -> NDArray[Any]:
        """Values of the road users in `slots` as an array of all slots."""
        every = np.zeros((self._arena.settings.agents, *values.shape[1:]), values.dtype)
        every[slots] = values
        return every


def _features(extended: bool) -> tuple[str, ...]:
    """Columns of the mode rollouts in an observation."""
    return PolicyConfig(preset="extended" if extended else "paper").rollout_features


def action_mask(situation: Situation) -> NDArray[np.int8]:
    """1 for the modes that each road user may choose, else 0, (n, modes)."""
    assert situation.rollouts is not None
    mask = situation.mask
    return np.ones(situation.rollouts.collision.shape, np.int8) if mask is None else mask.astype(np.int8)


def _seen(situation: Situation, features: tuple[str, ...]) -> Arrays:
    """A situation as arrays of n rows; `features`: columns of the rollouts."""
    observation, rollouts = situation.observation, situation.rollouts
    assert rollouts is not None
    seen: Arrays = {"vector": observation.vector, "rollouts": rollouts.columns(features)}
    if observation.image is not None:
        seen["image"] = observation.image
    if observation.route is not None:
        seen["route"] = observation.route
    return seen | {"action_mask": action_mask(situation)}


def _flat(outcome: Outcome, features: tuple[str, ...]) -> Arrays:
    """An outcome as arrays of n rows; the final observations are those of the ended episodes only."""
    seen = _seen(outcome.situation, features)
    final = None if outcome.final is None else _seen(outcome.final, features)
    ended = outcome.terminated | outcome.truncated
    return seen | {
        "type": outcome.situation.observation.type,
        "reward": outcome.reward,
        "terminated": outcome.terminated,
        "truncated": outcome.truncated,
        "speed_mps": outcome.speed,
        "steps": outcome.steps,
        "replaced": np.zeros(len(ended), np.bool_),
        **outcome.terms,
        **{f"final_{name}": values[:0] if final is None else final[name] for name, values in seen.items()},
    }
