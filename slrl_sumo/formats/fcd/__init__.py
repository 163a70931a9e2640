"""Floating car data (FCD) in SUMO's formats."""
