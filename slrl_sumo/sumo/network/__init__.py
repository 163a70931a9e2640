"""The road network that SUMO has loaded: lanes, how they continue through junctions, and what changes while it runs."""

from slrl_sumo.sumo.network.loaded import LANE_WIDTH, Network, is_crossing, is_walking_area, read_network

__all__ = ["LANE_WIDTH", "Network", "is_crossing", "is_walking_area", "read_network"]
