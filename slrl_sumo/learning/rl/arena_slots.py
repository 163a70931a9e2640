"""The learned road users of one simulation as slots, in arrays as a vector environment gives them."""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.learning.rl.arena import Arena, ArenaSettings, Outcome
from slrl_sumo.learning.rl.rewards import TERMS
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.policy import PolicyConfig
from slrl_sumo.sumo.scenario import find_scenario

Arrays = dict[str, NDArray[Any]]
Stepped = tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

OBSERVED = ("vector", "image", "rollouts", "action_mask", "route")
"""Arrays that an observation may have."""


@dataclass(frozen=True)
class ArenaSource:
    """Where a worker finds what it plays: scenarios (as `slrl-sumo run` names them) and a bundle (name or folder)."""

    scenarios: tuple[str, ...]
    bundle: str
    settings: ArenaSettings


class ArenaSlots:
    """One simulation after the other, each of which has n slots; only one of these may be in a process.

    Raises InputError where something cannot be loaded, SumoError where SUMO gives up.
    """

    def __init__(self, source: ArenaSource) -> None:
        self.num_envs = source.settings.agents
        preset = "extended" if source.settings.extended else "paper"
        self._features = PolicyConfig(preset=preset).rollout_features
        self._source = source
        self._bundle: ModelBundle | None = None
        self._open = ExitStack()
        self._arena: Arena | None = None

    def reset(self, draw: tuple[int, ...]) -> Arrays:
        """Open a scenario, drawn by the numbers in `draw`. Returns the observation, `type` and `teacher_costs`."""
        self._arena = None
        self._open.close()
        self._bundle = self._bundle or load_bundle(self._source.bundle)
        drawn = np.random.default_rng(draw)
        scenario = find_scenario(self._source.scenarios[int(drawn.integers(len(self._source.scenarios)))])
        arena = Arena(scenario, self._bundle, self._source.settings, int(drawn.integers(2**31)))
        self._arena = self._open.enter_context(arena)
        seen = _seen(arena.situation, self._features)
        return seen | {"type": arena.situation.observation.type, "teacher_costs": arena.teacher_costs()}

    def flat_step(self, modes: NDArray[np.int64]) -> Arrays:
        """One decision as arrays of n rows; those named final_ have rows of the ended episodes only."""
        assert self._arena is not None
        return _flat(self._arena.step(modes), self._features) | {"teacher_costs": self._arena.teacher_costs()}

    def step(self, actions: NDArray[np.int64]) -> Stepped:
        """One decision, as gymnasium.vector.VectorEnv gives it."""
        return stepped(self.flat_step(actions))


def stepped(every: Arrays) -> Stepped:
    """What ArenaSlots.flat_step gives, of one or several simulations, as gymnasium.vector.VectorEnv gives it."""
    infos: dict[str, Any] = {
        name: every[name] for name in (*TERMS, "speed_mps", "type", "steps", "replaced", "teacher_costs")
    }
    observation = {name: every[name] for name in OBSERVED if name in every}
    ended = infos["_final_obs"] = every["terminated"] | every["truncated"]
    infos["final_obs"] = {name: np.zeros_like(values) for name, values in observation.items()}
    for name, values in infos["final_obs"].items():
        values[ended] = every[f"final_{name}"]
    return observation, every["reward"], every["terminated"], every["truncated"], infos


def action_mask(situation: Situation) -> NDArray[np.int8]:
    """1 for the modes that each road user may choose, else 0, (n, modes)."""
    assert situation.rollouts is not None
    mask = situation.mask
    return np.ones(situation.rollouts.collision.shape, np.int8) if mask is None else mask.astype(np.int8)


def _seen(situation: Situation, features: tuple[str, ...]) -> Arrays:
    """A situation as arrays of n rows; `features`: columns of the rollouts."""
    observation, rollouts = situation.observation, situation.rollouts
    assert observation.image is not None
    assert rollouts is not None
    seen: Arrays = {"vector": observation.vector, "image": observation.image, "rollouts": rollouts.columns(features)}
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
