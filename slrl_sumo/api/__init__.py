"""Runs as functions and objects: what scripts and notebooks use, and the command line calls."""
