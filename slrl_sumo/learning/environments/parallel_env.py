"""The learned road users of one simulation as the agents of a PettingZoo parallel environment."""

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.observations import Seen
from slrl_sumo.learning.environments.options import scenario_wanted
from slrl_sumo.learning.environments.seeds import given_seed, next_seed
from slrl_sumo.learning.environments.simulation_process import Reply, SimulationProcess
from slrl_sumo.learning.environments.slot_view import first_info, next_info, outcome_of, row_of, view_space
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.models.displacement import MODES

Stepped = tuple[dict[str, Seen], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]


class ParallelRoadUserEnv(ParallelEnv[str, Seen, np.int64]):
    """All learned road users of one simulation as agents: a view of SimulationVectorEnv. Made by
    slrl_sumo.parallel_env.

    Actions, observations, rewards, infos and keywords are those of RoadUserEnv. Agents are `road_user_0` to
    `road_user_{agents - 1}`. Without `takeover`, all agents begin at reset. With `takeover`, an agent is a road user of
    the scenario: the first agents are the road users that are learned at reset, and further agents enter with the
    departures of their road users. An agent that terminates or is truncated does not return before the next reset. The
    selector `others` drives all other learned road users: those of terminated agents, and those without a free agent.

    An episode is over when no agent is left, at the latest after `episode_steps` decisions. `reset` loads SUMO again:
    equal seeds and actions give equal episodes. Without a seed, `reset` uses the last seed plus one, at first a random
    seed.
    """

    metadata: dict[str, Any] = {"name": "slrl_sumo_v0", "render_modes": []}  # noqa: RUF012 (PettingZoo's own way)

    def __init__(self, source: ArenaSource) -> None:
        agents = source.settings.agents
        self.render_mode: str | None = None
        self.possible_agents = [f"road_user_{number}" for number in range(agents)]
        self.agents: list[str] = []
        self._space = view_space(source)
        self.observation_spaces = dict.fromkeys(self.possible_agents, self._space)
        self.action_spaces: dict[str, spaces.Space[Any]] = {
            agent: spaces.Discrete(MODES) for agent in self.possible_agents
        }
        self._simulation = SimulationProcess(source)
        self._steps_limit = source.settings.episode_steps
        self._seed: int | None = None
        self._steps = 0
        self._slot: dict[str, int] = {}
        self._id: dict[str, str] = {}
        self._ready = False

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """See pettingzoo.ParallelEnv."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """See pettingzoo.ParallelEnv."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Seen], dict[str, dict[str, Any]]]:
        """See the class; `options={"scenario": ...}` changes the scenario from then on."""
        wanted = scenario_wanted(options)
        self._seed = next_seed(given_seed(seed), self._seed)
        self._ready, self._steps = False, 0
        self._slot, self._id, self.agents = {}, {}, []
        reply = self._simulation.reset(self._seed, wanted)
        self._ready = True
        self._enter(reply)
        seen = {agent: row_of(reply.seen, self._slot[agent], self._space) for agent in self.agents}
        return seen, {agent: first_info(reply, self._slot[agent]) for agent in self.agents}

    def step(self, actions: dict[str, np.int64]) -> Stepped:
        """See pettingzoo.ParallelEnv."""
        if not self._ready:
            raise ResetNeeded("call reset() before step()")
        if not self.agents:
            return {}, {}, {}, {}, {}
        modes = self._modes(actions)
        self._ready = False  # so that a reset is required after an error
        reply = self._simulation.step(modes)
        self._ready = True
        self._steps += 1
        late = self._steps >= self._steps_limit
        result: Stepped = {}, {}, {}, {}, {}
        seen, rewards, terminated, truncated, infos = result
        for agent in self.agents:
            slot = self._slot[agent]
            seen[agent], rewards[agent], terminated[agent], ended = outcome_of(reply, slot, self._space)
            truncated[agent] = ended or (late and not terminated[agent])
            infos[agent] = next_info(reply, slot, self._id[agent])
        self.agents = [agent for agent in self.agents if not terminated[agent] and not truncated[agent]]
        for agent in () if late else self._enter(reply):
            slot = self._slot[agent]
            seen[agent], infos[agent] = row_of(reply.seen, slot, self._space), first_info(reply, slot)
            rewards[agent], terminated[agent], truncated[agent] = 0.0, False, False
        return result

    def render(self) -> None:
        """Do nothing; RoadUserEnv renders."""

    def close(self) -> None:
        """End the simulation and its process; a reset opens it again."""
        self._ready, self.agents = False, []
        self._simulation.close()

    def _modes(self, actions: dict[str, np.int64]) -> NDArray[np.int64]:
        modes = np.full(len(self.possible_agents), -1)
        if missing := set(self.agents) - set(actions):
            raise InputError(f"there is none for {', '.join(sorted(missing))}", argument="actions")
        for agent in self.agents:
            if not self.action_spaces[agent].contains(actions[agent]):
                raise InputError(
                    f"{agent}: {actions[agent]} is no mode; give a whole number from 0 to {MODES - 1}",
                    argument="actions",
                )
            modes[self._slot[agent]] = actions[agent]
        return modes

    def _enter(self, reply: Reply) -> list[str]:
        """Add and return the agents that enter now: road users new to a slot in this episode, while names are left."""
        known, entered = set(self._id.values()), []
        for slot, road_user in enumerate(reply.ids):
            if road_user is None or road_user in known or len(self._id) == len(self.possible_agents):
                continue
            agent = self.possible_agents[len(self._id)]
            self._slot[agent], self._id[agent] = slot, road_user
            entered.append(agent)
        self.agents = [*self.agents, *entered]
        return entered
