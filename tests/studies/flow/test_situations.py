"""Every situation is a scenario that SUMO loads and in which vehicles depart; signals wait for no player."""

import subprocess
from pathlib import Path

import pytest

from slrl_sumo.netgen.binaries import binary
from slrl_sumo.studies.flow.situations import SITUATIONS

WHEEL = ("city", "fkk_in", "cross", "grid6", "A10KW")
QUICK = [name for name, situation in SITUATIONS.items() if not situation.network]
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in SITUATIONS if name not in QUICK]


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_sumo_drives_every_situation(name: str, tmp_path: Path) -> None:
    config = SITUATIONS[name].build(tmp_path)
    trips = tmp_path / "trips.xml"
    command = [binary("sumo"), "-c", config, "--time-to-teleport", "-1", "--end", "60", "--no-step-log"]
    command += ["--tripinfo-output", trips, "--tripinfo-output.write-unfinished"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    if name not in WHEEL:  # its games have warnings of their own
        assert "Warning" not in done.stderr
    assert trips.read_text().count("<tripinfo ") >= 2


def test_signals_of_a_game_do_not_wait_for_a_player(tmp_path: Path) -> None:
    config = SITUATIONS["cross"].build(tmp_path)
    assert "signals0.add.xml" in config.read_text()
    signals = (tmp_path / "signals0.add.xml").read_text()
    assert 'duration="10000"' not in signals
    assert signals.count('duration="30"') >= 4
