"""Supervised learning: windows, modes, displacement models and prior from trajectories."""
