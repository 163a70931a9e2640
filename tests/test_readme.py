"""Every command of the README works as it stands there."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import sumo

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) for line in block.splitlines() if line]


def test_readme_has_commands() -> None:
    assert len(COMMANDS) >= 5
    assert all(command.startswith(".venv/bin/slrl-sumo ") for command in COMMANDS)


@pytest.mark.slow
def test_readme_commands_run_in_their_order(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    scenario = Path(sumo.SUMO_HOME) / "tools" / "game" / "cross.sumocfg"
    for command in COMMANDS:
        words = shlex.split(command.replace("path/to/your.sumocfg", str(scenario)))
        done = subprocess.run(
            [sys.executable, "-m", "slrl_sumo.cli", *words[1:]],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        for option in ("--fcd", "--summary", "--out", "--report"):
            if option in words:
                assert (tmp_path / words[words.index(option) + 1]).exists(), f"{command} did not write its {option}"


@pytest.mark.parametrize("script", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_readme_scripts_run(script: str, tmp_path: Path) -> None:
    scenario = ROOT / "sumo_scenarios" / "district" / "district.sumocfg"
    done = subprocess.run(
        [sys.executable, "-c", script.replace("path/to/your.sumocfg", str(scenario))],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    learned, everybody = re.findall(r"^(\d+) of (\d+) road users are learned$", done.stdout, re.MULTILINE)[0]
    assert 5 < int(learned) < int(everybody)


def test_make_targets_of_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^    make (\w+)$", README, re.MULTILINE)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}\b.*:", makefile, re.MULTILINE)


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))])
def test_links_of_pages_lead_somewhere(page: str) -> None:
    file = ROOT / page
    for target in re.findall(r"\]\(([^)#:]+)\)", file.read_text(encoding="utf-8")):
        assert (file.parent / target).exists(), f"{page}: {target}"
