"""Observations of road users: features, ego image and route features."""
