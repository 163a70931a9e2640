"""Every command and script of docs/analysis.md works as it stands there, and its tables hold what there is."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from slrl_sumo.studies.compare.measures import MEASURES

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "analysis.md").read_text(encoding="utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines() if line]


@pytest.mark.slow
def test_commands_and_scripts_run_in_their_order(tmp_path: Path) -> None:
    assert [shlex.split(command)[1] for command in COMMANDS] == ["run", "record", "run", "compare"]
    (tmp_path / "out").mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for command in COMMANDS:
        words = shlex.split(command)
        called = [sys.executable, "-m", "slrl_sumo", *words[1:]]
        done = subprocess.run(called, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        for option in ("--out", "--report"):
            if option in words:
                assert (tmp_path / words[words.index(option) + 1]).exists(), f"{command} did not write its {option}"
    against = (tmp_path / "out" / "against" / "report.html").read_text(encoding="utf-8")
    assert "Compared with SUMO traffic of scenario signalised, seed 1" in against
    (script,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    first, *others = done.stdout.splitlines()
    assert re.match(rf"{len(others)} conflicts with a TTC below 1.5 s, \d+ with a PET below 1 s$", first)


def test_the_table_of_measures_is_whole() -> None:
    named = {name for line in PAGE.splitlines() if line.startswith("| `") for name in re.findall(r"`(\w+)`", line)}
    assert {measure.name for measure in MEASURES} <= named
