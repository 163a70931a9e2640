"""The soak tool in short: every motion in two scenarios, with and without sublanes, each a process of its own."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
AGENT_STEPS = 20_000


def soak(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools.soak", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.slow
def test_no_crash_and_no_road_user_lost(tmp_path: Path) -> None:
    done = soak("--agent-steps", AGENT_STEPS, "--scenarios", "intersection", "cross", "--json", tmp_path / "soak.json")
    assert done.returncode == 0, done.stdout + done.stderr
    runs: list[dict[str, Any]] = json.loads((tmp_path / "soak.json").read_text())["runs"]
    cases = {(run["scenario"], run["motion"], run["sublane"]) for run in runs}
    assert len(cases) == 2 * 5 * 2
    assert sum(run["agent_steps"] for run in runs) >= AGENT_STEPS
    assert [run["command"] for run in runs if run["crashes"] or run["lost"] or run["teleports"]] == []
    for motion in ("prior", "lane", "random", "takeover", "takeover-random"):
        moved = [run for run in runs if run["motion"] == motion]
        assert sum(run["agent_steps"] for run in moved) >= 1000
        if motion.startswith("takeover"):
            assert sum(run["taken"] for run in moved) >= 20
        else:
            assert sum(run["jumps"] for run in moved) == 0


@pytest.mark.slow
def test_a_run_that_dies_is_counted_with_the_command_that_repeats_it(tmp_path: Path) -> None:
    words = ("--scenarios", tmp_path / "gone.sumocfg", "--motions", "prior", "--agent-steps", 10)
    done = soak(*words, "--json", tmp_path / "soak.json")
    assert done.returncode == 1
    assert "repeat it with: " in done.stdout
    run = json.loads((tmp_path / "soak.json").read_text())["runs"][0]
    assert run["crashes"] == 1
    assert "gone.sumocfg: no such file" in run["died"]
