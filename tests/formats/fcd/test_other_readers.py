"""SUMO's own readers, and Python's csv module, take our traces."""

import csv
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import pandas as pd
import pytest
import sumo
import sumolib
from lxml import etree

from slrl_sumo.formats.fcd.columns import CSV_COLUMNS
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.isolated_run import run_isolated
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.scenario import find_scenario

HOME = Path(sumo.SUMO_HOME)
ROOT = Path(__file__).parents[3]
NET = find_scenario("intersection").config.with_name("intersection.net.xml")
STEPS = 60
TAKEOVER = "car=0.5,pedestrian=0.5"

Cli = Callable[..., subprocess.CompletedProcess[str]]
Track = dict[str, list[tuple[float, float, float]]]


@pytest.fixture(scope="module")
def folder(cli: Cli, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same run as XML, CSV and Parquet: added and lent road users, and SUMO's own."""
    folder = tmp_path_factory.mktemp("readers")
    for suffix in (".xml", ".csv", ".parquet"):
        words = ("--agents", 10, "--takeover", TAKEOVER, "--steps", STEPS, "--fcd", folder / f"trace{suffix}")
        assert cli("run", "intersection", *words, "--quiet").returncode == 0
    return folder


def call(*words: object, cwd: Path) -> None:
    done = subprocess.run(
        list(map(str, words)),
        cwd=cwd,
        env={**os.environ, "SUMO_HOME": str(HOME), "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr


def tracks(file: Path) -> Track:
    """Time, x and y of all road users of a trace."""
    found: Track = {}
    for step in etree.parse(str(file)).getroot():
        for e in step:
            row = tuple(float(v) for v in (step.get("time", ""), e.get("x", ""), e.get("y", "")))
            found.setdefault(e.get("id", ""), []).append(row)  # type: ignore[arg-type]
    return found


def test_trace_exporter_finds_every_track_and_point(folder: Path) -> None:
    tool = HOME / "tools" / "traceExporter.py"
    call(
        *(sys.executable, tool, "-i", "trace.xml", "-n", NET, "--orig-ids", "--persons"),
        *("--gpx-output", "o.gpx", "--shift", "100"),
        cwd=folder,
    )
    gpx = etree.parse(str(folder / "o.gpx")).getroot()
    names = {track.findtext("{*}name"): len(track.findall(".//{*}trkpt")) for track in gpx.iter("{*}trk")}
    assert names == {name: len(points) for name, points in tracks(folder / "trace.xml").items()}
    assert sum(str(name).startswith("learned_pedestrian") for name in names) == 3
    assert sum(names.values()) > 500


@pytest.mark.parametrize("element", ["vehicle", "person"])
def test_plot_trajectories_draws_all_road_users(folder: Path, element: str) -> None:
    tool = HOME / "tools" / "plot_trajectories.py"
    picture, table = folder / f"{element}.png", folder / f"{element}.csv"
    more = ["--persons"] if element == "person" else []
    call(sys.executable, tool, "trace.xml", "-t", "xy", "-o", picture, "--csv-output", table, *more, cwd=folder)
    pixels = cv2.imread(str(picture))
    assert pixels is not None
    assert (pixels.min(axis=2) < 200).mean() > 0.005
    drawn = {line.strip('"') for line in table.read_text().splitlines() if line.startswith('"')}
    steps = etree.parse(str(folder / "trace.xml")).getroot()
    # The tool leaves out road users without a lane.
    assert drawn == {e.get("id") for step in steps for e in step.iter(element) if e.get("lane") or e.get("edge")}
    assert len(drawn) >= 3


def test_sumo_replays_all_road_users_where_the_trace_has_them(folder: Path) -> None:
    call(sys.executable, "-m", "slrl_sumo.sumo.scenario.trace_types", "intersection", "types.add.xml", cwd=folder)
    call(
        *(HOME / "bin" / "sumo", "-n", NET, "-a", "types.add.xml", "--device.fcd-replay.files", "trace.xml"),
        # Road users that leave the scene jump to its other side, where no route leads.
        *("--step-length", "0.4", "--end", 0.4 * STEPS, "--ignore-route-errors", "--no-warnings"),
        *("--fcd-output", "replayed.xml", "--precision", "3"),
        cwd=folder,
    )
    ours, replayed = tracks(folder / "trace.xml"), tracks(folder / "replayed.xml")
    assert replayed.keys() == ours.keys()
    where = {(name, t): (x, y) for name, points in ours.items() for t, x, y in points}
    apart = [
        max(abs(x - where[name, t][0]), abs(y - where[name, t][1]))
        for name, points in replayed.items()
        for t, x, y in points
        if (name, t) in where
    ]
    assert len(apart) > 0.8 * len(where)
    # SUMO replays along lanes and edges, beside which its vehicles stand where it can put them.
    assert sum(distance < 2.0 for distance in apart) > 0.7 * len(apart)


def test_types_of_a_trace_are_the_scenarios_and_ours(folder: Path) -> None:
    call(sys.executable, "-m", "slrl_sumo.sumo.scenario.trace_types", "intersection", "all.add.xml", cwd=folder)
    types = {e.get("id"): e for e in etree.parse(str(folder / "all.add.xml")).getroot()}
    used = {e.get("type") for step in etree.parse(str(folder / "trace.xml")).getroot() for e in step}
    assert used <= types.keys()
    assert types["learned_bicycle"].get("guiShape") == "bicycle"
    routes = etree.parse(str(NET.with_name("intersection.rou.xml"))).getroot()
    assert dict(types["passenger3"].attrib) == dict(
        next(e.attrib for e in routes.iter() if e.get("id") == "passenger3")
    )


def test_csv_reads_with_pythons_own_module(folder: Path) -> None:
    with open(folder / "trace.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, delimiter=";", strict=True))
    found: Track = {}
    for row in rows:
        assert None not in row
        assert None not in row.values()
        figures = (float(row["timestep_time"]), float(row["vehicle_x"]), float(row["vehicle_y"]))
        assert 0.0 <= float(row["vehicle_angle"]) < 360.0
        assert float(row["vehicle_speed"]) >= 0.0
        assert not (row["vehicle_lane"] and row["vehicle_edge"])
        found.setdefault(row["vehicle_id"], []).append(figures)
    assert found == tracks(folder / "trace.xml")


def tables(folder: Path) -> list[pd.DataFrame]:
    """The traces that pandas reads."""
    csv_options = {"sep": ";", "dtype": {"mode": "Int64"}}
    return [pd.read_csv(folder / "trace.csv", **csv_options), pd.read_parquet(folder / "trace.parquet")]


def test_pandas_reads_the_same_from_csv_and_parquet(folder: Path) -> None:
    ours = tracks(folder / "trace.xml")
    for table in tables(folder):
        found = {
            name: list(rows[["timestep_time", "vehicle_x", "vehicle_y"]].itertuples(index=False, name=None))
            for name, rows in table.groupby("vehicle_id")
        }
        assert found == ours
        persons = {
            e.get("id") for step in etree.parse(str(folder / "trace.xml")).getroot() for e in step.iter("person")
        }
        assert set(table.vehicle_id[table.vehicle_edge.notna()]) <= persons
        assert table.vehicle_lane.notna().sum() > 300


def test_modes_and_learned_are_those_of_the_decisions(folder: Path) -> None:
    learned: dict[tuple[float, str], int | None] = {}
    all_users: set[tuple[float, str]] = set()
    settings = RunSettings("intersection", agents=10, takeover=TAKEOVER, steps=STEPS)
    for event in run_isolated(settings):
        steps = (event.step,) if isinstance(event, Started) else event.steps if isinstance(event, Decision) else ()
        for step in steps:
            all_users |= {(round(step.time, 3), name) for name in step.world.ids}
            names = [name for name, own in zip(step.world.ids, step.world.learned, strict=True) if own]
            modes = event.modes if isinstance(event, Decision) else None
            values = [None] * len(names) if modes is None else modes.tolist()
            learned |= {(round(step.time, 3), name): mode for name, mode in zip(names, values, strict=True)}
    assert {mode for mode in learned.values() if mode is not None} <= set(range(20))
    assert any(name.startswith("passenger") for _, name in learned)  # one that was taken over
    for table in tables(folder):
        rows = zip(table.timestep_time, table.vehicle_id, table["mode"], table.learned, strict=True)
        found = {(time, name): (None if pd.isna(mode) else int(mode), bool(own)) for time, name, mode, own in rows}
        assert {key: mode for key, (mode, own) in found.items() if own} == learned
        assert found.keys() == all_users
        assert {mode for mode, own in found.values() if not own} == {None}


def test_sumos_own_converter_takes_our_parquet(folder: Path) -> None:
    tool = HOME / "tools" / "output" / "parquet2csv.py"
    done = subprocess.run([sys.executable, tool, folder / "trace.parquet"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(done.stdout.splitlines()))
    assert len(rows) == sum(map(len, tracks(folder / "trace.xml").values()))
    assert list(rows[0]) == [*CSV_COLUMNS, "mode", "learned"]


def test_sumolib_reads_every_row_of_the_xml(folder: Path) -> None:
    found: Track = {}
    for step in sumolib.xml.parse(str(folder / "trace.xml"), "timestep"):
        for user in [*(step.vehicle or []), *(step.person or [])]:
            found.setdefault(user.id, []).append((float(step.time), float(user.x), float(user.y)))
    assert found == tracks(folder / "trace.xml")
