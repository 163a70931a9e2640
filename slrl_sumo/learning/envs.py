"""Gymnasium environments in which one learned road user is driven from outside.

Importing this module registers slrl_sumo/Intersection-v0, slrl_sumo/SharedSpace-v0 and slrl_sumo/Random-v0;
`gymnasium.make("slrl_sumo.learning.envs:slrl_sumo/Intersection-v0")` imports it on the way.
"""

import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from netgen.families import generate
from slrl_sumo.agent.decide import Situation, choose
from slrl_sumo.agent.driver import make_selector
from slrl_sumo.agent.selectors import Selector
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import EPISODE_STEPS, Arena, ArenaSettings, Outcome
from slrl_sumo.learning.environments.slots import action_mask
from slrl_sumo.learning.rewards.terms import RewardWeights
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import PRESETS
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS, ego_picture
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.route_features import ROUTE_FEATURES
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES
from slrl_sumo.simulation.spawn import DEFAULT_MIX
from slrl_sumo.sumo.scenario import Scenario, find_scenario

Seen = dict[str, NDArray[Any]]
Ego = Literal["car", "bicycle", "pedestrian"]
Others = Literal["prior", "greedy", "sampled", "sumo"]

COUNTED = 10_000
"""Upper bound of the numbers of road users within 20 m."""
VECTOR_HIGH = np.array([100, 250, 1, 1, 1, np.pi, *[COUNTED] * 6], np.float32)
"""No road user's FEATURES go beyond this: 100 m/s, reached or lost within one decision."""
VECTOR_LOW = np.where([name in ("acceleration", "heading") for name in FEATURES], -VECTOR_HIGH, 0).astype(np.float32)


