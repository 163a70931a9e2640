"""Learned road users inside SUMO: the SLRL method as a co-simulation package.

The command line is `slrl-sumo`; inside a script of your own there is `slrl_sumo.attach`. The parts are described in
docs/architecture.md. Importing this package is cheap: torch, libsumo and matplotlib are imported where they are used.
"""

from typing import TYPE_CHECKING, Any

from slrl_sumo.version import __version__

if TYPE_CHECKING:
    from slrl_sumo.simulation.attach import attach

__all__ = ["__version__", "attach"]


def __getattr__(name: str) -> Any:
    if name == "attach":
        from slrl_sumo.simulation.attach import attach

        return attach
    raise AttributeError(f"module 'slrl_sumo' has no attribute '{name}'")
