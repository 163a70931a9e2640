"""The study itself, as a process: short runs, taken up again, one that cannot be."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

TOOL = Path(__file__).parents[2] / "tools" / "takeover_study.py"


def study(tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(TOOL), "--json", "study.json", "--seeds", "1", "--seconds", "30", "--tail", "4"]
    return subprocess.run(
        [*command, "--markdown", *words], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )


def rows_of(tmp_path: Path) -> list[dict[str, Any]]:
    rows = json.loads((tmp_path / "study.json").read_text())["rows"]
    return sorted(rows, key=lambda row: (row["scenario"], row["selector"]))


def test_runs_are_kept_and_a_run_that_dies_takes_nobody_along(tmp_path: Path) -> None:
    done = study(tmp_path, "--scenarios", "signalised", "no-such-thing", "--selectors", "sumo,prior", "--pictures", "p")
    assert done.returncode == 0, done.stderr
    assert "died" in done.stderr
    died, also, prior, sumo = rows_of(tmp_path)
    assert "no-such-thing" in died["died"]
    assert "died" in also
    # The same road users are taken as are followed in sumo.
    assert prior["users"].keys() == sumo["users"].keys()
    assert prior["journeys"]["all"]["taken"] == len(prior["users"]) > 3
    assert prior["bundle"] == "intersection"
    assert prior["throughput"]["decisions"] == 74
    assert sumo["conduct"]["car"]["lane_distance_mean_m"] < 0.1 < prior["conduct"]["car"]["lane_distance_p95_m"]
    assert (tmp_path / "p" / "signalised-prior.png").stat().st_size > 20_000
    assert "| no-such-thing | sumo | 0 (1 died) | – |" in done.stdout
    assert "| signalised | prior | 1 |" in done.stdout
    again = study(tmp_path, "--scenarios", "signalised", "--selectors", "sumo", "prior")
    assert again.stderr == ""
    assert "| signalised | prior | 1 |" in again.stdout
    assert len(rows_of(tmp_path)) == 4
