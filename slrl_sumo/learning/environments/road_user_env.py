"""A gymnasium environment in which the user controls one learned road user."""

from pathlib import Path
from typing import Any, Literal, Unpack, get_args

import gymnasium
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.observations import Seen
from slrl_sumo.learning.environments.options import (
    EnvOptions,
    Others,
    check_keywords,
    check_known,
    make_source,
    scenario_wanted,
)
from slrl_sumo.learning.environments.seeds import given_seed
from slrl_sumo.learning.environments.simulation_env import ACTION_SPACE
from slrl_sumo.learning.environments.simulation_process import Reply, SimulationProcess
from slrl_sumo.learning.environments.slot_view import first_info, next_info, outcome_of, row_of, view_space
from slrl_sumo.learning.environments.source import is_family
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.displacement import MODES
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES

Ego = Literal["car", "bicycle", "pedestrian"]


class RoadUserEnv(gymnasium.Env[Any, np.int64]):
    """One learned road user, the ego, among other learned road users and SUMO's traffic: a view of SimulationVectorEnv.

    - Action: the mode, 0 to 19, of the next decision (0.4 s).
    - Observation: a row of the observation of SimulationVectorEnv: `vector` float32, (12,) or, with a bundle of
      `fit --preset history`, (33,), columns as in perception.features.STATES; `rollouts` (20, 9) float32, the rollout
      of each mode; `action_mask` (20,) int8, 1 for modes that constraints allow; `route` (14,) float32, columns as in
      perception.route_features.ROUTE_FEATURES; with `image` `image` (20, 40, 3) uint8. In the preset `paper`,
      `rollouts` have 4 columns, and there is no `route`. In the preset `image`, `vector` is (33,), `route` (30,) with
      the path ahead (PATH_FEATURES), there is an `image`, and there are no `rollouts`.
    - Reward: the terms of learning.rewards, weighted by `weights`; `info["terms"]` has the terms before weighting.
    `info`   also has `speed_mps`, `type`, `id`, `slot` (row in the vector environment) and `action_mask`, and with
    `takeover`   `reached` and `clean` (see TripOutcome). After reset it also has `scenario`.
    - Terminated: in contact with a road user by own fault, or lost; with `takeover` also at the destination, where
      `info["reached"]` is True. Truncated: after `episode_steps` decisions; with `takeover` also if SUMO drives the
      road user again before its destination, such as on a lane that is too fast for the models.

    `scenario`: a scenario as for `slrl-sumo run`, or a family of `slrl-sumo generate`, of which each reset draws a new
    network. `options={"scenario": ...}` of a reset changes the scenario from then on. `ego`: type of the ego; None:
    drawn from the learned road users. `agents`: number of learned road users, including the ego. `others`: selector of
    all other learned road users, as for `slrl-sumo run --selector`; None: the default of a run. With "sumo", the ego is
    the only learned road user, a car unless `ego` is given, and `agents` has no effect.

    `takeover`: shares of the scenario's road users that are learned, as {"car": 0.3} or 'car=0.3', at most `agents` at
    a time, from departure to destination; None: `agents` road users are added, with the types of `mix`. `exclude`: ids
    of road users that are neither taken over nor held for learned road users. `bundle`: name or folder. `preset`,
    `image`: contents of the observation; None: the inputs of the bundle's selector, and an image in the preset `image`.
    `weights`: weights of the reward's terms. `episode_steps`: None: 128, with a takeover 1500. `warm_up`: duration (s)
    of traffic before the first episode.

    `reward(transition)`: the user's reward, (n,), of a learning.rewards.transition.Transition of n road users.
    `observe(situation)` and `observation_space`: the user's observation of an agent.decide.Situation, an array of n
    rows for a Box, or a dict of such arrays for a Dict; `observation_space` is the space of one road user.

    `reset(seed=...)` loads SUMO: equal seeds and actions give equal episodes. Without a seed, the ego begins at a new
    place in the present traffic (with `takeover`: as another road user), at nearly no cost; SUMO is loaded again, with
    a seed drawn from the last one, if an episode was interrupted, if the scenario's time is over, or for a new network.
    Measured: docs/measurements/performance.md.

    SUMO runs in a child process, from the first reset to `close`. Raises InputError for invalid arguments, and
    SumoError if SUMO fails; a reset then starts again.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2.5}  # noqa: RUF012 (gymnasium's own way)

    def __init__(
        self,
        *,
        scenario: str | Path,
        ego: Ego | None = None,
        agents: int = 16,
        others: Others | Literal["sumo"] | None = None,
        render_mode: str | None = None,
        **options: Unpack[EnvOptions],
    ) -> None:
        check_keywords(options, "scenario", "ego", "agents", "others", "render_mode")
        check_known("ego", ego, (None, *get_args(Ego)))
        check_known("render_mode", render_mode, (None, "rgb_array"))
        if others == "sumo":
            if options.get("takeover") is not None:
                raise InputError(
                    f"not with `takeover`; leave one of them out, or give {', '.join(map(repr, get_args(Others)))}",
                    argument="others",
                    value=others,
                )
            agents, options["mix"] = 1, {ego or "car": 1.0}
        source = make_source(scenario, agents, None if others == "sumo" else others, **options)
        bundle = load_bundle(source.bundle)
        if ego is not None and not bundle.types[TYPE_NAMES.index(ego)]:
            raise InputError(f"bundle '{bundle.name}' has no models for it; give another", argument="ego", value=ego)
        self.render_mode = render_mode
        self.action_space = ACTION_SPACE
        self.observation_space = view_space(source)
        self._simulation = SimulationProcess(source)
        self._scenario, self._ego = source.scenarios[0], ego
        self._agents, self._steps_limit = agents, source.settings.episode_steps
        self._trips = source.settings.trips
        self._reply: Reply | None = None
        self._slot, self._steps, self._id = 0, 0, ""
        self._over = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """See the class and gymnasium.Env."""
        seed = given_seed(seed)
        super().reset(seed=seed)
        wanted = scenario_wanted(options)
        self._scenario = wanted or self._scenario
        reply = self._reply
        if seed is not None or wanted is not None or reply is None or not self._goes_on(reply):
            drawn = int(self.np_random.integers(2**31)) if seed is None else seed
            self._reply = None
            reply = self._simulation.reset(drawn, wanted)
            self._slot = self._drawn(reply)
        elif self._trips:
            self._slot = self._drawn(reply)
        self._reply, self._over, self._steps = reply, False, 0
        self._id = reply.ids[self._slot] or ""
        seen = row_of(reply.seen, self._slot, self.observation_space)
        return seen, first_info(reply, self._slot) | {"scenario": reply.scenario}

    def step(self, action: np.int64) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """See the class and gymnasium.Env."""
        if not self.action_space.contains(action):
            raise InvalidAction(f"action {action}: give a whole number from 0 to {MODES - 1}")
        if self._reply is None:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        if self._over:
            raise ResetNeeded("the episode is over: call reset() before the next step()")
        modes = np.full(self._agents, -1)
        modes[self._slot] = action
        self._reply = None  # so that a reset starts again after an error
        self._reply = reply = self._simulation.step(modes)
        self._steps += 1
        seen, reward, terminated, ended = outcome_of(reply, self._slot, self.observation_space)
        truncated = not terminated and (ended or self._steps >= self._steps_limit)
        self._over = terminated or truncated
        return seen, reward, terminated, truncated, next_info(reply, self._slot, self._id)

    def render(self) -> NDArray[np.uint8] | None:
        """The surroundings of the ego from above, (512, 512, 3) RGB, north up; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._reply is None:
            raise ResetNeeded("there is nothing to see: call reset() before render()")
        return self._simulation.picture(self._id, self._steps > 0)

    def close(self) -> None:
        """End the simulation and its process; a reset opens it again."""
        self._reply = None
        self._simulation.close()

    def _goes_on(self, reply: Reply) -> bool:
        """Whether the next episode can begin in the present traffic."""
        if not self._over or is_family(self._scenario):
            return False
        if self._trips and not len(self._candidates(reply)):
            return False
        return reply.seconds_left >= self._steps_limit * DECISION_INTERVAL

    def _candidates(self, reply: Reply) -> NDArray[np.intp]:
        """Slots of the road users that may become the ego."""
        there = np.array([road_user is not None for road_user in reply.ids])
        if self._ego is not None:
            there &= reply.type == TYPE_NAMES.index(self._ego)
        return np.flatnonzero(there)

    def _drawn(self, reply: Reply) -> int:
        slots = self._candidates(reply)
        if not len(slots):
            raise InputError(
                f"none of the {len(reply.ids)} learned road users of {reply.scenario} is a {self._ego or 'road user'}; "
                "give more `agents`, another `ego` or another scenario"
            )
        return int(self.np_random.choice(slots))
