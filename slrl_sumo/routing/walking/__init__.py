"""Paths of pedestrians: the graph of walks, paths along it, and the tracks of persons."""
