"""Functions that make environments of several road users."""

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from slrl_sumo.extras import require
from slrl_sumo.learning.environments.options import EnvOptions, Others, check_keywords, make_source
from slrl_sumo.learning.environments.simulation_env import SimulationVectorEnv

if TYPE_CHECKING:
    from slrl_sumo.learning.environments.parallel_env import ParallelRoadUserEnv  # PettingZoo is an extra


def parallel_env(
    scenario: str | Path, *, agents: int = 16, others: Others | None = None, **options: Unpack[EnvOptions]
) -> "ParallelRoadUserEnv":
    """A PettingZoo parallel environment whose agents are the learned road users of one simulation.

        env = slrl_sumo.parallel_env("intersection", agents=32)
        env = slrl_sumo.parallel_env("my.sumocfg", agents=64, takeover={"car": 0.5, "bicycle": 1})

    `agents`: number of road users that are added; with `takeover`, number of road users of the scenario that are agents
    in an episode. For the other keywords, observations and rewards see RoadUserEnv; for agents and episodes see
    ParallelRoadUserEnv. Needs `pip install slrl-sumo[rl]`. Raises InputError for invalid arguments.
    """
    require("pettingzoo", "the parallel environment")
    from slrl_sumo.learning.environments.parallel_env import ParallelRoadUserEnv

    check_keywords(options, "scenario", "agents", "others")
    return ParallelRoadUserEnv(make_source(scenario, agents, others, **options))


def vector_env(
    scenario: str | Path, *, num_envs: int = 16, others: Others | None = None, **options: Unpack[EnvOptions]
) -> SimulationVectorEnv:
    """All learned road users of one simulation as a gymnasium vector environment, in this process.

    `num_envs`: number of learned road users. The other keywords are those of RoadUserEnv. Raises InputError for invalid
    arguments.
    """
    check_keywords(options, "scenario", "num_envs", "others")
    return SimulationVectorEnv(make_source(scenario, num_envs, others, **options))
