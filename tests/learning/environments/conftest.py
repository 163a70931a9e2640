"""Environments without a process of their own, where a test looks into the simulation or opens many."""

from collections.abc import Iterator

import pytest

from slrl_sumo.learning.environments import simulation_process
from slrl_sumo.learning.environments.simulation_process import SimulationProcess
from slrl_sumo.learning.environments.source import ArenaSource


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Views have their simulation in this process, as in a worker of AsyncVectorEnv; they are closed in the end."""
    made: list[SimulationProcess] = []
    begin = SimulationProcess.__init__

    def begin_and_note(simulation: SimulationProcess, source: ArenaSource) -> None:
        begin(simulation, source)
        made.append(simulation)

    monkeypatch.setattr(simulation_process, "in_worker", lambda: True)
    monkeypatch.setattr(SimulationProcess, "__init__", begin_and_note)
    yield
    for simulation in made:
        simulation.close()
