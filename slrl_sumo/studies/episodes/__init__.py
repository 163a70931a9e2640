"""Measurement of selectors over many episodes in a scenario."""
