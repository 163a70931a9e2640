"""Reinforcement learning of the selector: imitation, rollouts, PPO, training."""
