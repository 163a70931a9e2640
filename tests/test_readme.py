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
BLOCKS = [[line for line in block.splitlines() if line] for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)]
DATA = ROOT.parent / "shared" / "data"
"""Recordings that are not part of the project; commands that need them are run where they are at hand."""
NEED_DATA = {name: [block for block in BLOCKS if f"path/to/{name}" in "".join(block)] for name in ("hc", "sdd")}
COMMANDS = [line for block in BLOCKS for line in block if not any(block in needy for needy in NEED_DATA.values())]


def test_readme_has_commands() -> None:
    assert len(COMMANDS) >= 5
    assert all(command.startswith(".venv/bin/slrl-sumo ") for command in COMMANDS)


@pytest.mark.slow
def test_readme_commands_run_in_their_order(tmp_path: Path) -> None:
    scenario = Path(sumo.SUMO_HOME) / "tools" / "game" / "cross.sumocfg"
    run(COMMANDS, tmp_path, {"path/to/your.sumocfg": str(scenario)})


@pytest.mark.slow
@pytest.mark.parametrize("name", NEED_DATA)
def test_readme_commands_for_recordings_run_where_they_are(name: str, tmp_path: Path) -> None:
    (commands,) = NEED_DATA[name]
    assert [shlex.split(command)[1] for command in commands] == ["import", "fit", "evaluate"]
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is not there")
    run(commands, tmp_path, {f"path/to/{name}": str(DATA / name)})


def run(commands: list[str], folder: Path, places: dict[str, str]) -> None:
    """Run the commands one after another in a new folder; each must succeed and write what it was asked for."""
    (folder / "out").mkdir()
    for command in commands:
        real = command
        for text, place in places.items():
            real = real.replace(text, place)
        words = shlex.split(real)
        done = subprocess.run(
            [sys.executable, "-m", "slrl_sumo", *words[1:]],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        for option in ("--fcd", "--summary", "--out", "--report"):
            if option in words:
                assert (folder / words[words.index(option) + 1]).exists(), f"{command} did not write its {option}"


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
    if "gymnasium" in script:
        assert re.match(r"a bicycle at \d+\.\d m/s earned -?\d+\.\d\d: \{'close': ", done.stdout)
        return
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
