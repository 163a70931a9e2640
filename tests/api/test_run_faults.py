"""What a run leaves behind where something cannot be written: one line, exit code 1, and all the rest."""

import csv
import gzip
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from lxml import etree

import slrl_sumo
from slrl_sumo.api import run as outputs
from slrl_sumo.metrics.traffic.density import Density
from slrl_sumo.simulation.events import Decision, Event, Started
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings

COMMAND = [sys.executable, "-m", "slrl_sumo", "run", "intersection", "--seed", "1"]


def call(
    *words: object, stdout: int = subprocess.PIPE, prefix: str = ":", cwd: Path
) -> subprocess.CompletedProcess[str]:
    """Run through a shell line `prefix`, which may limit or close what the command gets."""
    command = ["bash", "-c", f'{prefix}; exec "$@"', "bash", *COMMAND, *map(str, words)]
    return subprocess.run(command, cwd=cwd, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=300)


def one_line(done: subprocess.CompletedProcess[str], *words: str) -> None:
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("slrl-sumo: ")
    for word in words:
        assert word in line


def steps_of(fcd: Path) -> int:
    """Whole time steps of a valid trace."""
    data = fcd.read_bytes()
    if fcd.suffix == ".csv":
        assert data.endswith(b"\n")
        rows = list(csv.DictReader(data.decode().splitlines(), delimiter=";", strict=True))
        assert all(None not in row and None not in row.values() for row in rows)
        return len({row["timestep_time"] for row in rows})
    return len(etree.fromstring(gzip.decompress(data) if fcd.suffix == ".gz" else data))


@pytest.mark.parametrize(
    ("name", "full", "kib"),
    [
        ("a.xml", "a.xml", 400),
        # The table of learned road users is not compressed.
        pytest.param("a.xml.gz", "a.learned.csv", 120, marks=pytest.mark.slow),
        pytest.param("a.csv", "a.csv", 400, marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_costs_only_what_does_not_fit(tmp_path: Path, name: str, full: str, kib: int) -> None:
    words = ("--agents", 60, "--steps", 150, "--fcd", name, "--summary", "s.json", "--quiet")
    one_line(call(*words, prefix=f"ulimit -f {kib}", cwd=tmp_path), full, "File too large")
    whole = steps_of(tmp_path / name)
    assert (tmp_path / full).stat().st_size > 0.7 * 1024 * kib
    # The run ended when the disk was full, not before; some steps had been simulated that no longer fit.
    decisions = json.loads((tmp_path / "s.json").read_text())["decisions"]
    assert 20 < whole <= decisions + 2 < 150


@pytest.mark.slow
def test_all_that_could_not_be_written_stands_in_the_one_line(tmp_path: Path) -> None:
    words = ("--agents", 10, "--steps", 2, "--summary", "s.json", "--report", "r", "--quiet")
    done = call(*words, prefix="ulimit -f 1", cwd=tmp_path)
    one_line(done, "s.json", "r: cannot be written")
    assert not (tmp_path / "s.json").exists(), "half a summary"


@pytest.mark.parametrize("how", ["reader gone", pytest.param("closed", marks=pytest.mark.slow), "full"])
def test_a_table_that_cannot_be_printed_costs_nothing_else(tmp_path: Path, how: str) -> None:
    words = ("--agents", 5, "--steps", 5, "--fcd", "a.xml", "--summary", "s.json")
    if how == "reader gone":
        reading, writing = os.pipe()
        os.close(reading)
        done = call(*words, stdout=writing, cwd=tmp_path)
        os.close(writing)
    else:
        done = call(*words, prefix="exec >&-" if how == "closed" else "exec > /dev/full", cwd=tmp_path)
    one_line(done, "standard output", "--quiet")
    assert steps_of(tmp_path / "a.xml") == 6
    assert json.loads((tmp_path / "s.json").read_text())["decisions"] == 5


@pytest.mark.slow
def test_without_any_standard_stream_the_outputs_are_whole(tmp_path: Path) -> None:
    words = ("--agents", 5, "--steps", 5, "--fcd", "a.xml", "--summary", "s.json", "--quiet")
    assert call(*words, prefix="exec <&- >&- 2>&-", cwd=tmp_path).returncode == 0
    assert steps_of(tmp_path / "a.xml") == 6
    assert json.loads((tmp_path / "s.json").read_text())["decisions"] == 5


@pytest.fixture
def recorded() -> list[Event]:
    """The events of a short run."""
    return list(run(RunSettings("intersection", agents=40, steps=5)))


def replay(monkeypatch: pytest.MonkeyPatch, events: Iterator[Event]) -> None:
    """Give `write_run` these events in place of a simulation's."""
    monkeypatch.setattr(outputs, "run_isolated", lambda settings, views_at, *, with_surfaces, traced: events)


def test_an_impatient_interrupt_leaves_a_valid_trace(
    recorded: list[Event], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def events() -> Iterator[Event]:
        yield from recorded[:3]
        signal.raise_signal(signal.SIGINT)  # noted
        signal.raise_signal(signal.SIGINT)  # does not wait for the step that is being computed
        raise AssertionError("the second signal was not heard")

    replay(monkeypatch, events())
    settings = RunSettings("intersection", agents=40, steps=5)
    result = outputs.write_run(settings, fcd=tmp_path / "a.xml", summary=tmp_path / "s.json")
    assert result.interrupted_by == signal.SIGINT
    with pytest.raises(KeyboardInterrupt):
        result.raise_failures()
    assert steps_of(tmp_path / "a.xml") == 3
    assert json.loads((tmp_path / "s.json").read_text())["decisions"] == 2


def test_memory_does_not_grow_with_the_length_of_a_run(
    recorded: list[Event], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, *decisions = recorded
    assert isinstance(started, Started)
    peaks = []

    def events(count: int) -> Iterator[Event]:
        yield started
        for number in range(count):
            decision = decisions[number % len(decisions)]
            assert isinstance(decision, Decision)
            if number in (count // 10, count - 1):
                peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
            yield decision

    count = 3000
    replay(monkeypatch, events(count))
    settings = RunSettings("intersection", agents=40, steps=count)
    outputs.write_run(settings, fcd=tmp_path / "a.xml", summary=tmp_path / "s.json")
    size = (tmp_path / "a.xml").stat().st_size
    assert size > 15e6
    # KiB; the trace of the last nine tenths is several times larger than what may stay in memory, and the allocator's
    # heap may grow by a few MB after other tests.
    assert 1024 * (peaks[1] - peaks[0]) < 0.25 * size


def test_a_jam_is_said_at_the_end_and_in_the_summary(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Density, "jam", lambda _: "the traffic jams")
    result = slrl_sumo.run("intersection", agents=4, steps=3, selector="lane", progress=True)
    assert capsys.readouterr().err.splitlines()[-1] == "note: the traffic jams"
    assert result.summary.notices[-1] == "the traffic jams"
