"""From rows of any rate to Trajectories of 0.4 s: gaps, motion, headings, and checks of units."""
