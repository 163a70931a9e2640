"""`compare --traces`: figures of two traces, beside those of the runs that they are of."""

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumo
from builders import make_recording

from slrl_sumo.metrics.traffic.trips import trips_of_trace
from slrl_sumo.studies.compare.run import SUMO, ComparedScenario, Run, run_comparison
from slrl_sumo.studies.compare.tables import rows
from slrl_sumo.sumo.net_file import find_net

Cli = Callable[..., subprocess.CompletedProcess[str]]
NET, SCENARIO = find_net("signalised")


def sumo_trace(folder: Path, seed: int) -> Path:
    assert SCENARIO is not None
    file = folder / f"sumo-{seed}.xml"
    command = [Path(sumo.SUMO_HOME) / "bin" / "sumo", "-c", SCENARIO.config, "--seed", str(seed)]
    subprocess.run([*command, "--end", "100.4", "--fcd-output", file], check=True, capture_output=True, timeout=60)
    return file


@pytest.fixture(scope="module")
def compared(cli: Cli, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Plain SUMO with seeds 1 and 2: the folder and what was printed."""
    folder = tmp_path_factory.mktemp("traces")
    traces = [sumo_trace(folder, seed) for seed in (1, 2)]
    done = cli("compare", "signalised", "--traces", *traces, "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    return folder / "out", done.stdout


def values(folder: Path) -> dict[tuple[str, str], dict[str, Any]]:
    return {(row["measure"], row["type"]): row for row in json.loads((folder / "results.json").read_text())["rows"]}


def test_a_trace_tells_what_its_run_measured(compared: tuple[Path, str]) -> None:
    common = ComparedScenario("signalised", "intersection", decisions=250, selector="rule")
    plain = {Run(1, arm): run_comparison(common, Run(seed, SUMO)) for seed, arm in ((1, "first"), (2, "second"))}
    for record in plain.values():  # a road user that is there in the first time step may have been there before
        record["trips"] = {road_user: trip for road_user, trip in record["trips"].items() if trip[2] > 0.0}
    measured = {(row["measure"], row["type"]): row for row in rows(plain, ("first", "second"))}
    # Runs follow every SUMO step and see a road user's last one as well; traces have positions with two decimals.
    close = {"travel_time": 0.05, "way": 12.0, "stops": 0.0, "standing": 0.5, "speed": 0.05, "off_surface": 0.5}
    # Cars want up to a tenth more or less than the limit of the lane, which a trace does not tell.
    close |= {"hard_braking": 0.3, "ttc_rate": 0.3, "time_loss": 2.0}
    share = dict.fromkeys(("co2", "co2_per_km", "nox", "fuel"), 0.03) | {"pmx": 0.05}
    found = values(compared[0])
    assert {kind for _, kind in found} == {"all", "car", "bicycle", "pedestrian"}
    for key, row in found.items():
        for arm in ("first", "second"):
            near = pytest.approx(measured[key][arm], rel=share.get(key[0], 0.0), abs=close.get(key[0], 0.0))
            assert row[arm] == near, (key, arm)
    assert {measure for measure, _ in found} >= {"time_loss", "co2", "co2_per_km", "nox", "pmx", "fuel"}
    assert found["time_loss", "car"]["definition"].startswith("time beyond what the same way takes at the limits")


def test_the_page_says_what_differs(compared: tuple[Path, str]) -> None:
    folder, printed = compared
    page, found = (folder / "comparison.html").read_text(encoding="utf-8"), values(folder)
    speed = found["speed", "car"]
    assert f"<td>{speed['first']:.2f}</td><td>{speed['second']:.2f}</td>" in page
    share = 100.0 * (speed["second"] / speed["first"] - 1.0)
    assert re.search(rf"[ ;]speed \([^)]*car {share:+.0f} %".replace("+", r"\+"), page)
    assert speed["verdict"] == ("higher" if share > 0 else "lower")
    assert "sumo-1.xml" in page
    assert "differ by chance" in page
    assert "differ by chance" in printed
    assert "seeds are too few" not in page + printed
    trips = json.loads((folder / "results.json").read_text())["trips"]
    assert trips["in_both"] > 3
    differences = [abs(each["second"] - each["first"]) for each in trips["largest"]]
    assert differences == sorted(differences, reverse=True)
    assert f"<td>{trips['largest'][0]['id']}</td>" in page
    assert not (folder / "comparison.png").exists()


def test_a_trace_beside_itself_is_the_same(cli: Cli, tmp_path: Path) -> None:
    trace = sumo_trace(tmp_path, 3)
    done = cli("compare", NET, "--traces", trace, trace, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    found = values(tmp_path / "out")
    assert {row["verdict"] for row in found.values()} == {"the same"}
    # The network names none of the scenario's vehicle types.
    assert not any(measure == "co2" for measure, _ in found)
    assert "are unknown here: no emissions of theirs" in done.stdout
    assert "Higher" not in (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")


def test_trips_of_a_trace_are_whole() -> None:
    """The first is there from the beginning, the second to the end; the third stands for 2 s on its way."""
    still = [0.0, 4.0, 8.0, *[8.0] * 5, 12.0]
    tracks = make_recording(
        ([0.0, 4.0, 8.0], 0.0, 0.0),
        ([0.0, 4.0, 8.0, 12.0], 20.0, 0.0),
        (still, 40.0, 0.0),
        first=[0, 8, 1],
        ids=("early", "late", "whole"),
    )
    trips = trips_of_trace(tracks, np.full(len(tracks), 20.0))
    assert set(trips) == {"late", "whole"}
    assert trips["late"].arrived is None
    whole = trips["whole"]
    assert whole.departed == pytest.approx(0.4)
    assert whole.arrived == pytest.approx(4.0)
    assert whole.distance == pytest.approx(12.0)
    assert (whole.stops, whole.standing) == (1, pytest.approx(2.0))
    assert whole.time_loss == pytest.approx(3.2 - 12.0 / 20.0)
    assert {trip.time_loss for trip in trips_of_trace(tracks).values()} == {0.0}


def test_a_trip_goes_on_in_the_next_track() -> None:
    """One stands before and after a change of tracks at 1.2 s, the other is there from the beginning and jumps."""
    tracks = make_recording(
        ([0.0, 4.0, 4.0], 0.0, 0.0),
        ([4.0, 4.0, 4.0, 8.0], 0.0, 0.0),
        ([0.0, 4.0], 20.0, 0.0),
        ([90.0, 94.0], 20.0, 0.0),
        ([0.0, 4.0, 8.0], 40.0, 0.0),
        ([0.0] * 12, 60.0, 0.0),
        first=[1, 4, 0, 2, 1, 0],
        ids=("a", "a#1", "b", "b#1", "flow#7", "c"),
    )
    trips = trips_of_trace(tracks)
    assert set(trips) == {"a", "flow#7"}
    assert trips["a"].distance == pytest.approx(8.0)
    assert (trips["a"].stops, trips["a"].standing) == (1, pytest.approx(1.6))
    assert (trips["a"].departed, trips["a"].arrived) == (pytest.approx(0.4), pytest.approx(3.2))


def test_wrong_input_is_told(cli: Cli, tmp_path: Path) -> None:
    trace = sumo_trace(tmp_path, 1)
    given = ("--traces", trace, trace, "--out", tmp_path / "out")
    for command, expected in (
        (("signalised", *given, "--seeds", "3"), "--seeds: belongs to a comparison of runs"),
        (("nowhere.net.xml", *given), "nowhere.net.xml: there is no such file"),
        (("signalised", "--traces", trace, tmp_path / "none.xml", "--out", tmp_path / "out"), "none.xml"),
    ):
        done = cli("compare", *command)
        assert (done.returncode, done.stdout) == (1, "")
        assert expected in done.stderr
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
