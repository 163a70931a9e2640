"""The scenarios that ship in sumo_scenarios/, and the program that makes them again (COMMAND)."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.scenario import write_scenario
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec, NetSpec, RandomSpec, SharedSpaceSpec

COMMAND = "python -m slrl_sumo.netgen.shipped"

SHIPPED: Mapping[str, tuple[NetSpec, DemandSpec]] = {
    "intersection": (
        IntersectionSpec(arm_length=95.0),
        DemandSpec(cars_per_hour=550.0, bicycles_per_hour=180.0, pedestrians_per_hour=240.0, seed=1),
    ),
    "signalised": (
        IntersectionSpec(lanes=2, control="traffic_light", arm_length=100.0),
        DemandSpec(cars_per_hour=800.0, bicycles_per_hour=200.0, pedestrians_per_hour=300.0, seed=4),
    ),
    "shared-space": (
        SharedSpaceSpec(corner_radius=10.0, arm_length=85.0),
        DemandSpec(cars_per_hour=180.0, bicycles_per_hour=180.0, pedestrians_per_hour=450.0, seed=11),
    ),
    "district": (
        RandomSpec(iterations=12, street_length=95.0, two_lane_share=0.2, signal_share=0.4, seed=8),
        DemandSpec(cars_per_hour=600.0, bicycles_per_hour=220.0, pedestrians_per_hour=350.0, seed=8),
    ),
}
"""Net and demand of each shipped scenario, by the name of its folder.

With these seeds a plain run has no warnings; with others SUMO warns of up to three emergency brakings for pedestrians.
"""


def write_shipped(out: Path) -> list[Path]:
    """Write every shipped scenario to its folder under `out`; returns the paths of the .sumocfg files.

    Raises NetgenError as `write_scenario` does.
    """
    return [write_scenario(spec, demand, out / name, COMMAND) for name, (spec, demand) in SHIPPED.items()]


def main(arguments: Sequence[str] | None = None) -> int:
    """The program: exit code 1 and one line on stderr when it fails."""
    parser = argparse.ArgumentParser(prog=COMMAND, description="Make the shipped scenarios again.")
    here = Path(str(files("slrl_sumo.scenarios"))).resolve()
    parser.add_argument("--out", type=Path, default=here, help="folder to write to (default: %(default)s)")
    try:
        made = write_shipped(parser.parse_args(arguments).out)
    except NetgenError as e:
        print(f"Error: {e}", file=sys.stderr)
        return 1
    print("\n".join(str(path) for path in made))
    return 0


if __name__ == "__main__":
    sys.exit(main())
