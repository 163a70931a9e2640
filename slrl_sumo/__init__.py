"""Learned road users inside SUMO: the SLRL method as a co-simulation package.

The command line is `slrl-sumo`; the parts are described in docs/architecture.md.
Importing this package is cheap: torch, libsumo and matplotlib are imported where they are used.
"""

__version__ = "0.1.0"
