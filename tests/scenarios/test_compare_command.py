"""`compare`: the same figures whatever happens on the way, and clear words where something is wrong."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.studies.compare.comparison import ComparisonSettings, compare
from slrl_sumo.studies.compare.report import CONFLICT_COLUMNS
from slrl_sumo.studies.compare.tables import columns

Cli = Callable[..., subprocess.CompletedProcess[str]]
SMALL = ("signalised", "--bundle", "intersection", "--seeds", "2", "--seconds", "100")


@pytest.fixture(scope="module")
def compared(cli: Cli, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """SMALL with two workers: the folder and what was printed."""
    folder = tmp_path_factory.mktemp("compared")
    done = cli("compare", *SMALL, "--out", folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def values(folder: Path) -> dict[tuple[str, str], dict[str, Any]]:
    rows = json.loads((folder / "results.json").read_text())["rows"]
    return {(row["measure"], row["type"]): row for row in rows}


def test_both_arms_have_the_same_demand_and_one_is_learned(compared: tuple[Path, str]) -> None:
    folder, _ = compared
    found = values(folder)
    assert found["learned", "all"]["sumo"] == 0.0
    assert 90.0 < found["learned", "all"]["learned"] <= 100.0
    lines = [json.loads(line) for line in (folder / "runs.jsonl").read_text().splitlines()[1:]]
    assert {(line["seed"], line["arm"]) for line in lines} == {(s, arm) for s in (1, 2) for arm in ("sumo", "learned")}
    for seed in (1, 2):
        plain, learned = (
            {i: (t[0], t[1]) for i, t in x["record"]["trips"].items()} for x in lines if x["seed"] == seed
        )
        assert plain == learned
    # Learned cars take as long as SUMO's, within a tenth.
    assert found["travel_time", "car"]["seeds"] == 2
    assert 5.0 < found["travel_time", "car"]["sumo"] < 60.0
    assert found["travel_time", "car"]["learned"] == pytest.approx(found["travel_time", "car"]["sumo"], rel=0.1)
    assert 200.0 < found["co2_per_km", "all"]["learned"] < 600.0


def test_what_is_written(compared: tuple[Path, str]) -> None:
    folder, printed = compared
    with open(folder / "results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == columns()
    speed = values(folder)["speed", "car"]
    (line,) = (row for row in rows if (row["measure"], row["type"]) == ("speed", "car"))
    assert (float(line["difference_low"]), line["unit"]) == (speed["difference_low"], "m/s")
    assert f"{speed['sumo']:.2f}" in printed
    with open(folder / "conflicts.csv", newline="") as file:
        conflicts = list(csv.DictReader(file))
    assert tuple(conflicts[0]) == CONFLICT_COLUMNS
    counted = sum(row["measure"] == "ttc" and row["arm"] == "sumo" for row in conflicts)
    assert counted == 2 * values(folder)["ttc", "all"]["sumo"]
    assert (folder / "comparison.png").stat().st_size > 20_000
    page = (folder / "comparison.html").read_text(encoding="utf-8")
    assert f"<td>{speed['sumo']:.2f}</td><td>{speed['learned']:.2f}</td>" in page
    assert page.count("<svg") == len(
        {name for (name, _), row in values(folder).items() if any(any(p.values()) for p in row["by_seed"].values())}
    )
    assert not re.search(r"(src|href)=|NaN|None", page)
    few = sum(row["verdict"] == "too few seeds" for row in values(folder).values())
    assert f"2 seeds are too few for {few} of {len(rows)} lines" in page
    assert f"2 seeds are too few for {few} of {len(rows)} lines" in printed


@pytest.mark.slow
def test_a_comparison_that_was_cut_off_goes_on_and_says_the_same(
    compared: tuple[Path, str], cli: Cli, tmp_path: Path
) -> None:
    folder, _ = compared
    lines = (folder / "runs.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "runs.jsonl").write_bytes(b"".join(lines[:3]) + lines[3][:100])
    done = cli("compare", *SMALL, "--out", tmp_path, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results.json").read_bytes() == (folder / "results.json").read_bytes()
    assert (tmp_path / "runs.jsonl").read_bytes().splitlines(keepends=True)[:3] == lines[:3]


def test_excluded_ids_that_no_run_had_are_noted(tmp_path: Path) -> None:
    settings = ComparisonSettings("signalised", "intersection", seeds=1, steps=5, exclude=["moon"], selector="lane")
    result, _ = compare(settings, tmp_path)
    assert "exclude: no road user had one of the ids moon" in result["notices"]
    again, _ = compare(settings, tmp_path)
    assert again == result


def test_runs_of_other_settings_are_not_mixed(compared: tuple[Path, str], tmp_path: Path) -> None:
    (tmp_path / "runs.jsonl").write_bytes((compared[0] / "runs.jsonl").read_bytes())
    settings = ComparisonSettings("signalised", "intersection", seeds=2, seconds=100.0)
    expected = r"of other settings \(guard False, not True\); name another --out, or delete it"
    with pytest.raises(InputError, match=expected):
        compare(replace(settings, guard=True), tmp_path)
    (tmp_path / "runs.jsonl").write_text("{broken\n")
    with pytest.raises(InputError, match="is damaged or something else"):
        compare(settings, tmp_path)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"takeover": "tram=1"}, "'tram' is no road user type"),
        ({"selector": "best"}, "--selector best: there is none of that name"),
        ({"seeds": 0}, "--seeds 0: give a whole number"),
        ({"seed": -1}, "--seed -1: give a whole number"),
        ({"steps": 5, "seconds": 2.0}, "--steps and --seconds were both given"),
        ({"steps": 0}, "--steps 0: at least one"),
        ({"seconds": float("nan")}, "--seconds nan: give a number above 0"),
        ({"step_length": 0.3}, "no multiple of it"),
        ({"guard": True, "selector": "lane"}, "chooses no modes"),
        ({"bundle": "nowhere"}, "nowhere"),
        ({"scenario": "nowhere"}, "nowhere: no such file"),
    ],
)
def test_wrong_input_is_told_before_anything_is_written(tmp_path: Path, given: dict[str, Any], expected: str) -> None:
    settings = replace(ComparisonSettings("signalised", "intersection"), **given)
    with pytest.raises(InputError, match=expected):
        compare(settings, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_region_that_is_not_there_is_told_by_the_first_run(cli: Cli, tmp_path: Path) -> None:
    done = cli("compare", *SMALL, "--out", tmp_path / "out", "--region", "junction:moon,radius=5")
    assert (done.returncode, done.stdout) == (1, "")
    assert "moon" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_finished(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "slrl_sumo", "compare", *SMALL[:3], "--seeds", "40", "--seconds", "12"]
    process = subprocess.Popen(
        [*command, "--workers", "1", "--out", str(tmp_path)], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    log = tmp_path / "runs.jsonl"
    while not log.exists() or log.read_bytes().count(b"\n") < 3:
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == "interrupted: the same command continues after the finished runs\n"
    kept = [json.loads(line) for line in log.read_text().splitlines()[1:]]
    assert 2 <= len(kept) < 80
    assert not (tmp_path / "results.json").exists()
