"""Whole runs as a user starts them: all are in the trace all the time, and move as road users can.

Each run is a process of its own, so a crash of SUMO is a failure of one test.
"""

import gzip
import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumo
import sumolib
from lxml import etree
from numpy.typing import NDArray

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.scene.types import DECISION_INTERVAL, DEFAULT_LENGTH, TYPE_NAMES
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., subprocess.CompletedProcess[str]]
Floats = NDArray[np.float64]

ROUNDING = 0.003
"""m; positions are written with three digits."""


@dataclass
class Trace:
    """Learned road users in an FCD: arrays over time steps and road users."""

    times: Floats
    ids: list[str]
    kind: NDArray[np.intp]
    x: Floats
    y: Floats
    """Centres, (steps, n) m."""
    speed: Floats
    angle: Floats
    background: int
    """Most road users of SUMO's own at one time."""


def read_trace(file: Path) -> Trace:
    """Read with SUMO's own reader. Fails where a learned road user is missing at any time step."""
    times, rows, background = [], [], 0
    ids: list[str] = []
    for step in sumolib.xml.parse(str(file), "timestep"):
        children = [*(step.vehicle or []), *(step.person or [])]
        names = [child.id for child in children]
        assert len(set(names)) == len(names), f"twice at {step.time}"
        learned = {child.id: child for child in children if child.id.startswith("learned_")}
        ids = ids or sorted(learned)
        assert sorted(learned) == ids, f"at {step.time}: {set(ids) ^ set(learned)}"
        background = max(background, len(children) - len(learned))
        times.append(float(step.time))
        rows.append([[float(getattr(learned[i], key)) for key in ("x", "y", "angle", "speed")] for i in ids])
    table = np.array(rows)
    kind = np.array([TYPE_NAMES.index(i.removeprefix("learned_").split(".")[0]) for i in ids])
    heading = np.radians(90.0 - table[:, :, 2])
    half = 0.5 * DEFAULT_LENGTH[kind]
    return Trace(
        times=np.array(times),
        ids=ids,
        kind=kind,
        x=table[:, :, 0] - half * np.cos(heading),
        y=table[:, :, 1] - half * np.sin(heading),
        speed=table[:, :, 3],
        angle=table[:, :, 2],
        background=background,
    )


def check(file: Path, summary: dict[str, Any], agents: int, decisions: int, max_speed: Floats) -> Trace:
    """Everything that is promised of every run."""
    schema = etree.XMLSchema(etree.parse(str(Path(sumo.SUMO_HOME) / "data" / "xsd" / "fcd_file.xsd")))
    schema.assertValid(etree.parse(str(file)))
    trace = read_trace(file)
    substeps = round(DECISION_INTERVAL / summary["sumo_step_s"])
    assert len(trace.ids) == agents
    assert len(trace.times) == 1 + decisions * substeps
    assert np.allclose(np.diff(trace.times), summary["sumo_step_s"])
    assert trace.times[0] == summary["begin_s"]
    assert summary["decisions"] == decisions
    assert summary["agent_steps"] == agents * decisions
    assert summary["lost"] == 0
    assert [summary["per_type"][name]["count"] for name in TYPE_NAMES] == np.bincount(trace.kind, minlength=3).tolist()

    # Jumps are loops, and all loops are in the summary.
    reported = {(loop["id"], round(loop["time_s"], 2)) for loop in summary["wraparounds"]}
    assert len(reported) == len(summary["wraparounds"]) == summary["wrapped_around"]
    looped = np.array([[(i, round(t, 2)) in reported for i in trace.ids] for t in trace.times[1::substeps]])
    assert looped.sum() == len(reported)
    at = slice(0, None, substeps)
    moved = np.hypot(np.diff(trace.x[at], axis=0), np.diff(trace.y[at], axis=0))
    reach = max_speed[trace.kind] * DECISION_INTERVAL
    assert (moved <= reach + ROUNDING)[~looped].all()
    if looped.any():
        assert np.median(moved[looped]) > 50.0

    # Speeds are those of the motion.
    speed = trace.speed[at][1:]
    assert np.abs(moved / DECISION_INTERVAL - speed)[~looped].max() < 2 * ROUNDING / DECISION_INTERVAL
    assert (speed <= max_speed[trace.kind] + 1e-3).all()
    for kind, name in enumerate(TYPE_NAMES):
        rows = trace.kind == kind
        if rows.any():
            assert speed[:, rows].mean() == pytest.approx(summary["per_type"][name]["mean_speed_mps"], abs=2e-3)

    # Between decisions all go straight and evenly; a reinserted road user is there at once.
    for k in range(1, substeps):
        for place in (trace.x, trace.y):
            begin, end = place[:-1:substeps], place[substeps::substeps]
            expected = np.where(looped, end, begin + k / substeps * (end - begin))
            assert np.abs(place[k::substeps] - expected).max() < ROUNDING
    return trace


