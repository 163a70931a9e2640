"""The examination in a process of its own: a crash of SUMO ends that process alone."""

from slrl_sumo.doctor.finding import Finding
from slrl_sumo.sumo.isolation import isolated
from slrl_sumo.sumo.scenario import Scenario


def examine_isolated(scenario: Scenario) -> list[Finding]:
    """The same as slrl_sumo.doctor.diagnosis.examine, from a child process. Raises InputError where SUMO crashes."""
    return isolated(_examine, scenario, scenario.config)


def _examine(scenario: Scenario) -> list[Finding]:
    from slrl_sumo.doctor.diagnosis import examine

    return examine(scenario)
