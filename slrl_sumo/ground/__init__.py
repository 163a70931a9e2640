"""The ground of a scene: surfaces, the road map and its tiles."""
