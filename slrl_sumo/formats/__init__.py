"""Trajectories of road users and the files that hold them."""
