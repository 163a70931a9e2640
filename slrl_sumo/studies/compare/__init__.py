"""Comparison of a scenario with learned road users and with SUMO's models on the same demand."""
