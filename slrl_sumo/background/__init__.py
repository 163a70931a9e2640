"""SUMO's own road users yield to learned ones."""
