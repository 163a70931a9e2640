"""Emissions of vehicles by SUMO's own models, from their speeds."""

import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from slrl_sumo.errors import SumoError
from slrl_sumo.scene.geometry import Floats

POLLUTANTS = {"co2": 5, "pmx": 7, "nox": 8, "fuel": 9}
"""What is asked for, and its column in what SUMO's tool writes."""


def emission_rates(emission_class: str, *, speed: Floats, acceleration: Floats) -> dict[str, Floats] | None:
    """Emissions and fuel of vehicles of a SUMO emission class in mg/s, (n,) each, by the names of POLLUTANTS.

    `speed`: m/s, `acceleration`: m/s², (n,), on level ground. From SUMO's tool emissionsDrivingCycle
    (https://sumo.dlr.de/docs/Tools/Emissions.html), which computes as a running SUMO does. None for a class that it
    does not know or lacks the data for (PHEMlight). Raises SumoError where the tool is not there.
    """
    if not len(speed):
        return {name: np.zeros(0) for name in POLLUTANTS}
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        cycle, result = Path(folder) / "cycle.csv", Path(folder) / "result.csv"
        # A row is one second of its own: what came before it does not matter where the acceleration is given.
        np.savetxt(cycle, np.column_stack([np.arange(len(speed)), speed, acceleration]), "%.9g", ";")
        done = subprocess.run(
            [_tool(), "-t", cycle, "--timeline-file.separator", ";", "-e", emission_class, "-o", result],
            capture_output=True,
            check=False,
        )
        if done.returncode:
            return None
        table = np.loadtxt(result, delimiter=";", ndmin=2)
    return {name: table[:, column] for name, column in POLLUTANTS.items()}


@functools.cache
def _tool() -> str:
    name = "emissionsDrivingCycle"
    import sumo

    found = Path(sumo.SUMO_HOME) / "bin" / name
    path = str(found) if found.is_file() else shutil.which(name)
    if path is None:
        raise SumoError(f"SUMO's program {name} is not there; pip install eclipse-sumo")
    return path
