"""The study itself, as a process: short runs, continued from its log, with one that fails."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]


def study(tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "benchmarks.takeover.study", "--log", "study.jsonl", "--markdown"]
    command += ["--seeds", "1", "--seconds", "30", "--tail", "4", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=300
    )


def rows_of(tmp_path: Path) -> list[dict[str, Any]]:
    _, *lines = (tmp_path / "study.jsonl").read_text().splitlines()
    return sorted(map(json.loads, lines), key=lambda row: (row["scenario"], row["selector"]))


CONFIG = """<configuration><input><net-file value="intersection.net.xml"/><route-files value="bad.rou.xml"/></input>
<time><begin value="0"/><step-length value="0.4"/></time>
<processing><route-steps value="2"/></processing></configuration>"""
ROUTES = """<routes><vehicle id="a" depart="1"><route edges="in0 out1"/></vehicle>
<vehicle id="b" depart="9"><route edges="in0 nowhere"/></vehicle></routes>"""


@pytest.mark.slow
def test_runs_are_kept_and_a_run_that_fails_does_not_stop_the_others(tmp_path: Path) -> None:
    # SUMO reads routes as it goes, and gives up at the second one.
    shutil.copy(ROOT / "sumo_scenarios" / "intersection" / "intersection.net.xml", tmp_path)
    (tmp_path / "bad.sumocfg").write_text(CONFIG)
    (tmp_path / "bad.rou.xml").write_text(ROUTES)
    words = ("--scenarios", "signalised", "bad.sumocfg", "--selectors", "sumo,prior")
    done = study(tmp_path, *words, "--pictures", "p")
    assert done.returncode == 0, done.stderr
    assert "bad.sumocfg sumo seed 1: failed: " in done.stderr
    failed, also, prior, sumo = rows_of(tmp_path)
    assert "nowhere" in failed["failed"]
    assert "failed" in also
    # The road users that are taken over are those that are followed in sumo.
    assert prior["users"].keys() == sumo["users"].keys()
    assert prior["trip_outcomes"]["all"]["taken"] == len(prior["users"]) > 3
    assert prior["bundle"] == "intersection"
    assert prior["throughput"]["decisions"] == 74
    assert sumo["driving_stats"]["car"]["lane_distance_mean_m"] < 0.1
    assert prior["driving_stats"]["car"]["lane_distance_p95_m"] > 0.1
    assert sumo["hand_back"]["jumps"] == 0
    assert sumo["hand_back"]["hard_braking_after_per_1000_s"] is None
    assert prior["hand_back"]["hard_braking_after_per_1000_s"] is not None
    assert (tmp_path / "p" / "signalised-prior.png").stat().st_size > 20_000
    assert "| bad.sumocfg | sumo | 0 (1 failed) | – |" in done.stdout
    assert "| signalised | prior | 1 |" in done.stdout
    again = study(tmp_path, "--scenarios", "signalised", "--selectors", "sumo", "prior")
    assert again.stderr == ""
    assert "| signalised | prior | 1 |" in again.stdout
    assert len(rows_of(tmp_path)) == 4
