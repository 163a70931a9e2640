"""Every situation is a scenario that SUMO loads and in which vehicles depart."""

import subprocess
from pathlib import Path

import pytest

from netgen.binaries import binary
from slrl_sumo.studies.flow.situations import SITUATIONS

QUICK = [name for name, situation in SITUATIONS.items() if not situation.network]
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in SITUATIONS if name not in QUICK]


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_sumo_drives_a_situation_without_a_warning(name: str, tmp_path: Path) -> None:
    config = SITUATIONS[name].build(tmp_path)
    trips = tmp_path / "trips.xml"
    command = [binary("sumo"), "-c", config, "--time-to-teleport", "-1", "--end", "60", "--no-step-log"]
    command += ["--tripinfo-output", trips, "--tripinfo-output.write-unfinished"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert trips.read_text().count("<tripinfo ") >= 2
