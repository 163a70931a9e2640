"""Trains one policy for all learned road users by RLlib.

python docs/examples/train_rllib.py [iterations] [folder for the policy]

Needs: pip install 'slrl-sumo[rl,ray]' dm_tree
"""

import sys
from pathlib import Path

import numpy as np
import ray
from gymnasium import spaces
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

import slrl_sumo
from slrl_sumo.agent.decide import Situation

MODES, COLUMNS = 20, 10
EPISODE = 128
"""Decisions of an episode: 51.2 s."""
ROW = spaces.Box(-10.0, 10.0, (12 + 14 + MODES * COLUMNS,), np.float32)


def observe(situation: Situation) -> np.ndarray:
    """The vector, the route and the rollouts of all modes as one row, (agents, 226)."""
    seen, rollouts = situation.observation, situation.rollouts
    ahead = rollouts.columns(("collision", "off_surface", "speed", "turn", *rollouts.route._fields))
    return np.column_stack([seen.vector, seen.route, ahead.reshape(len(seen), -1)]).clip(-10.0, 10.0)


def make(_: object) -> ParallelPettingZooEnv:
    """Sixteen road users in the shipped intersection, for 51 s at a time."""
    return ParallelPettingZooEnv(
        slrl_sumo.parallel_env("intersection", agents=16, observe=observe, observation_space=ROW)
    )


def main(iterations: int, folder: Path) -> None:
    """Train, say after each iteration (an episode) what all road users together earned, and save the policy."""
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)
    register_env("road users", make)
    config = (
        PPOConfig()
        .environment("road users")
        .env_runners(num_env_runners=0)
        # Counted in steps of the environment: RLlib 2.60 fails where it counts those of agents and one has none.
        .training(train_batch_size_per_learner=EPISODE, minibatch_size=128, num_epochs=4)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared")
        .debugging(seed=1, log_level="ERROR")
    )
    algorithm = config.build_algo()
    for number in range(iterations):
        found = algorithm.train()["env_runners"]
        print(f"iteration {number + 1}: they earned {found['episode_return_mean']:.1f}")
    algorithm.save(str(folder.absolute() / "rllib"))
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, Path(sys.argv[2] if len(sys.argv) > 2 else "."))
