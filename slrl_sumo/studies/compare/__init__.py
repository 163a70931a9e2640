"""A scenario with learned road users beside SUMO's own models on the same demand."""
