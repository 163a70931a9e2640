"""The examination in a child process: a crash of SUMO ends only that process."""

from slrl_sumo.doctor.finding import Finding
from slrl_sumo.sumo.isolation import isolated
from slrl_sumo.sumo.scenario import Scenario


def examine_isolated(scenario: Scenario) -> list[Finding]:
    """Like slrl_sumo.doctor.diagnosis.examine, in a child process. Raises InputError if SUMO crashes."""
    return isolated(_examine, scenario, scenario.config)


def _examine(scenario: Scenario) -> list[Finding]:
    from slrl_sumo.doctor.diagnosis import examine

    return examine(scenario)
