"""SIGINT, SIGTERM and SIGHUP in the middle of a run: what is on disk is whole."""

import gzip
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo.jobs.interrupt import SIGNALS, interruptible, interruptible_to_the_end

Cli = Callable[..., subprocess.CompletedProcess[str]]

AGENTS = 8


def interrupt(folder: Path, fcd: Path, number: signal.Signals, *more: str) -> subprocess.CompletedProcess[str]:
    """Start a long run, wait until its trace grows, and send the signal as a terminal would: to the whole group."""
    command = [sys.executable, "-m", "slrl_sumo", "run", "intersection", "--agents", str(AGENTS), "--quiet"]
    command += ["--steps", "1000000", "--fcd", str(fcd), "--summary", str(folder / "s.json"), *more]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        deadline = time.monotonic() + 120
        while not fcd.exists() or fcd.stat().st_size < 60_000:
            assert process.poll() is None, process.stderr.read() if process.stderr else ""
            assert time.monotonic() < deadline, "the trace does not grow"
            time.sleep(0.05)
        if number == signal.SIGTERM:
            process.send_signal(number)
        else:  # as from a terminal
            os.killpg(process.pid, number)
        out, err = process.communicate(timeout=60)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def check_steps(times: list[float], learned: list[int], summary: Path, number: signal.Signals) -> None:
    """Whole time steps one after the other, all road users in each, and as many as the summary says."""
    assert len(times) > 10
    assert all(abs(b - a - 0.4) < 1e-6 for a, b in pairwise(times))
    assert set(learned) == {AGENTS}
    figures = json.loads(summary.read_text())
    assert len(times) == 1 + figures["decisions"]
    assert figures["end_s"] == times[-1]
    assert (figures["interrupted"], figures["ended_by"]) == (True, number.name)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupted_run_leaves_a_whole_trace(tmp_path: Path, number: signal.Signals, code: int) -> None:
    fcd = tmp_path / "a.xml"
    done = interrupt(tmp_path, fcd, number)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
    root = etree.parse(str(fcd)).getroot()
    learned = [sum(e.get("id", "").startswith("learned_") for e in step) for step in root]
    check_steps([float(step.get("time", "")) for step in root], learned, tmp_path / "s.json", number)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_compressed_traces_are_whole_too(tmp_path: Path, number: signal.Signals) -> None:
    fcd = tmp_path / "a.xml.gz"
    assert interrupt(tmp_path, fcd, number).returncode == 128 + number
    root = etree.fromstring(gzip.decompress(fcd.read_bytes()))
    learned = [sum(e.get("id", "").startswith("learned_") for e in step) for step in root]
    check_steps([float(step.get("time", "")) for step in root], learned, tmp_path / "s.json", number)


@pytest.mark.slow
def test_csv_traces_end_with_a_whole_time_step(tmp_path: Path) -> None:
    fcd = tmp_path / "a.csv"
    assert interrupt(tmp_path, fcd, signal.SIGTERM).returncode == 143
    text = fcd.read_text()
    assert text.endswith("\n")
    head, *lines = (line.split(";") for line in text.splitlines())
    assert {len(line) for line in lines} == {len(head)}
    count: dict[float, int] = {}
    for line in lines:
        count.setdefault(float(line[0]), 0)
        count[float(line[0])] += line[1].startswith("learned_")
    check_steps(list(count), list(count.values()), tmp_path / "s.json", signal.SIGTERM)


def test_nohup_stays_in_force() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible() as caught:
            signal.raise_signal(signal.SIGHUP)
            assert caught == []
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", SIGNALS)
def test_work_ends_at_once_or_after_what_is_tolerated(number: signal.Signals) -> None:
    with interruptible(tolerated=1) as caught:
        signal.raise_signal(number)
        assert caught == [number]
        with pytest.raises(KeyboardInterrupt) as interrupt:
            signal.raise_signal(number)
    assert interrupt.value.args == (number,)


def test_every_command_ends_with_the_code_of_the_signal(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that makes no provision for interrupts."""
    monkeypatch.setattr("slrl_sumo.sumo.scenario.shipped_scenarios", lambda: signal.raise_signal(signal.SIGHUP))
    assert cli("scenarios").returncode == 128 + signal.SIGHUP


def swallow() -> None:
    """As CPython does with exceptions in callbacks of weak references."""
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_that_is_lost_on_the_way_ends_the_work() -> None:
    with pytest.raises(KeyboardInterrupt) as interrupt, interruptible_to_the_end():
        swallow()
    assert interrupt.value.args == (signal.SIGINT,)
    begun = []
    with interruptible():
        swallow()
        with pytest.raises(KeyboardInterrupt), interruptible(tolerated=1):
            begun.append(1)
    assert not begun
    with interruptible(tolerated=1) as caught:
        assert caught == []


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.5, 0.8, 1.1, 1.6])
def test_an_interrupt_while_loading_ends_quietly(tmp_path: Path, delay: float) -> None:
    """Whatever has been reached by then: the code of the signal, no traceback, and no half a file."""
    command = [sys.executable, "-m", "slrl_sumo", "run", "intersection", "--agents", "4", "--steps", "100000"]
    fcd = tmp_path / "a.xml"
    with subprocess.Popen(
        [*command, "--fcd", str(fcd)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        try:
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert "Traceback" not in err
    # Before the command has begun, Python itself dies of the signal.
    assert process.returncode in (130, -signal.SIGINT)
    if fcd.exists():
        etree.parse(str(fcd))


@pytest.mark.slow
def test_an_interrupted_run_with_a_report_still_writes_it(tmp_path: Path) -> None:
    fcd = tmp_path / "a.xml"
    assert interrupt(tmp_path, fcd, signal.SIGTERM, "--report", str(tmp_path / "pictures")).returncode == 143
    assert (tmp_path / "pictures" / "paths.png").stat().st_size > 10_000
