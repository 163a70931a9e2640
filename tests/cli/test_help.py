"""What `slrl-sumo` tells of itself: help, completion, log, scenarios, tables in pipes."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.table import Table

from slrl_sumo.cli.app import app
from slrl_sumo.jobs.tables import table_text
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.sumo.scenario import shipped_scenarios

Cli = Callable[..., "subprocess.CompletedProcess[str]"]

COMMANDS = [info.name or getattr(info.callback, "__name__", "") for info in app.registered_commands]


@pytest.mark.parametrize("command", COMMANDS)
def test_flags_look_like_flags_and_values_have_names(cli: Cli, command: str) -> None:
    text = cli(command, "--help").stdout
    assert text.startswith(f"Usage: slrl-sumo {command} ")
    assert not re.search(r"[│╭╰─]", text)
    assert not re.search(r"<bool>|<list", text.partition("\nOptions:")[2])
    assert "-v, --verbose" in text
    for flag in re.findall(r"--(?:no-)?(?:resume|guard|quiet|gui|flow|networks|sumo-outputs|verbose)\b.*", text):
        assert "<" not in flag
    assert "--no-quiet" not in text


def test_defaults_that_depend_are_in_the_help(cli: Cli) -> None:
    text = " ".join(cli("run", "--help").stdout.split())
    assert "[default: greedy, or rule for a bundle without a trained selector]" in text
    assert "[default: to the scenario's end, or until its road users have left]" in text
    for command in ("run", "evaluate", "compare", "train", "bench"):
        assert f"[default: {DEFAULT_BUNDLE}]" in " ".join(cli(command, "--help").stdout.split())


def test_without_words_it_prints_its_help(cli: Cli) -> None:
    done = cli()
    assert "Traceback" not in done.stderr
    assert "compare" in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("slrl-sumo ", {"run", "compare", "scenarios"}),
        ("slrl-sumo run s", {"shared-space", "signalised"}),
        ("slrl-sumo run district --bundle ", {"intersection", "shared-space"}),
        ("slrl-sumo run district --re", {"--region", "--report", "--recording"}),
    ],
)
def test_shells_complete_commands_scenarios_bundles_and_options(line: str, found: set[str]) -> None:
    words = {"_SLRL_SUMO_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    program = "import sys; sys.argv = ['slrl-sumo']; from slrl_sumo.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **words}, capture_output=True, text=True, timeout=60
    )
    assert done.stderr == ""
    assert found <= set(done.stdout.split())


def test_scenarios_are_described_and_drawn(cli: Cli, tmp_path: Path) -> None:
    lines = cli("scenarios").stdout.splitlines()
    assert [line.split()[0] for line in lines] == shipped_scenarios()
    for line in lines:
        assert re.search(r"Per hour \d+ cars, \d+ bicycles and \d+ pedestrians; \d+ s\.$", line)
    done = cli("scenarios", "signalised", "--draw", "map.png", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [" ".join(lines[-1].split(maxsplit=1)).replace(" ", "  ", 1), "map.png"]
    assert (tmp_path / "map.png").stat().st_size > 10_000
    for words, message in (
        (["--draw", "a.png"], "name the scenario"),
        (["district", "--draw", "a.txt"], "ends in .png"),
        (["nowhere"], "no such file"),
    ):
        refused = cli("scenarios", *words, cwd=tmp_path)
        assert refused.returncode == 1
        assert message in refused.stderr


def test_verbose_logs_the_steps_of_a_run(cli: Cli) -> None:
    done = cli("run", "intersection", "--agents", 2, "--steps", 2, "--quiet", "-v")
    assert (done.returncode, done.stdout) == (0, "")
    assert re.search(r"\d\d:\d\d:\d\d slrl_sumo\.api\.run: scenario .*intersection\.sumocfg", done.stderr)
    assert "SUMO runs in steps of 0.4 s" in done.stderr


def test_tables_in_pipes_are_plain_text() -> None:
    table = Table(title="a title")
    table.add_column("name")
    table.add_column("value", justify="right")
    table.add_row("one", "1.5")
    table.add_section()
    table.add_row("eleven", "10")
    assert [line.split() for line in table_text(table).splitlines()][-3:] == [
        ["name", "value"],
        ["one", "1.5"],
        ["eleven", "10"],
    ]
    assert "a title" in table_text(table)
    assert table_text(table).isascii()


def test_a_window_needs_a_display(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    done = cli("run", "intersection", "--agents", 2, "--steps", 2, "--gui")
    assert done.returncode == 1
    assert "--gui: there is no display" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="no Xvfb")
def test_a_run_in_the_window_of_sumo_gui_is_the_same(tmp_path: Path) -> None:
    words = ["run", "intersection", "--agents", "4", "--steps", "10", "--quiet"]
    for name, before, more in (("a", [], []), ("b", ["xvfb-run", "-a"], ["--gui"])):
        command = [*before, sys.executable, "-m", "slrl_sumo", *words, *more, "--fcd", f"{name}.csv"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
