"""Prediction errors on recordings."""
