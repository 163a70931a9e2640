"""Selectors measured over many episodes in a scenario."""
