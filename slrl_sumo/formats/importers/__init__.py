"""Recordings in formats of data sets as Trajectories."""
