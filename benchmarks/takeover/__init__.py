"""Takeover of a scenario's own road users, measured against SUMO's own models on the same demand."""
