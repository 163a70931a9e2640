"""The road network that SUMO has loaded: lanes, their connections through junctions, and changes during a run."""

from slrl_sumo.sumo.network.loaded import LANE_WIDTH, Network, is_crossing, is_walking_area, read_network

__all__ = ["LANE_WIDTH", "Network", "is_crossing", "is_walking_area", "read_network"]
