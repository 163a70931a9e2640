"""Prediction by the package beside baselines that learn from the same recordings."""
