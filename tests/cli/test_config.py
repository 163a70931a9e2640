"""`run --config`: options from a TOML file, and a run repeated from its summary."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import slrl_sumo

Cli = Callable[..., "subprocess.CompletedProcess[str]"]

FILE = """
scenario = "intersection"
agents = 3
steps = 5
takeover = { car = 1, bicycle = 0.5 }
without = ["deadlock_release"]
background-yields = false
fcd = "a.csv"
summary = "a.json"
"""


def test_a_run_is_repeated_from_its_summary(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text(FILE)
    first = cli("run", "--config", "run.toml", "--seed", 4, cwd=tmp_path)
    assert (first.returncode, first.stderr) == (0, "")
    summary = json.loads((tmp_path / "a.json").read_text())
    options = summary["options"]
    assert {key: options[key] for key in ("scenario", "agents", "steps", "takeover", "seed", "background_yields")} == {
        "scenario": "intersection",
        "agents": 3,
        "steps": 5,
        "takeover": "car=1,bicycle=0.5",
        "seed": 4,
        "background_yields": False,
    }
    assert (options["bundle"], options["selector"], options["without"]) == ("intersection", None, ["deadlock_release"])
    assert (options["fcd"], options["summary"], options["report"]) == ("a.csv", "a.json", None)

    again = cli("run", "--config", "a.json", "--fcd", "b.csv", "--summary", "b.json", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()
    repeated = json.loads((tmp_path / "b.json").read_text())["options"]
    assert {key for key in options if options[key] != repeated[key]} == {"fcd", "summary"}

    files = ("fcd", "summary", "report", "recording")
    in_python = slrl_sumo.run(**{key: value for key, value in options.items() if key not in files})
    assert in_python.summary.options | {key: options[key] for key in files} == options


def test_options_of_python_objects_are_plain_values() -> None:
    from slrl_sumo.simulation.settings import RunSettings

    settings = RunSettings(
        "district",
        takeover={"car": 0.25, "pedestrian": 1},
        region=slrl_sumo.JunctionRegion("C", 50.0),
        bundle=Path("mine"),
    )
    options = settings.options()
    assert json.loads(json.dumps(options)) == options
    assert RunSettings(**options).options() == options
    assert (options["takeover"], options["region"]) == ("car=0.25,pedestrian=1", "junction:C,radius=50")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("agnets = 3", "there is no option 'agnets'; is it agents?"),
        ("agents = true", "agents is true: give a whole number"),
        ("agents = 2.5", "agents is 2.5: give a whole number"),
        ('until = "noon"', 'until is "noon": give a number'),
        ("guard = 1", "guard is 1: give true or false"),
        ('without = "guard"', 'without is "guard": give a list of texts'),
        ("mix = 3", "mix is 3: give a text in quotes"),
        ("agents = ", "is no TOML"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(cli: Cli, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "run.toml").write_text(text)
    done = cli("run", "intersection", "--config", "run.toml", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("slrl-sumo: run.toml: ")
    assert words in line


def test_files_that_hold_no_options_are_refused(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text("[3]")
    for name, words in (("gone.toml", "cannot be read"), ("other.json", "no summary of a run")):
        done = cli("run", "intersection", "--config", name, cwd=tmp_path)
        assert done.returncode == 1
        assert f"{name}: " in done.stderr
        assert words in done.stderr
