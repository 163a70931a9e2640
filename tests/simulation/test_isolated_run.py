"""When SUMO dies, the run ends well: valid outputs up to the last whole step, one line, nothing left behind."""

import csv
import gzip
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
import sumo
from lxml import etree

import slrl_sumo.simulation.run
from slrl_sumo.errors import DefectError
from slrl_sumo.ground.road_map import RoadMap, Surface
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.isolated_run import run_isolated
from slrl_sumo.simulation.settings import RunSettings

AGENTS = 8
HOME = Path(sumo.SUMO_HOME)

Cli = Callable[..., subprocess.CompletedProcess[str]]
Copy = Callable[..., Path]


class Run:
    """`slrl-sumo run` as a process, with a folder for its temporary files; ends with the test."""

    def __init__(self, folder: Path, *words: object, fcd: Path, scenario: object = "intersection") -> None:
        self.fcd, self.temporary = fcd, folder / "tmp"
        self.temporary.mkdir()
        command = [sys.executable, "-m", "slrl_sumo", "run", scenario, "--agents", AGENTS, "--fcd", fcd]
        self.process = subprocess.Popen(
            list(map(str, [*command, "--steps", 1_000_000, "--quiet", *words])),
            env={**os.environ, "TMPDIR": str(self.temporary)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait_until_it_writes(self) -> None:
        size = 15_000 if self.fcd.suffix == ".gz" else 60_000
        deadline = time.monotonic() + 120
        while not self.fcd.exists() or self.fcd.stat().st_size < size:
            assert self.process.poll() is None, self.process.stderr and self.process.stderr.read()
            assert time.monotonic() < deadline, "the trace does not grow"
            time.sleep(0.05)

    def simulation(self) -> int:
        """Process id of the child that holds SUMO: the one that has libsumo open."""
        (holder,) = (pid for pid in children(self.process.pid) if "libsumo" in Path(f"/proc/{pid}/maps").read_text())
        return holder

    def ended(self) -> tuple[int, str]:
        """Exit code and what stands on stderr."""
        try:
            out, err = self.process.communicate(timeout=60)
        finally:
            self.process.kill()
        assert out == ""
        return self.process.returncode, err


def children(parent: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended meanwhile
        if int(fields[1]) == parent:
            found.append(int(stat.parent.name))
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def gone(pids: list[int]) -> bool:
    """Whether processes end by themselves, soon."""
    deadline = time.monotonic() + 60
    while any(map(alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(alive, pids))


def times_of(fcd: Path) -> list[float]:
    """The time steps of a whole trace; each holds all learned road users, and follows the one before it."""
    learned: dict[float, int] = {}
    if fcd.suffix == ".csv":
        text = fcd.read_text()
        assert text.endswith("\n")
        for row in csv.DictReader(text.splitlines(), delimiter=";", strict=True):
            assert None not in row
            assert None not in row.values()
            moment = float(row["timestep_time"])
            learned[moment] = learned.get(moment, 0) + row["vehicle_id"].startswith("learned_")
    else:
        data = fcd.read_bytes()
        root = etree.fromstring(gzip.decompress(data) if fcd.suffix == ".gz" else data)
        etree.XMLSchema(file=str(HOME / "data" / "xsd" / "fcd_file.xsd")).assertValid(root)
        for step in root:
            learned[float(step.get("time", ""))] = sum(e.get("id", "").startswith("learned_") for e in step)
    times = list(learned)
    assert len(times) > 10
    assert set(learned.values()) == {AGENTS}
    assert all(b - a == pytest.approx(0.4) for a, b in pairwise(times))
    return times


@pytest.mark.parametrize(
    ("number", "name", "reports"),
    [
        (signal.SIGKILL, "a.xml", True),
        # The report is made from the same positions whatever the trace is, and takes 10 of a test's 15 s.
        pytest.param(signal.SIGSEGV, "a.xml.gz", False, marks=pytest.mark.slow),
        pytest.param(signal.SIGSEGV, "a.csv", False, marks=pytest.mark.slow),
    ],
)
def test_when_sumo_dies_everything_up_to_there_is_written(
    tmp_path: Path, number: signal.Signals, name: str, reports: bool
) -> None:
    summary, report = tmp_path / "s.json", tmp_path / "report"
    words = ["--report", report] if reports else []
    run = Run(tmp_path, "--summary", summary, *words, fcd=tmp_path / name)
    run.wait_until_it_writes()
    family = children(run.process.pid)
    os.kill(run.simulation(), number)
    code, err = run.ended()
    assert code == 3
    (line,) = err.splitlines()
    times = times_of(run.fcd)
    # What, when, and how to see it again.
    assert f"SUMO died after {times[-1]:g} s" in line
    assert number.name in line
    assert f"slrl-sumo run intersection --agents {AGENTS} --fcd {run.fcd} --steps 1000000" in line
    written = ", ".join(map(str, [run.fcd, summary, *words[1:]]))
    assert f"complete up to there: {written}; repeat it with: slrl-sumo run" in line
    figures = json.loads(summary.read_text())
    assert (figures["decisions"], figures["end_s"], figures["interrupted"]) == (len(times) - 1, times[-1], True)
    assert figures["ended_by"].startswith(f"SUMO died after {times[-1]:g} s of simulation time ({number.name}")
    if reports:
        assert (report / "paths.png").stat().st_size > 10_000
    assert gone(family)
    assert list(run.temporary.iterdir()) == []


def test_when_the_command_is_killed_sumo_ends_too(tmp_path: Path) -> None:
    run = Run(tmp_path, fcd=tmp_path / "a.xml")
    run.wait_until_it_writes()
    family = children(run.process.pid)
    assert run.simulation() in family
    run.process.kill()
    code, _ = run.ended()
    assert code == -signal.SIGKILL
    assert gone(family)
    times_of(run.fcd)
    assert list(run.temporary.iterdir()) == []


@pytest.mark.slow
def test_an_interrupt_lets_sumo_finish_the_scenarios_own_outputs(copy_scenario: Copy, tmp_path: Path) -> None:
    config = copy_scenario(
        "intersection", (".sumocfg", "<time>", '<output><fcd-output value="own.xml"/></output><time>')
    )
    run = Run(tmp_path, "--sumo-outputs", fcd=tmp_path / "a.xml", scenario=config)
    run.wait_until_it_writes()
    run.process.send_signal(signal.SIGTERM)
    assert run.ended() == (143, "")
    ours = times_of(run.fcd)
    own = [float(step.get("time", "")) for step in etree.parse(str(config.parent / "own.xml")).getroot()]
    assert own[: len(ours)] == pytest.approx(ours)


@pytest.mark.slow
def test_a_fatal_error_of_sumo_gives_its_reason(cli_process: Cli, copy_scenario: Copy, tmp_path: Path) -> None:
    # No connection leads from in0 back to in0's begin: SUMO finds out when the vehicle is to depart.
    config = copy_scenario(
        "intersection",
        (".sumocfg", "<time>", '<input><route-steps value="1"/></input><time>'),
        (".rou.xml", "</routes>", '<vehicle id="astray" depart="30"><route edges="out0 in0"/></vehicle></routes>'),
    )
    routes = config.with_name("intersection.rou.xml")
    ordered = etree.parse(str(routes))
    demand = sorted(ordered.getroot(), key=lambda e: float(e.get("depart") or e.get("begin") or -1))
    ordered.getroot()[:] = demand
    ordered.write(str(routes))
    fcd, summary = tmp_path / "a.xml", tmp_path / "s.json"
    done = cli_process("run", config, "--agents", AGENTS, "--steps", 200, "--fcd", fcd, "--summary", summary, "--quiet")
    assert done.returncode == 3, done.stderr
    (line,) = done.stderr.splitlines()
    assert "astray" in line
    assert "connection" in line
    times = times_of(fcd)
    assert 20 < times[-1] <= 30.4
    assert f"complete up to there: {fcd}, {summary}; repeat it with: slrl-sumo run" in line
    assert json.loads(summary.read_text())["end_s"] == times[-1]


def test_a_bug_of_ours_is_not_dressed_up_as_sumos_death() -> None:
    # Refused by no check: the child fails by a bug.
    settings = RunSettings("intersection", agents=2)
    object.__setattr__(settings, "sumo_options", 3)
    with pytest.raises(DefectError, match=r"^a defect of slrl_sumo \(AttributeError") as error:
        list(run_isolated(settings))
    assert "Traceback" in error.value.details


def test_a_slow_reader_misses_nothing() -> None:
    settings = RunSettings("intersection", agents=30, steps=25, seed=4)
    direct = list(slrl_sumo.simulation.run.run(settings))
    piped = []
    for event in run_isolated(settings):
        if len(piped) in (1, 2):
            time.sleep(1.0)  # long enough for the child to fill the pipe many times over
        piped.append(event)
    assert len(piped) == len(direct) == 26
    assert isinstance(piped[0], Started)
    assert not piped[0].surfaces.shapes
    for a, b in zip(piped[1:], direct[1:], strict=True):
        assert isinstance(a, Decision)
        assert isinstance(b, Decision)
        assert a.steps[-1].world.ids == b.steps[-1].world.ids
        assert a.steps[-1].world.x.tolist() == b.steps[-1].world.x.tolist()


def test_the_ground_comes_when_it_is_asked_for() -> None:
    with closing(run_isolated(RunSettings("intersection", agents=2, steps=1), with_surfaces=True)) as events:
        started = next(events)
    assert isinstance(started, Started)
    ground = RoadMap(started.surfaces)
    world = started.step.world
    assert {shape.surface for shape in started.surfaces.shapes} >= {Surface.ROAD, Surface.SIDEWALK, Surface.CROSSING}
    assert (ground.surface_at(world.x, world.y) != Surface.NONE).all()


def test_the_process_that_writes_and_counts_is_small() -> None:
    # In a city the simulation needs the memory, and 0.2 s of importing come before its process even starts.
    heavy = "{'torch', 'scipy', 'numba', 'cv2'}"
    code = f"import sys, slrl_sumo.api.run; print(*sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_no_place_for_temporary_files_is_told_in_one_line(tmp_path: Path) -> None:
    command = "ulimit -f 0; exec " + f"{sys.executable} -m slrl_sumo run intersection --agents 3 --steps 3"
    done = subprocess.run(
        ["bash", "-c", command],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=120,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "temporary" in line
