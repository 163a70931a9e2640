"""A running simulation as an environment: arenas, slots, and the environments of gymnasium."""
