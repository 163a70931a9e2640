import json
import os
import signal
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from slrl_sumo.agent.stopwatch import PARTS, Stopwatch
from slrl_sumo.cli import app
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.studies.bench import bench
from slrl_sumo.studies.bench.bench import BenchSettings, workloads, write_bench
from slrl_sumo.studies.bench.learned import LearnedCost, typical
from slrl_sumo.studies.bench.measurement_process import DoesNotFit, Workload, measured

KEYS = {
    *("scenario", "agents", "cores", "agent_steps_per_s", "ms_per_decision", "parts_ms", "floor_ms"),
    *("sumo_updates_per_s", "peak_memory_mib"),
}
WORK = Workload("intersection", 4, 2, "car=0.5,pedestrian=0.5", "intersection", None, 3, 1)


def test_one_row_has_the_keys_and_its_figures_agree(tmp_path: Path) -> None:
    file = tmp_path / "bench.json"
    command = ["bench", "--json", str(file), "--scenarios", "intersection", "--agents", "4,5000", "--cores", "1"]
    result = CliRunner().invoke(app, [*command, "--steps", "3"])
    assert result.exit_code == 0, result.output
    found = json.loads(file.read_text())
    (row,) = found["rows"]
    assert set(row) >= KEYS
    assert (row["scenario"], row["agents"], row["cores"], row["selector"]) == ("intersection", 4, 1, "greedy")
    assert set(row["parts_ms"]) == set(PARTS)
    # Every part takes some time in a run of a looking policy, and together they are the decision.
    assert all(value > 0.0 for value in row["parts_ms"].values())
    assert row["ms_per_decision"] == pytest.approx(sum(row["parts_ms"].values()), abs=1e-3)
    assert row["agent_steps_per_s"] == pytest.approx(4000.0 / row["ms_per_decision"], rel=1e-3)
    assert row["floor_ms"] == pytest.approx(sum(row["floor_parts_ms"].values()), abs=1e-3)
    assert row["times_floor"] == pytest.approx(row["ms_per_decision"] / row["floor_ms"], rel=1e-2)
    assert row["times_sumo"] == pytest.approx(row["sumo_updates_per_s"] / row["agent_steps_per_s"], rel=1e-2)
    # PyTorch alone takes more than 100 MiB; a process that ran SUMO with 4 road users no GiB.
    assert 100.0 < row["peak_memory_mib"] < 1024.0
    assert "5000" in found["left_out"][0]
    assert "fit" in found["left_out"][0]


def _number(work: Workload) -> Generator[None, None, int]:
    yield
    return os.getpid()


def _refused(work: Workload) -> Generator[None, None, int]:
    raise DoesNotFit(f"{work.agents} are too many")
    yield


def _killed(work: Workload) -> Generator[None, None, int]:
    yield
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


@pytest.mark.slow
def test_each_copy_has_a_process_of_its_own_and_errors_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    # Where the new processes find this module.
    monkeypatch.syspath_prepend(Path(__file__).parents[3])
    pids = measured(_number, WORK)
    assert len({*pids, os.getpid()}) == 3
    with pytest.raises(DoesNotFit, match="4 are too many"):
        measured(_refused, WORK)
    with pytest.raises(SumoError, match="intersection with 4 road users"):
        measured(_killed, WORK)


def test_the_middle_half_of_the_decisions_counts() -> None:
    def decision(sumo: float, read: float) -> dict[str, float]:
        return {**dict.fromkeys(PARTS, 0.0), "sumo": sumo, "read": read}

    seconds = [decision(9.0, 9.0), decision(1.0, 3.0), decision(0.1, 0.1), decision(3.0, 2.0)]
    assert typical(seconds) == decision(2.0, 2.5)


def test_laps_make_up_all_of_the_time() -> None:
    watch = Stopwatch()
    begin = time.perf_counter()
    watch.take()
    for part in ("sumo", "read", "sumo"):
        time.sleep(0.002)
        watch.lap(part)
    whole = time.perf_counter() - begin
    parts = watch.take()
    assert parts["sumo"] >= 0.004
    assert parts["read"] >= 0.002
    assert sum(parts.values()) <= whole
    assert set(watch.take().values()) == {0.0}


def test_an_interrupt_keeps_the_rows_that_are_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cost = LearnedCost("greedy", 2, dict.fromkeys(PARTS, 0.001), {"moves": 0.001}, 200.0)

    def rows(works: list[Workload]) -> Iterator[dict[str, Any]]:
        yield bench._row(works[0], [cost, cost], [1000.0, 3000.0])
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(bench, "measure", rows)
    file = tmp_path / "bench.json"
    assert write_bench(BenchSettings(agents=(7, 8), cores=(2,)), file) == signal.SIGINT
    (row,) = json.loads(file.read_text())["rows"]
    # Two simulations of 7 in 7 ms a decision; a SUMO step of one of its road users takes 0.5 ms, two in a decision.
    assert row["agent_steps_per_s"] == pytest.approx(2000.0)
    assert row["sumo_updates_per_s"] == pytest.approx(4000.0)
    assert row["times_sumo"] == pytest.approx(1.0)
    assert row["peak_memory_mib"] == pytest.approx(400.0)
    assert "2000" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (BenchSettings(agents=(0,)), "agents=0"),
        (BenchSettings(cores=(0,)), "cores=0"),
        (BenchSettings(steps=0), "steps=0"),
        (BenchSettings(seed=-1), "seed=-1"),
        (BenchSettings(scenarios=("nowhere",)), "nowhere"),
        (BenchSettings(mix="boat=1"), "boat"),
    ],
)
def test_wrong_settings_are_named(settings: BenchSettings, words: str) -> None:
    with pytest.raises(InputError, match=words):
        workloads(settings)


def test_every_combination_is_measured_one_core_first() -> None:
    works = workloads(BenchSettings(scenarios=("intersection", "district"), agents=(16, 64), cores=(1, 3)))
    found = [(work.scenario, work.agents, work.cores) for work in works]
    assert found[:3] == [("intersection", 16, 1), ("intersection", 16, 3), ("intersection", 64, 1)]
    assert len(set(found)) == 8
