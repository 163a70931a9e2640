"""Learning: supervised models, reinforcement learning of the selector, rewards and environments."""
