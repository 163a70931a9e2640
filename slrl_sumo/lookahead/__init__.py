"""What each mode of a road user leads to in the next seconds."""
