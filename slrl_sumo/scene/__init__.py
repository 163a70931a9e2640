"""Road users, their states and motion as plain arrays, without a simulator."""
