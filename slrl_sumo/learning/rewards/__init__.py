"""The terms of the reward, and the transitions from which they are computed."""
