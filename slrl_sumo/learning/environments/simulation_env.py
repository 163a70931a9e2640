"""The learned road users of one simulation as a vector environment, in this process."""

from contextlib import ExitStack
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from slrl_sumo.agent.decide import choose
from slrl_sumo.agent.make_driver import make_selector
from slrl_sumo.agent.selection import Selector
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import Arena
from slrl_sumo.learning.environments.observations import Observer
from slrl_sumo.learning.environments.options import scenario_wanted
from slrl_sumo.learning.environments.seeds import given_seeds, next_seed
from slrl_sumo.learning.environments.slots import SpawnedSlots, TripSlots
from slrl_sumo.learning.environments.source import ArenaSource, found_scenario
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.displacement import MODES

Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

ACTION_SPACE: spaces.Discrete = spaces.Discrete(MODES)


class SimulationVectorEnv(VectorEnv):
    """One simulation as a vector environment: each slot for a learned road user is a sub-environment.

    Training uses this class; RoadUserEnv and ParallelRoadUserEnv are views of it.

    Observations are dicts of arrays, n = `source.settings.agents`: `vector` (n, columns) float32, columns as in
    features.STATES of `source.settings.state`; with `source.settings.image` `image` (n, 20, 40, 3) uint8; `rollouts`
    (n, 20, 4) float32, the rollout of each mode (lookahead.mode_rollouts); in the preset `extended` 9 columns, and
    `route` (n, 14); `action_mask` (n, 20): 1 for allowed modes. With trips, `active` (n,) int8 is 1 for slots with a
    road user; the observations and rewards of all other slots are zero. `source.observation` replaces these
    observations by the user's own.
    Actions are modes; with -1 the selector `source.others` decides for a road user, and `infos["mode"]` then has all
    modes. Autoreset happens within the same step: `infos["final_obs"]` has the last observation of the episodes that
    ended (rows where `infos["_final_obs"]`; zeros elsewhere). `infos` also has the terms of the reward by name,
    `speed_mps`, `type`, `steps` (decisions of the episode so far), with trips `gone`, `reached` and `clean` (see
    TripOutcome), all (n,), and `teacher_costs` (n, modes).

    `reset(seed=...)` opens a scenario, drawn by the seed: equal seeds and actions give equal episodes; a list of n
    seeds draws a seed. Only one of these environments may be open in a process. `options={"scenario": ...}` of a reset
    replaces the source's scenario from then on. Raises InputError if scenario or bundle cannot be loaded and for an
    invalid seed, InvalidAction for an invalid mode, SumoError if SUMO fails.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 (gymnasium's own way)

    def __init__(self, source: ArenaSource) -> None:
        self.num_envs = source.settings.agents
        self._observer = Observer(source.settings, source.observation)
        self.single_observation_space = self._observer.space
        self.single_action_space = ACTION_SPACE
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(ACTION_SPACE, self.num_envs)
        self._source, self._scenarios = source, source.scenarios
        self._bundle: ModelBundle | None = None
        self._others: Selector | None = None
        self._open = ExitStack()
        self._slots: SpawnedSlots | TripSlots | None = None
        self._seed: int | None = None
        self.scenario = ""
        """Name of the open scenario."""

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """See the class; without a seed, `reset` uses the last seed plus one, at first a random seed."""
        wanted = scenario_wanted(options)
        self._seed = next_seed(given_seeds(seed, self.num_envs), self._seed)
        if wanted is not None:
            self._scenarios = (wanted,)
        self._slots = None
        self._open.close()
        drawn = np.random.default_rng(self._seed)
        name = self._scenarios[int(drawn.integers(len(self._scenarios)))]
        self._slots = self._opened(name, int(drawn.integers(2**31)))
        seen, infos = self._slots.look()
        return self._observer.shown(seen), infos

    def step(self, actions: NDArray[np.int64]) -> Stepped:
        """See gymnasium.vector.VectorEnv; `actions` (n,): modes. Raises InvalidAction for invalid modes."""
        slots = self.slots
        modes = self._checked(actions)
        if self._others is not None:
            modes = self._filled(modes, self._others)
        seen, reward, terminated, truncated, infos = slots.step(modes)
        infos["final_obs"] = self._observer.shown(infos["final_obs"])
        if self._others is not None:
            infos["mode"] = modes
        return self._observer.shown(seen), reward, terminated, truncated, infos

    @property
    def slots(self) -> SpawnedSlots | TripSlots:
        """The slots of the open simulation. Raises InputError without one."""
        if self._slots is None:
            raise InputError("no simulation is open: call reset() first")
        return self._slots

    def close_extras(self, **kwargs: Any) -> None:
        """End the simulation."""
        self._slots = None
        self._open.close()

    def _opened(self, name: str, seed: int) -> SpawnedSlots | TripSlots:
        source = self._source
        self._bundle = bundle = self._bundle or load_bundle(source.bundle)
        self._others = None if source.others is None else make_selector(source.others, bundle, seed)
        image = source.settings.image or (self._others is not None and self._others.needs_image)
        own: dict[str, Any] = {"reward": source.reward, "image": image, "exclude": source.exclude}
        with ExitStack() as opened:
            scenario = found_scenario(name, seed, opened)
            if source.settings.trips:
                trips = TripArena(scenario, bundle, source.settings, seed, **own)
                slots: SpawnedSlots | TripSlots = TripSlots(opened.enter_context(trips), self._observer)
            else:
                arena = Arena(scenario, bundle, source.settings, seed, **own)
                slots = SpawnedSlots(opened.enter_context(arena), self._observer)
            self._open = opened.pop_all()
        self.scenario = scenario.name
        return slots

    def _checked(self, actions: Any) -> NDArray[np.int64]:
        """A copy of `actions` as an array. Raises InvalidAction unless they are (n,) modes."""
        given, least = np.asarray(actions), 0 if self._others is None else -1
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu":
            what = f"actions of shape {given.shape} and type {given.dtype}"
        elif given.min() < least or given.max() >= MODES:
            what = f"action {given[(given < least) | (given >= MODES)][0]}"
        else:
            return given.astype(np.int64)
        raise InvalidAction(f"{what}: give {self.num_envs} whole numbers from {least} to {MODES - 1}")

    def _filled(self, modes: NDArray[np.int64], others: Selector) -> NDArray[np.int64]:
        """`modes` (n,) with each -1 replaced by the mode from the selector `others`."""
        situation, rows = self.slots.situation, self.slots.slots
        if situation is None:
            return modes
        chosen, _ = choose(situation, others, situation.scene.world.take(situation.scene.rows).ids)
        modes = modes.copy()
        modes[rows] = np.where(modes[rows] < 0, chosen, modes[rows])
        return modes
