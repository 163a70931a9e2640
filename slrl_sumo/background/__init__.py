"""Yielding of background road users to learned road users."""