class RoadUserEnv(gymnasium.Env[Any, np.int64]):
    """One learned road user, the ego, among other learned ones and SUMO's traffic.

    - Action: the mode, 0 to 19, of the next decision (0.4 s).
    - Observation: `vector` (12,) float32 and `image` (40, 80, 3) uint8 as in perception.Observation, the image
      `enlarge` times as large: 2, because the CNN of Stable-Baselines3 takes none below 36 px; 1 is what selectors see.
      With `preset` "extended" it knows its route: the path in the image, and `route` (14,) float32, columns as in
      perception.route_features.ROUTE_FEATURES.
    - Reward: the terms of learning.rewards by `weights`; `info["terms"]` has them before weighting. `info` also has
      `speed_mps`, `type`, `id` and `action_mask` (20,) int8: 1 for modes that constraints allow next. After
      reset it also has `scenario`.
    - Terminated: in contact with a road user, or lost. Truncated: after `episode_steps` decisions.

    `ego`: its type; None draws it from the `agents` learned road users, itself included. `others`: the selector
    of all but the ego, as `slrl-sumo run --selector` names them; with "sumo" the ego is the only learned one,
    and `agents` has no effect. `bundle` and `scenario` as `slrl-sumo run` names them; scenario None draws a new random
    network at every reset. `options={"scenario": ...}` of a reset puts another one in its place, from then on.

    `reset(seed=...)` loads SUMO: same seed and actions, same episodes. Without a seed the ego begins at a new place in
    the traffic as it is, which costs next to nothing; SUMO is loaded anew, by a seed drawn from the last one, where an
    episode was broken off, the scenario's time runs out, or there is a new network. Measured:
    docs/measurements/performance.md.

    libsumo holds one simulation per process. Of several environments in one process the one that was reset last has
    it, and the others raise InputError from `step` until they are reset. Side by side they run in processes of their
    own: gymnasium.make_vec(..., vectorization_mode="async").

    From its first reset to `close` torch computes in one thread in this process, as in a run: the models are so small
    that more threads only wait for each other. `close` sets the number of threads that was there before.

    Raises InputError for what cannot be used, SumoError when SUMO gives up; then a reset begins anew.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2.5}  # noqa: RUF012 (gymnasium's own way)

    def __init__(
        self,
        *,
        bundle: str = "intersection",
        scenario: str | None = "intersection",
        ego: Ego | None = None,
        others: Others = "prior",
        agents: int = 16,
        weights: RewardWeights | None = None,
        episode_steps: int = EPISODE_STEPS,
        enlarge: int = 2,
        render_mode: str | None = None,
        preset: str = "paper",
    ) -> None:
        _known("ego", ego, (None, *get_args(Ego)))
        _known("others", others, get_args(Others))
        _known("preset", preset, PRESETS)
        _known("render_mode", render_mode, (None, "rgb_array"))
        for name, value in (("agents", agents), ("episode_steps", episode_steps), ("enlarge", enlarge)):
            if value < 1:
                raise InputError(f"{name}={value}: give a whole number from 1")
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(MODES)
        image = (EGO_ROWS * enlarge, EGO_COLS * enlarge, 3)
        seen: dict[str, spaces.Space[Any]] = {
            "vector": spaces.Box(VECTOR_LOW, VECTOR_HIGH),
            "image": spaces.Box(0, 255, image, np.uint8),
        }
        if preset == "extended":
            seen["route"] = spaces.Box(-10.0, 10.0, (len(ROUTE_FEATURES),), np.float32)
        self.observation_space = spaces.Dict(seen)
        self._bundle: ModelBundle = load_bundle(bundle)
        if ego is not None and not self._bundle.types[TYPE_NAMES.index(ego)]:
            raise InputError(f"ego={ego!r}: bundle '{self._bundle.name}' has no models for it; give another")
        mix = np.where(self._bundle.types, DEFAULT_MIX, 0.0)
        self._mix = mix / mix.sum()
        self._scenario = None if scenario is None else find_scenario(scenario)
        self._ego, self._others, self._enlarge = ego, others, enlarge
        self._settings = ArenaSettings(
            agents=1 if others == "sumo" else agents,
            weights=weights or RewardWeights(),
            episode_steps=episode_steps,
            extended=preset == "extended",
        )
        self._selector = self._make_selector(0)  # fails now where there is none
        self._running = ExitStack()
        self._arena: Arena | None = None
        self._slot = 0
        self._over = False
        self._scene: WorldState | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """See the class and gymnasium.Env."""
        super().reset(seed=seed)
        wanted = (options or {}).get("scenario")
        if wanted is not None:
            self._scenario = find_scenario(str(wanted))
        if seed is not None or wanted is not None or not self._goes_on():
            self._load()
        assert self._arena is not None
        self._over = False
        self._scene = self._arena.world
        return self._seen(self._arena.situation, self._slot), self._info() | {"scenario": self._name}

    def step(self, action: np.int64) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """See the class and gymnasium.Env."""
        if not self.action_space.contains(action):
            raise InvalidAction(f"action {action}: give a whole number from 0 to {MODES - 1}")
        if self._arena is None or self._over:
            if _holder is not None and not self._over:
                raise InputError(
                    "another environment of this process has taken SUMO over (libsumo holds one simulation per "
                    'process): reset this one, or make them with gymnasium.make_vec(..., vectorization_mode="async")'
                )
            raise ResetNeeded("the episode is over: call reset() before the next step()")
        arena, slot = self._arena, self._slot
        modes = np.zeros(self._settings.agents, np.int64)
        if self._selector is not None:
            modes, _ = choose(arena.situation, self._selector, arena.world.ids[: len(modes)])
        modes[slot] = action
        try:
            with ExitStack() as failing:  # the arena's own end tells SUMO's errors from others
                failing.push(arena)
                outcome = arena.step(modes)
                failing.pop_all()
        except BaseException:
            self.close()
            raise
        terminated, truncated = bool(outcome.terminated[slot]), bool(outcome.truncated[slot])
        self._over = terminated or truncated
        self._scene = outcome.world
        info = self._info() | {
            "speed_mps": float(outcome.speed[slot]),
            "terms": {name: float(values[slot]) + 0.0 for name, values in outcome.terms.items()},
        }
        return self._last_seen(outcome), float(outcome.reward[slot]), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The surroundings of the ego from above, (512, 512, 3) RGB, north up; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._arena is None or self._scene is None:
            raise ResetNeeded("there is nothing to see: call reset() before render()")
        from slrl_sumo.perception.top_view import top_view

        return top_view(self._scene, self._slot, self._arena.simulation.road_map)

    def close(self) -> None:
        """End the simulation; a reset opens it again."""
        global _holder
        if _holder is self:
            _holder = None
        self._arena = self._scene = None
        self._running.close()

    def _goes_on(self) -> bool:
        """Whether the next episode can begin in the traffic as it is."""
        if self._arena is None or not self._over or self._scenario is None:
            return False
        end = self._scenario.seconds("end")
        return end is None or self._arena.world.time + self._settings.episode_steps * DECISION_INTERVAL <= end

    def _load(self) -> None:
        """Open an arena by a seed drawn from ours, in place of any other one of this process."""
        global _holder
        self.close()
        if _holder is not None:
            _holder.close()
        seed = int(self.np_random.integers(2**31))
        settings = self._settings
        if self._others == "sumo":
            kind = TYPE_NAMES.index(self._ego) if self._ego else int(self.np_random.choice(3, p=self._mix))
            settings = replace(settings, mix=(float(kind == 0), float(kind == 1), float(kind == 2)))
        with ExitStack() as opened:
            opened.enter_context(one_thread())
            scenario = self._scenario
            if scenario is None:
                folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="slrl_sumo_")))
                scenario = find_scenario(str(generate("random", seed, folder / f"random-{seed}")))
            arena = opened.enter_context(Arena(scenario, self._bundle, settings, seed))
            self._slot = self._draw_ego(arena.world, scenario)
            self._running = opened.pop_all()
        self._arena, self._name = arena, scenario.name
        self._selector = self._make_selector(seed)
        self._over = False
        _holder = self

    def _draw_ego(self, world: WorldState, scenario: Scenario) -> int:
        types = world.type[: self._settings.agents]
        slots = np.arange(len(types)) if self._ego is None else np.flatnonzero(types == TYPE_NAMES.index(self._ego))
        if not len(slots):
            raise InputError(
                f"{scenario.config}: none of the {len(types)} learned road users is a {self._ego}; "
                "give more agents, another ego or another scenario"
            )
        return int(self.np_random.choice(slots))

    def _make_selector(self, seed: int) -> Selector | None:
        if self._others == "sumo":
            return None
        selector = make_selector(self._others, self._bundle, seed)
        if self._others != "prior" and (selector.preset == "extended") != self._settings.extended:
            raise InputError(
                f"others={self._others!r}: the selector of bundle '{self._bundle.name}' sees the preset "
                f"{selector.preset!r}; give preset={selector.preset!r}, or another bundle"
            )
        return selector

    def _info(self) -> dict[str, Any]:
        assert self._arena is not None
        world = self._arena.world
        return {
            "speed_mps": float(world.speed[self._slot]),
            "type": TYPE_NAMES[world.type[self._slot]],
            "id": world.ids[self._slot],
            "action_mask": action_mask(self._arena.situation)[self._slot],
        }

    def _last_seen(self, outcome: Outcome) -> Seen:
        """What the ego sees after a step; in the end not the place where its next episode begins."""
        if not self._over:
            return self._seen(outcome.situation, self._slot)
        assert outcome.final is not None
        ended = np.flatnonzero(outcome.terminated | outcome.truncated)
        return self._seen(outcome.final, int(np.searchsorted(ended, self._slot)))

    def _seen(self, situation: Situation, row: int) -> Seen:
        observation = situation.observation
        assert observation.image is not None
        image = ego_picture(observation.image[row], self._enlarge)
        seen: Seen = {"vector": observation.vector[row].copy(), "image": image.copy()}
        if observation.route is not None:
            seen["route"] = observation.route[row].copy()
        return seen


_holder: RoadUserEnv | None = None
"""The environment that has SUMO in this process."""


def _known(name: str, value: str | None, known: tuple[str | None, ...]) -> None:
    if value not in known:
        raise InputError(f"{name}={value!r}: there is none of that name; give one of {', '.join(map(repr, known))}")


for _name, _bundle, _scenario in (
    ("Intersection", "intersection", "intersection"),
    ("SharedSpace", "shared-space", "shared-space"),
    ("Random", "intersection", None),
):
    gymnasium.register(
        f"slrl_sumo/{_name}-v0",
        "slrl_sumo.learning.envs:RoadUserEnv",
        kwargs={"bundle": _bundle, "scenario": _scenario},
    )