def run(
    cli: Cli, folder: Path, scenario: str, agents: int, decisions: int, *more: object
) -> tuple[Path, dict[str, Any]]:
    folder.mkdir(exist_ok=True)
    fcd, summary = folder / "fcd.xml", folder / "summary.json"
    done = cli("run", scenario, "--agents", agents, "--steps", decisions, "--fcd", fcd, "--summary", summary, *more)
    assert done.returncode == 0, done.stderr
    result = json.loads(summary.read_text())
    assert done.stderr.splitlines() == [f"note: {notice}" for notice in result["notices"]]
    return fcd, result


@pytest.fixture(scope="module")
def short_run(cli: Cli, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    return run(cli, tmp_path_factory.mktemp("short"), "intersection", 16, 60, "--seed", 3)


def test_a_short_run_keeps_all_promises(short_run: tuple[Path, dict[str, Any]], shipped_bundle: ModelBundle) -> None:
    fcd, summary = short_run
    trace = check(fcd, summary, 16, 60, shipped_bundle.max_speed)
    assert (summary["scenario"], summary["seed"], summary["bundle"]) == ("intersection", 3, "intersection")
    assert summary["wrapped_around"] > 0
    assert trace.background > 3
    assert (trace.speed.max(axis=0) > 0.3).mean() > 0.8
    assert len(np.unique(trace.angle[-1])) > 8


def test_time_steps_hold_vehicles_first_as_sumos_do(short_run: tuple[Path, dict[str, Any]]) -> None:
    persons = 0
    for step in etree.parse(str(short_run[0])).getroot():
        tags = [child.tag for child in step]
        persons += tags.count("person")
        assert tags == sorted(tags, key=["vehicle", "person"].index)
    assert persons > 0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_trace_and_another_seed_another(
    cli: Cli, short_run: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    again, _ = run(cli, tmp_path / "again", "intersection", 16, 60, "--seed", 3)
    assert again.read_bytes() == short_run[0].read_bytes()
    other, _ = run(cli, tmp_path / "other", "intersection", 16, 60, "--seed", 4)
    assert read_trace(other).x[0].tolist() != read_trace(again).x[0].tolist()


@pytest.mark.slow
def test_all_formats_hold_the_same_trace(cli: Cli, tmp_path: Path) -> None:
    files = [tmp_path / f"trace.{suffix}" for suffix in ("xml", "xml.gz", "csv")]
    for file in files:
        done = cli("run", "intersection", "--agents", 5, "--steps", 10, "--seed", 2, "--fcd", file, "--quiet")
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert gzip.decompress(files[1].read_bytes()) == files[0].read_bytes()
    xml = etree.parse(str(files[0]))
    expected = {
        (float(step.get("time", "")), e.get("id"), e.get("x"), e.get("y"), e.get("speed"))
        for step in xml.getroot()
        for e in step
    }
    lines = [line.split(";") for line in files[2].read_text().splitlines()]
    column = {name: i for i, name in enumerate(lines[0])}
    rows = {
        (float(r[column["timestep_time"]]), *(r[column[f"vehicle_{key}"]] for key in ("id", "x", "y", "speed")))
        for r in lines[1:]
    }
    assert len(lines) - 1 == len(expected)
    assert rows == expected


JUDGED = {
    "intersection": (64, ()),
    "shared-space": (64, ()),
    "signalised": (64, ()),
    "district": (64, ()),
    "cross.sumocfg": (32, ("no surface for pedestrian",)),
    "fkk_in.sumocfg": (32, ()),
    "square.sumocfg": (32, ("no surface for pedestrian", "tripinfo-output")),
    "A10KW.sumocfg": (32, ("SUMO step 0.4 s instead of the scenario's 0.5 s",)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", JUDGED)
def test_a_minute_of_many_keeps_all_promises(
    cli: Cli, game: Path, shipped_bundle: ModelBundle, tmp_path: Path, name: str
) -> None:
    agents, expected = JUDGED[name]
    scenario = str(game / name) if name.endswith(".sumocfg") else name
    fcd, summary = run(cli, tmp_path, scenario, agents, 150)
    trace = check(fcd, summary, agents, 150, shipped_bundle.max_speed)
    assert trace.background >= 5
    assert summary["scenario"] == find_scenario(scenario).name
    notices = " ".join(summary["notices"])
    for words in expected:
        assert words in notices


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_a_minute_on_sumos_smallest_steps_and_with_its_sublane_model(
    cli: Cli, shipped_bundle: ModelBundle, copy_scenario: Callable[..., Path], tmp_path: Path, seed: int
) -> None:
    config = copy_scenario(
        "intersection", (".sumocfg", "<processing>", '<processing><lateral-resolution value="0.8"/>')
    )
    fcd, summary = run(cli, tmp_path, str(config), 64, 150, "--step-length", 0.1, "--seed", seed)
    check(fcd, summary, 64, 150, shipped_bundle.max_speed)
