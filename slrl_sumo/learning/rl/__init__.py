"""Reinforcement learning of the selector: rewards, arena, rollouts, PPO."""
