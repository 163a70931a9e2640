"""A defect of the package: exit code 4, one line, and a file with the traceback."""

import json
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from slrl_sumo.api import run as outputs
from slrl_sumo.errors import DefectError
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.simulation.events import Event
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo import scenario

Cli = Callable[..., subprocess.CompletedProcess[str]]


def reported(done: subprocess.CompletedProcess[str]) -> str:
    """The content of the file that the one line names."""
    assert done.returncode == 4, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("slrl-sumo: a defect of slrl_sumo (")
    found = re.search(r"please report it with (.+), which holds the traceback$", line)
    assert found is not None
    return Path(found[1]).read_text()


def test_the_traceback_is_in_the_current_folder(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise KeyError("one\ntwo")

    monkeypatch.setattr(scenario, "shipped_scenarios", broken)
    done = cli("scenarios", cwd=tmp_path)
    assert "(KeyError: 'one\\ntwo')" in done.stderr
    text = reported(done)
    assert [str(file) in done.stderr for file in tmp_path.iterdir()] == [True]
    assert text.startswith("a defect of slrl_sumo")
    assert "command: slrl-sumo scenarios" in text
    assert "libsumo 1" in text
    assert "in broken" in text


def test_where_the_current_folder_takes_no_file_the_temporary_one_does(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, temporary = tmp_path / "removed", tmp_path / "temporary"
    folder.mkdir()
    temporary.mkdir()

    def broken() -> None:
        folder.rmdir()
        raise ValueError

    monkeypatch.setattr(scenario, "shipped_scenarios", broken)
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(temporary))
        done = cli("scenarios", cwd=folder)
    assert "(ValueError)" in reported(done)
    assert len(list(temporary.iterdir())) == 1


@pytest.mark.parametrize("where", ["simulation", "summary"])
def test_outputs_of_a_run_end_at_the_last_whole_step(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """A defect in the process of SUMO, and one in the process that writes the outputs."""

    def events(settings: RunSettings, *words: Any, **options: Any) -> Iterator[Event]:
        for number, event in enumerate(run(settings)):
            if where == "simulation" and number == 4:
                raise DefectError("a defect of slrl_sumo (TypeError: in the child)", "the child's traceback")
            yield event

    add, added = RunCounters.add, list[object]()

    def failing(self: RunCounters, decision: Any) -> None:
        added.append(decision)
        if where == "summary" and len(added) == 4:
            raise TypeError
        add(self, decision)

    monkeypatch.setattr(outputs, "run_isolated", events)
    monkeypatch.setattr(RunCounters, "add", failing)
    words = ("--agents", 3, "--steps", 9, "--step-length", 0.4, "--fcd", "a.xml", "--summary", "s.json", "--quiet")
    text = reported(cli("run", "intersection", *words, cwd=tmp_path))
    assert ("the child's traceback" if where == "simulation" else "in failing") in text
    decisions = json.loads((tmp_path / "s.json").read_text())["decisions"]
    assert decisions == 3
    assert len(etree.parse(tmp_path / "a.xml").getroot()) == (4 if where == "simulation" else 5)
