"""The tool that kills commands: what it accepts, what it finds, and one kill."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.formats.fcd.write import FcdWriter
from tools.kills import AGENTS, expected_codes, one, wrong_run

WORDS = ["run", "--fcd", "a.xml"]


def outputs(folder: Path, times: tuple[float, ...], **figures: object) -> None:
    """Trace and summary of a run that SIGTERM ended."""
    places = Places(("car",) * AGENTS, ("",) * AGENTS, np.zeros(AGENTS), np.zeros(AGENTS, np.bool_))
    n = np.arange(AGENTS, dtype=np.float64)
    with FcdWriter(folder / "a.xml") as writer:
        for time in times:
            ids = [f"learned_car.{k}" for k in range(AGENTS)]
            writer.write(time, make_world(n, n, n, n, ids=ids, time=time), places)
    summary = {"interrupted": True, "ended_by": "SIGTERM", "end_s": times[-1], "decisions": len(times) - 1}
    (folder / "s.json").write_text(json.dumps(summary | figures))


def failures(folder: Path, code: int = 143, errors: str = "", hard: bool = False) -> str:
    return "; ".join(wrong_run(folder, WORDS, errors, code, hard))


def test_whole_outputs_are_accepted(tmp_path: Path) -> None:
    assert failures(tmp_path) == ""  # none at all
    outputs(tmp_path, (0.0, 0.4, 0.8))
    assert failures(tmp_path) == ""
    assert failures(tmp_path, 3, "SUMO died ...; complete up to there: a.xml, s.json; repeat it") == ""


def test_what_is_not_as_documented_is_found(tmp_path: Path) -> None:
    assert "message" in failures(tmp_path, 3, "SUMO died; outputs are complete")
    outputs(tmp_path, (0.0, 0.4, 1.2))
    assert "steps are missing" in failures(tmp_path)
    outputs(tmp_path, (0.0, 0.4), decisions=7)
    assert "summary: SIGTERM at 0.4, trace up to 0.4" in failures(tmp_path)
    outputs(tmp_path, (0.0, 0.4), interrupted=False)
    assert "summary" in failures(tmp_path)
    (tmp_path / "s.json").unlink()
    assert failures(tmp_path) == "no summary"
    assert failures(tmp_path, -9, hard=True) == ""
    trace = (tmp_path / "a.xml").read_bytes()
    (tmp_path / "a.xml").write_bytes(trace[:-40])
    assert "cut off" in failures(tmp_path)
    assert failures(tmp_path, -9, hard=True) == ""


def test_exit_codes_are_those_of_the_documentation() -> None:
    assert expected_codes("TERM", "both", False) == {143, -signal.SIGTERM}
    assert expected_codes("HUP", "child", True) == {143}
    assert expected_codes("KILL", "parent", False) == {-signal.SIGKILL}
    assert expected_codes("KILL", "child", False) == {3}


@pytest.mark.slow
def test_a_kill() -> None:
    row = one(1, 5)
    assert (row["signal"], row["target"], row["command"].split()[0]) == ("TERM", "both", "run")
    assert row["failures"] == []
