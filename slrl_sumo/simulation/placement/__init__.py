"""Where learned road users are put: at the start, at a new start, and at the other end of the scene."""
