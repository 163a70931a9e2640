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
"""Quantities, and their columns in the output of SUMO's tool."""


def emission_rates(emission_class: str, *, speed: Floats, acceleration: Floats) -> dict[str, Floats] | None:
    """Emissions and fuel of vehicles of a SUMO emission class in mg/s, (n,) each, by the names of POLLUTANTS.

    `speed`: m/s, `acceleration`: m/s², (n,), on level ground. From SUMO's tool emissionsDrivingCycle
    (https://sumo.dlr.de/docs/Tools/Emissions.html), which uses the models of a running SUMO. None for a class that is
    unknown or lacks its data (PHEMlight). Raises SumoError where the tool is missing.
    """
    if not len(speed):
        return {name: np.zeros(0) for name in POLLUTANTS}
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        cycle, result = Path(folder) / "cycle.csv", Path(folder) / "result.csv"
        # Rows are independent seconds: with a given acceleration, earlier rows have no effect.
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
        raise SumoError(f"SUMO's program {name} is missing; pip install eclipse-sumo")
    return path
