"""Recordings of other people's formats as Trajectories."""
