"""The terms of the reward, and what a decision led to."""
