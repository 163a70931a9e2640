"""Studies over many simulations or recordings."""
