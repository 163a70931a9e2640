"""The learned road users of one simulation as a vector environment, in this process."""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.learning.environments.arena import Arena, ArenaSettings
from slrl_sumo.learning.environments.slots import OBSERVED, Arrays, SpawnedSlots, TripSlots
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.learning.rewards.terms import TERMS, weighted_terms
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import PolicyConfig
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.sumo.scenario import find_scenario

Stepped = tuple[Arrays, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

RESULT = ("reward", "terminated", "truncated")
ACTION_SPACE: spaces.Discrete = spaces.Discrete(MODES)


@dataclass(frozen=True)
class ArenaSource:
    """What is simulated: scenarios (as `slrl-sumo run` names them), a bundle (name or folder) and settings."""

    scenarios: tuple[str, ...]
    bundle: str
    settings: ArenaSettings


def observation_space(settings: ArenaSettings) -> spaces.Dict:
    """Observation of one road user: the fields of `Observation` of these names, and the modes' rollouts."""
    config = PolicyConfig(preset="extended" if settings.extended else "paper")
    seen: dict[str, spaces.Space[Any]] = {
        "vector": spaces.Box(-np.inf, np.inf, (len(FEATURES),), np.float32),
        "rollouts": spaces.Box(-np.inf, np.inf, (MODES, len(config.rollout_features)), np.float32),
        "action_mask": spaces.MultiBinary(MODES),
    }
    if settings.image:
        seen["image"] = spaces.Box(0, 255, (EGO_ROWS, EGO_COLS, 3), np.uint8)
    if config.route_columns:
        seen["route"] = spaces.Box(-np.inf, np.inf, (config.route_columns,), np.float32)
    if settings.trips:
        seen["active"] = spaces.Box(0, 1, (), np.int8)
    return spaces.Dict(seen)


def told_terms(settings: ArenaSettings) -> tuple[str, ...]:
    """The terms of the reward that `infos` has: with trips those with a weight, for speed."""
    return weighted_terms(settings.weights) if settings.trips else TERMS


def drawn_seed(*numbers: int) -> int:
    """A seed drawn by some numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0] >> 1)


class SimulationVectorEnv(VectorEnv):
    """One simulation; every slot for a learned road user is a sub-environment. Training steps this.

    Observations are dicts of arrays `vector` (n, 12) float32, `image` (n, 20, 40, 3) uint8 and `rollouts` (n, 20, 4)
    float32, the rollout of each mode (lookahead.lookahead), n = `source.settings.agents`; in the preset `extended` 9
    columns, and `route` (n, 14); `action_mask` (n, 20): 1 for modes that may be chosen. With trips `active` (n,) int8
    tells which slots have a road user: the observations and rewards of the others are zero.
    Autoreset within the same step: `infos["final_obs"]` holds the last observation of the episodes that ended (rows
    where `infos["_final_obs"]`; zeros elsewhere). `infos` also has the terms of the reward by name, `speed_mps`,
    `type`, `steps` (decisions of the episode so far), with trips `gone`, `reached` and `clean` (see TripOutcome), all
    (n,), and `teacher_costs` (n, modes).

    `reset(seed=...)` opens a scenario, drawn by the seed: same seed and actions, same episodes. Only one of these may
    be open in a process. Raises InputError where scenario or bundle cannot be loaded, SumoError where SUMO gives up.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 (gymnasium's own way)

    def __init__(self, source: ArenaSource) -> None:
        self.num_envs = source.settings.agents
        self.single_observation_space = observation_space(source.settings)
        self.single_action_space = ACTION_SPACE
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(ACTION_SPACE, self.num_envs)
        self._source = source
        self._bundle: ModelBundle | None = None
        self._open = ExitStack()
        self._slots: SpawnedSlots | TripSlots | None = None
        self._seed = 0

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """See the class; without a seed the one after the last is taken."""
        self._seed = seed if isinstance(seed, int) else self._seed + 1
        flat = self.flat_reset(self._seed)
        return {name: flat[name] for name in OBSERVED if name in flat}, {
            name: flat[name] for name in ("type", "teacher_costs")
        }

    def flat_reset(self, seed: int) -> Arrays:
        """A reset as one dict: observation, `type` and `teacher_costs`."""
        self._slots = None
        self._open.close()
        self._bundle = self._bundle or load_bundle(self._source.bundle)
        drawn = np.random.default_rng(seed)
        scenario = find_scenario(self._source.scenarios[int(drawn.integers(len(self._source.scenarios)))])
        settings, draw = self._source.settings, int(drawn.integers(2**31))
        if settings.trips:
            trips = self._open.enter_context(TripArena(scenario, self._bundle, settings, draw))
            self._slots = TripSlots(trips)
        else:
            arena = self._open.enter_context(Arena(scenario, self._bundle, settings, draw))
            self._slots = SpawnedSlots(arena)
        return self._slots.look()

    def step(self, actions: NDArray[np.int64]) -> Stepped:
        """See gymnasium.vector.VectorEnv; `actions` (n,) are modes."""
        return stepped(self.flat_step(actions))

    def flat_step(self, modes: NDArray[np.int64]) -> Arrays:
        """A step as one dict; arrays whose names begin with final_ have rows of the ended episodes only."""
        assert self._slots is not None
        return self._slots.step(np.asarray(modes, np.int64))

    def close_extras(self, **kwargs: Any) -> None:
        """End the simulation."""
        self._slots = None
        self._open.close()


def stepped(every: Arrays) -> Stepped:
    """What the slots of one or several simulations give in a step, as gymnasium.vector.VectorEnv gives it."""
    own = [name for name in every if not name.startswith("final_") and name not in OBSERVED + RESULT]
    infos: dict[str, Any] = {name: every[name] for name in own}
    observation = {name: every[name] for name in OBSERVED if name in every}
    ended = infos["_final_obs"] = every["terminated"] | every["truncated"]
    infos["final_obs"] = {name: np.zeros_like(values) for name, values in observation.items()}
    for name, values in infos["final_obs"].items():
        values[ended] = every[f"final_{name}"]
    return observation, every["reward"], every["terminated"], every["truncated"], infos
