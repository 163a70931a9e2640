"""Recipes of what ships with the package, and the soak test."""
