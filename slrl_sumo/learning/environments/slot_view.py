"""The data of a slot of a simulation for the views."""

from typing import Any

import numpy as np
from gymnasium import spaces

from slrl_sumo.learning.environments.observations import Seen, observation_space
from slrl_sumo.learning.environments.simulation_process import Reply
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.rewards.terms import TERMS
from slrl_sumo.scene.types import TYPE_NAMES

TOLD = ("reached", "clean")
"""Infos of trips that a view returns as bool."""


def view_space(source: ArenaSource) -> spaces.Space[Any]:
    """Space of the observation of one road user, without `active`, because a view always has a road user."""
    if source.observation is not None:
        return source.observation.space
    space = observation_space(source.settings)
    return spaces.Dict({name: part for name, part in space.items() if name != "active"})


def row_of(seen: Any, slot: int, space: spaces.Space[Any]) -> Seen:
    """The observation of one slot, in the form of its space."""
    if not isinstance(space, spaces.Dict):
        return np.asarray(seen[slot]).copy()
    return {name: np.asarray(seen[name][slot]).copy() for name in space}


def outcome_of(reply: Reply, slot: int, space: spaces.Space[Any]) -> tuple[Seen, float, bool, bool]:
    """Observation, reward, terminated and truncated of one slot after a decision.

    After the end of an episode, the observation is the last one of the episode.
    """
    assert reply.reward is not None
    assert reply.terminated is not None
    assert reply.truncated is not None
    terminated, truncated = bool(reply.terminated[slot]), bool(reply.truncated[slot])
    seen = row_of(reply.infos["final_obs"] if terminated or truncated else reply.seen, slot, space)
    return seen, float(reply.reward[slot]), terminated, truncated


def first_info(reply: Reply, slot: int) -> dict[str, Any]:
    """The info of a slot at the begin of an episode."""
    return {
        "id": reply.ids[slot],
        "slot": slot,
        "type": TYPE_NAMES[reply.type[slot]],
        "speed_mps": float(reply.speed[slot]),
        "action_mask": reply.masks[slot].copy(),
    }


def next_info(reply: Reply, slot: int, road_user: str) -> dict[str, Any]:
    """The info of a slot after a decision of the road user with this id, which may have left the slot."""
    infos = reply.infos
    return {
        "id": road_user,
        "slot": slot,
        "type": TYPE_NAMES[infos["type"][slot]],
        "speed_mps": float(infos["speed_mps"][slot]),
        "action_mask": reply.masks[slot].copy(),
        "terms": {name: float(infos[name][slot]) + 0.0 for name in TERMS if name in infos},
        **{name: bool(infos[name][slot]) for name in TOLD if name in infos},
    }
