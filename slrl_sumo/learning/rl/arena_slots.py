"""The learned road users of one simulation as slots, in arrays as a vector environment gives them."""

import resource
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.learning.rl.arena import Arena, ArenaSettings, Outcome
from slrl_sumo.learning.rl.rewards import TERMS
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.observation import Observation
from slrl_sumo.sumo.scenario import find_scenario

Arrays = dict[str, NDArray[Any]]
Stepped = tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

OBSERVED = ("vector", "image", "ahead", "route")
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
        self._source = source
        self._bundle: ModelBundle | None = None
        self._open = ExitStack()
        self._arena: Arena | None = None

    def reset(self, draw: tuple[int, ...]) -> Arrays:
        """Open a scenario, drawn by the numbers in `draw`. Returns the observation, `type` and `guidance`."""
        self._arena = None
        self._open.close()
        self._bundle = self._bundle or load_bundle(self._source.bundle)
        drawn = np.random.default_rng(draw)
        scenario = find_scenario(self._source.scenarios[int(drawn.integers(len(self._source.scenarios)))])
        arena = Arena(scenario, self._bundle, self._source.settings, int(drawn.integers(2**31)))
        self._arena = self._open.enter_context(arena)
        return _seen(arena.observation) | {"guidance": arena.guidance()}

    def flat_step(self, modes: NDArray[np.int64]) -> Arrays:
        """One decision as arrays of n rows; those named final_ have rows of the ended episodes only."""
        assert self._arena is not None
        return _flat(self._arena.step(modes)) | {"guidance": self._arena.guidance()}

    def step(self, actions: NDArray[np.int64]) -> Stepped:
        """One decision, as gymnasium.vector.VectorEnv gives it."""
        return stepped(self.flat_step(actions))


def stepped(every: Arrays) -> Stepped:
    """What ArenaSlots.flat_step gives, of one or several simulations, as gymnasium.vector.VectorEnv gives it."""
    infos: dict[str, Any] = {
        name: every[name] for name in (*TERMS, "speed_mps", "type", "steps", "replaced", "guidance")
    }
    observation = {name: every[name] for name in OBSERVED if name in every}
    ended = infos["_final_obs"] = every["terminated"] | every["truncated"]
    infos["final_obs"] = {name: np.zeros_like(values) for name, values in observation.items()}
    for name, values in infos["final_obs"].items():
        values[ended] = every[f"final_{name}"]
    return observation, every["reward"], every["terminated"], every["truncated"], infos


def peak_memory() -> float:
    """Greatest resident memory of this process so far, MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0 if sys.platform != "darwin" else 1024.0**2)


def _seen(observation: Observation) -> Arrays:
    assert observation.image is not None
    assert observation.ahead is not None
    seen: Arrays = {"vector": observation.vector, "image": observation.image, "ahead": observation.ahead}
    if observation.route is not None:
        seen["route"] = observation.route
    return seen | {"type": observation.type}


def _flat(outcome: Outcome) -> Arrays:
    """An outcome as arrays of n rows; the final observations are those of the ended episodes only."""
    reply = _seen(outcome.observation)
    seen = [name for name in reply if name != "type"]
    ended = outcome.terminated | outcome.truncated
    reply |= {"reward": outcome.reward, "terminated": outcome.terminated, "truncated": outcome.truncated}
    reply |= {"speed_mps": outcome.speed, "steps": outcome.steps, **outcome.terms}
    reply |= {"replaced": np.zeros(len(ended), np.bool_)}
    for name in seen:
        reply[f"final_{name}"] = reply[name][:0] if outcome.final is None else getattr(outcome.final, name)
    return reply
