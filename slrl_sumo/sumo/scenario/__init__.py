"""SUMO scenarios on disk: their configuration, options and demand, and the command line that starts SUMO with them."""

from slrl_sumo.sumo.scenario.configuration import Scenario, find_scenario, read_scenario, shipped_scenarios

__all__ = ["Scenario", "find_scenario", "read_scenario", "shipped_scenarios"]
