"""Trains one policy for all learned road users by PettingZoo, SuperSuit and Stable-Baselines3.

python docs/examples/train_parallel_env.py [decisions] [folder for the policy]

Needs: pip install 'slrl-sumo[rl]' supersuit stable-baselines3
"""

import sys
from pathlib import Path

import numpy as np
import supersuit
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

import slrl_sumo
from slrl_sumo.agent.decide import Situation
from slrl_sumo.learning.environments.parallel_env import ParallelRoadUserEnv

MODES, COLUMNS = 20, 10


def observe(situation: Situation) -> np.ndarray:
    """The vector, the route and the rollouts of all modes as one row: SuperSuit pads agents that have left in a Box."""
    seen, rollouts = situation.observation, situation.rollouts
    ahead = rollouts.columns(("collision", "off_surface", "speed", "turn", *rollouts.route._fields))
    return np.column_stack([seen.vector, seen.route, ahead.reshape(len(seen), -1)]).clip(-10.0, 10.0)


def make() -> ParallelRoadUserEnv:
    """Sixteen road users in the shipped intersection, for 51 s at a time."""
    row = spaces.Box(-10.0, 10.0, (12 + 14 + MODES * COLUMNS,), np.float32)
    return slrl_sumo.parallel_env("intersection", agents=16, observe=observe, observation_space=row)


def main(decisions: int, folder: Path) -> None:
    """Train for `decisions` of the road users together, save the policy, and say what a last episode earned."""
    set_random_seed(1)  # SuperSuit passes no seeds on
    env = make()
    agents = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(env))
    vector = supersuit.concat_vec_envs_v1(agents, 1, base_class="stable_baselines3")
    model = PPO("MlpPolicy", vector, n_steps=32, batch_size=128, n_epochs=4, device="cpu")
    model.learn(decisions)
    model.save(folder / "policy.zip")
    vector.close()
    seen, _ = env.reset(seed=99)
    earned, begun = 0.0, len(env.agents)
    while env.agents:
        modes, _ = model.predict(np.stack([seen[agent] for agent in env.agents]), deterministic=True)
        seen, rewards, *_ = env.step(dict(zip(env.agents, modes, strict=True)))
        earned += sum(rewards.values())
    env.close()
    print(f"{model.num_timesteps} decisions; {begun} road users earned {earned / begun:.1f} each")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000, Path(sys.argv[2] if len(sys.argv) > 2 else "."))
