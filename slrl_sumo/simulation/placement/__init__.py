"""Placement of learned road users: at the start, at a new start, and at the other end of the scene."""
