"""Learned road users inside SUMO: the SLRL method as a co-simulation package.

    result = slrl_sumo.run("district", agents=64, steps=150)
    result.summary
    result.trajectories.to_pandas()
    result.report("out/report")
    result.show()
    slrl_sumo.compare("district", out="out/compare", seeds=10).to_pandas()

    with slrl_sumo.Simulation("my.sumocfg", takeover={"car": 1}) as simulation:
        for decision in simulation:
            ...

    with slrl_sumo.attach(libsumo, takeover={"car": 0.3}) as learned:
        learned.step()

    env = gymnasium.make("slrl_sumo/Intersection-v0")
    env = slrl_sumo.parallel_env("intersection", agents=32)

The command line is `slrl-sumo`. docs/architecture.md describes the parts. Importing this package is cheap: torch,
libsumo and matplotlib are imported where they are used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from slrl_sumo.environment_ids import register_environments
from slrl_sumo.errors import DefectError, InputError, SlrlError, SumoError
from slrl_sumo.version import __version__

if TYPE_CHECKING:
    from slrl_sumo.api.comparison import Comparison, compare
    from slrl_sumo.api.result import RunResult
    from slrl_sumo.api.run import run
    from slrl_sumo.api.simulation import Simulation
    from slrl_sumo.api.summary import RunSummary, TypeSummary
    from slrl_sumo.formats.fcd.read import read_fcd
    from slrl_sumo.formats.trajectories import Trajectories
    from slrl_sumo.formats.trajectory_file import load_trajectories
    from slrl_sumo.learning.environments.make import parallel_env
    from slrl_sumo.models.bundle import load_bundle
    from slrl_sumo.simulation.attach import attach
    from slrl_sumo.simulation.region import BoxRegion, EdgesRegion, JunctionRegion
    from slrl_sumo.sumo.scenario import Scenario, find_scenario, shipped_scenarios

__all__ = [
    "BoxRegion",
    "Comparison",
    "DefectError",
    "EdgesRegion",
    "InputError",
    "JunctionRegion",
    "RunResult",
    "RunSummary",
    "Scenario",
    "Simulation",
    "SlrlError",
    "SumoError",
    "Trajectories",
    "TypeSummary",
    "__version__",
    "attach",
    "compare",
    "find_scenario",
    "load_bundle",
    "load_trajectories",
    "parallel_env",
    "read_fcd",
    "run",
    "shipped_scenarios",
]

_HOME = {
    "api.comparison": ("Comparison", "compare"),
    "api.result": ("RunResult",),
    "api.run": ("run",),
    "api.simulation": ("Simulation",),
    "api.summary": ("RunSummary", "TypeSummary"),
    "formats.fcd.read": ("read_fcd",),
    "formats.trajectories": ("Trajectories",),
    "formats.trajectory_file": ("load_trajectories",),
    "learning.environments.make": ("parallel_env",),
    "models.bundle": ("load_bundle",),
    "simulation.attach": ("attach",),
    "simulation.region": ("BoxRegion", "EdgesRegion", "JunctionRegion"),
    "sumo.scenario": ("Scenario", "find_scenario", "shipped_scenarios"),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"slrl_sumo.{module}"), name)
    raise AttributeError(f"module 'slrl_sumo' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__


register_environments()
