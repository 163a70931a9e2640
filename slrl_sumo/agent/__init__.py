"""The decision of a learned road user: decide, constraints, selectors, the lane-following baseline."""
