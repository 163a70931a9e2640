"""Generated towns: random street networks with signals, priority junctions and several lanes, and their demand."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from netgen.binaries import run_program
from netgen.errors import NetgenError
from slrl_sumo.studies.flow.scenario_files import write_config

REST = 300.0
"""s at the end of a run without departures, for the vehicles that are still under way."""


def town(seed: int, *, streets: int, seconds: float, period: float) -> Callable[[Path], Path]:
    """Builds a town from `seed`.

    `streets`: how often a street is added; `seconds`: length of the run; `period`: s between two departures.
    """

    def build(folder: Path) -> Path:
        options = ["--rand", "--rand.iterations", str(streets), "--rand.max-distance", "220"]
        options += ["--rand.min-distance", "132", "--rand.min-angle", "50", "-L", "2", "--random-lanenumber"]
        options += ["--tls.guess", "--tls.guess.threshold", "50", "--sidewalks.guess", "--crossings.guess"]
        options += ["--no-turnarounds.except-deadend", "--seed", str(seed), "--no-warnings"]
        run_program("netgenerate", [*options, "--output-file", "flow.net.xml"], folder)
        write_trips(folder, seed, seconds - REST, period)
        return write_config(folder, seconds)

    return build


def write_trips(folder: Path, seed: int, seconds: float, period: float) -> None:
    """flow.rou.xml for flow.net.xml by SUMO's randomTrips.py: five times as many trips begin and end at the rim.

    `seconds`: in which vehicles depart, one every `period` s. Raises NetgenError where it fails.
    """
    import sumo

    home = Path(sumo.SUMO_HOME)
    command = [sys.executable, str(home / "tools" / "randomTrips.py"), "-n", "flow.net.xml", "-e", f"{seconds:g}"]
    command += ["-p", f"{period:g}", "--seed", str(seed), "--fringe-factor", "5", "--validate"]
    command += ["-o", "flow.trips.xml", "-r", "flow.rou.xml"]
    environment = {**os.environ, "SUMO_HOME": str(home)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise NetgenError(f"randomTrips.py failed (exit code {done.returncode}): {done.stderr.strip()[-300:]}")
