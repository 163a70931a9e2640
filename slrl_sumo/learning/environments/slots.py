"""The learned road users of one simulation as slots: arrays with one row per slot."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.errors import SumoError
from slrl_sumo.learning.environments.arena import Arena
from slrl_sumo.learning.environments.observations import Arrays, Observer, action_mask
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.models.displacement import MODES

Stepped = tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]
"""Observation, reward, terminated, truncated and infos, as from gymnasium.vector.VectorEnv.step."""


class SpawnedSlots:
    """The slots of an Arena: each slot has a road user, which restarts elsewhere when its episode ends."""

    def __init__(self, arena: Arena, observer: Observer) -> None:
        self.arena, self._observe = arena, observer
        self.slots = np.arange(arena.settings.agents)
        """Slots of the road users of `situation`."""
        self.world = arena.world
        """All road users at the end of the last decision, before new episodes begin elsewhere."""

    @property
    def situation(self) -> Situation:
        """Situation of the road users for the next decision."""
        return self.arena.situation

    def look(self) -> tuple[Arrays, Arrays]:
        """The observation of all slots, and their `type` and `teacher_costs`."""
        kind = self.situation.observation.type
        return self._observe(self.situation), {"type": kind, "teacher_costs": self.arena.teacher_costs()}

    def step(self, modes: NDArray[np.int64]) -> Stepped:
        """One decision, `modes` (n,)."""
        outcome = self.arena.step(modes)
        self.world = outcome.world
        seen, infos = self.look()
        ended = outcome.terminated | outcome.truncated
        told = infos | outcome.terms
        told |= {"speed_mps": outcome.speed, "steps": outcome.steps, "replaced": np.zeros(len(ended), np.bool_)}
        final = {} if outcome.final is None else self._observe(outcome.final)
        return (
            seen,
            outcome.reward,
            outcome.terminated,
            outcome.truncated,
            told | _final(seen, final, ended),
        )


class TripSlots:
    """The slots of a TripArena: a road user has a slot during its trip, and slots may be empty."""

    def __init__(self, arena: TripArena, observer: Observer) -> None:
        self.arena, self._observe = arena, observer
        self.world = arena.simulation.world
        self._last: tuple[Arrays, Arrays] | None = None

    @property
    def situation(self) -> Situation | None:
        """Situation of the road users for the next decision; None without road users."""
        return self.arena.situation

    @property
    def slots(self) -> NDArray[np.intp]:
        """Slots of the road users of `situation`."""
        return self.arena.slots

    def look(self) -> tuple[Arrays, Arrays]:
        """Like SpawnedSlots.look; zeros for slots without a road user.

        Raises SumoError where the scenario has no road user that can be learned.
        """
        arena, situation = self.arena, self.situation
        if situation is not None:
            rows: Arrays = {"type": situation.observation.type, "teacher_costs": arena.teacher_costs()}
            infos = {name: self._spread(values, self.slots) for name, values in rows.items()}
            seen = {name: self._spread(values, self.slots) for name, values in self._observe(situation).items()}
        elif self._last is not None:
            seen, infos = ({name: np.zeros_like(values) for name, values in part.items()} for part in self._last)
        else:
            raise SumoError("the scenario has no road users that can be learned; train in another one")
        if self._observe.tells_active:
            active = seen["active"] = np.zeros(arena.settings.agents, np.int8)
            active[self.slots] = 1
            seen["action_mask"][active == 0] = 1
        self._last = seen, infos
        return seen, infos

    def step(self, modes: NDArray[np.int64]) -> Stepped:
        """Like SpawnedSlots.step; the last observation of an episode is from before the road user left."""
        assert self._last is not None
        before, _ = self._last
        outcome = self.arena.step(modes[self.slots])
        self.world = outcome.world
        by_row: Mapping[str, NDArray[Any]] = {
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
        reward, terminated, truncated = (every.pop(name) for name in ("reward", "terminated", "truncated"))
        ended = terminated | truncated
        every |= _final(before, {name: values[ended] for name, values in before.items()}, ended)
        every["replaced"] = np.zeros(len(ended), np.bool_)
        seen, infos = self.look()
        return seen, reward, terminated, truncated, infos | every

    def _spread(self, values: NDArray[Any], slots: NDArray[np.intp]) -> NDArray[Any]:
        """Values of the road users in `slots` as an array of all slots."""
        every = np.zeros((self.arena.settings.agents, *values.shape[1:]), values.dtype)
        every[slots] = values
        return every


def all_masks(slots: SpawnedSlots | TripSlots) -> NDArray[np.int8]:
    """1 for allowed modes of each slot, else 0, (n, modes); all modes in slots without a road user."""
    masks = np.ones((slots.arena.settings.agents, MODES), np.int8)
    if slots.situation is not None:
        masks[slots.slots] = action_mask(slots.situation)
    return masks


def _final(seen: Arrays, final: Arrays, ended: NDArray[np.bool_]) -> dict[str, Any]:
    """The last observations of the episodes that `ended` (n,), from their rows in `final`, as infos of gymnasium."""
    every = {name: np.zeros_like(values) for name, values in seen.items()}
    for name, values in final.items():
        every[name][ended] = values
    return {"final_obs": every, "_final_obs": ended}
