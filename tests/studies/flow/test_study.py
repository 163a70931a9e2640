"""`bench --flow`: the runs, what is printed and written, and clear words where something is wrong."""

import csv
import json
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.studies.flow.figures import FIGURES
from slrl_sumo.studies.flow.run import SUMO, Run, learned_shares, run_case
from slrl_sumo.studies.flow.study import FlowSettings, measure_flow

Cli = Callable[..., subprocess.CompletedProcess[str]]


def test_lane_following_starts_as_sumos_own_cars(cli: Cli, tmp_path: Path) -> None:
    words = ("--only", "start-car", "--selectors", "lane", "--workers", "1", "--out", tmp_path / "o")
    done = cli("bench", "--flow", *words)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "o" / "results.json").read_text())
    found = {(row["figure"], row["arm"]): row for row in result["rows"]}
    assert found["finished", SUMO]["value"] == found["departed", SUMO]["value"] == 9
    # Krauss: 13.2 m/s with 2.6 m/s² take 5.1 s.
    assert found["start", SUMO]["value"] == pytest.approx(5.2, abs=0.21)
    assert found["held", SUMO]["value"] > 98.0
    assert found["start", "lane"]["ratio"] == pytest.approx(1.0, abs=0.1)
    assert found["travel_time", "lane"]["ratio"] == pytest.approx(1.0, abs=0.05)
    for name in ("finished", "start"):
        assert f"{FIGURES[name].title}: {FIGURES[name].definition}" in done.stdout
    with open(tmp_path / "o" / "results.csv", newline="") as file:
        assert len(list(csv.DictReader(file))) == len(result["rows"])
    assert (tmp_path / "o" / "fundamental_diagram.png").read_bytes().startswith(b"\x89PNG")
    # The same command again needs no simulation.
    (tmp_path / "o" / "results.json").unlink()
    again, _ = measure_flow(FlowSettings(only=("start-car",), selectors=("lane",)), tmp_path / "o")
    assert again["rows"] == result["rows"]
    assert len((tmp_path / "o" / "runs.jsonl").read_text().splitlines()) == 3


def test_a_queue_of_sumos_cars_discharges_with_the_saturation_flow_of_its_drivers() -> None:
    record = run_case("intersection", 1.0, Run("queue", SUMO, 1))
    assert 1900.0 < record["figures"]["saturation_flow"] < 2150.0
    assert record["figures"]["red_runs"] == 0.0
    assert record["figures"]["under_way"] == record["figures"]["departed"] - record["figures"]["finished"]
    assert len(record["under_way_by_minute"]) == 6


def test_only_types_that_the_bundle_has_models_for_are_learned() -> None:
    bundle = load_bundle("intersection")
    counts = bundle.mode_counts.copy()
    counts[RoadUserType.BICYCLE] = 0
    without_bicycles = replace(bundle, mode_counts=counts)
    assert learned_shares(without_bicycles, "greedy", 0.3).tolist() == [0.3, 0.0, 0.3]
    assert learned_shares(without_bicycles, "lane", 0.3).tolist() == [0.3, 0.3, 0.3]


@pytest.mark.parametrize(
    ("settings", "argument"),
    [
        ({"only": ("highway",)}, "only"),
        ({"selectors": ("best",)}, "selector"),
        ({"selectors": ("lane+guard",)}, "selectors"),
        ({"share": 0.0}, "share"),
        ({"seeds": 0}, "seeds"),
    ],
)
def test_wrong_settings_are_named(settings: dict[str, Any], argument: str) -> None:
    with pytest.raises(InputError) as error:
        measure_flow(FlowSettings(**settings), None)
    assert error.value.argument == argument


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--flow", "--agents", "4"], "--agents: belongs to a measurement of throughput; leave --flow out"),
        (["--only", "queue"], "--only: belongs to --flow; add it"),
        (["--flow", "--networks", "--only", "queue"], "both given"),
    ],
)
def test_options_of_the_other_measurement_are_refused(words: list[str], said: str, cli: Cli) -> None:
    done = cli("bench", *words)
    assert done.returncode == 1
    assert said in done.stderr
