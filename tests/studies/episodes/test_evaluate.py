"""`evaluate SCENARIO`: the same tables whatever happens on the way, and clear words where something is wrong."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.jobs.pool import Backend
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.studies.episodes.episode import Episode, recorded
from slrl_sumo.studies.episodes.evaluate import EvaluationSettings, evaluate_scenario
from slrl_sumo.studies.episodes.tables import COLUMNS

Cli = Callable[..., subprocess.CompletedProcess[str]]

SMALL = EvaluationSettings(
    "intersection", "intersection", selectors=("prior", "sumo"), agents=(4, 9), episodes=2, steps=8, seeds=2
)
PARTIES = {("prior", 4), ("prior", 9), ("sumo", 0)}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """SMALL evaluated without disturbance by two workers: the result and its folder."""
    folder = tmp_path_factory.mktemp("evaluated")
    return evaluate_scenario(replace(SMALL, backend=Backend(2)), folder), folder


@pytest.fixture(scope="module")
def walk() -> Trajectories:
    """One pedestrian that walks at 1 m/s along x for 25 intervals, past one that is parked."""
    ways = (0.4 * np.arange(26), 0.0, 0.0), (np.full(26, 5.0), 0.2, 0.0)
    return make_recording(*ways, type=2, ids=("walker", "parked"), parked=np.array([False, True]))


@pytest.mark.slow
def test_tables_do_not_depend_on_the_number_of_workers(small: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    assert evaluate_scenario(replace(SMALL, backend=Backend(1)), tmp_path) == small[0]


def test_rows_are_those_of_the_contract(small: tuple[dict[str, Any], Path]) -> None:
    rows = small[0]["rows"]
    assert {(row["selector"], row["agents"]) for row in rows} == PARTIES
    for row in rows:
        assert tuple(row) == COLUMNS
        assert row["episodes"] == 4
        assert 0 <= row["success_rate"] <= 1
        assert 0 <= row["paper_survival_steps"] <= 8
        assert row["mean_speed_mps_seed_std"] >= 0
    learned = {(row["agents"], row["type"]): row["road_users"] for row in rows if row["selector"] == "prior"}
    # The default mix: halves, fifths and three tenths, in each of four episodes.
    assert [learned[4, kind] for kind in ("car", "bicycle", "pedestrian")] == [8, 4, 4]
    assert sum(count for (agents, _), count in learned.items() if agents == 9) == 36
    # SUMO's own models do not drive into each other, and keep to their lanes.
    (cars,) = (row for row in rows if row["selector"] == "sumo" and row["type"] == "car")
    assert (cars["success_rate"], cars["paper_survival_steps"], cars["off_surface_share"]) == (1.0, 8.0, 0.0)
    assert cars["mean_speed_mps"] > 3
    assert small[0]["left_out"] == []


def test_seeds_and_episodes_differ(small: tuple[dict[str, Any], Path]) -> None:
    lines = [json.loads(line) for line in (small[1] / "episodes.jsonl").read_text().splitlines()[1:]]
    assert len(lines) == 3 * 2 * 2
    speeds = [line["outcome"][0]["speed_sum"] for line in lines if line["agents"] == 9]
    assert len(set(speeds)) == 4
    assert Episode("prior", 9, 1, 0).draw == Episode("sumo", 0, 1, 0).draw


@pytest.mark.slow
@pytest.mark.parametrize("cut", [0.35, 0.7])
def test_a_killed_evaluation_goes_on_where_it_was(
    small: tuple[dict[str, Any], Path], tmp_path: Path, cut: float
) -> None:
    whole = (small[1] / "episodes.jsonl").read_bytes()
    (tmp_path / "episodes.jsonl").write_bytes(whole[: int(cut * len(whole))])
    done = []
    assert evaluate_scenario(SMALL, tmp_path, progress=lambda *news: done.append(news[:2])) == small[0]
    assert 0 < done[0][0] < 12
    assert done[-1] == (12, 12)
    lines = (tmp_path / "episodes.jsonl").read_bytes().splitlines()
    assert sorted(lines[1:]) == sorted(whole.splitlines()[1:])


def test_episodes_that_are_there_are_not_played_again(small: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    (tmp_path / "episodes.jsonl").write_bytes((small[1] / "episodes.jsonl").read_bytes())
    done = []
    less = replace(SMALL, agents=(9,), seeds=1)
    rows = evaluate_scenario(less, tmp_path, progress=lambda *news: done.append(news[:2]))["rows"]
    assert done == [(4, 4)]
    assert {(row["selector"], row["agents"], row["episodes"]) for row in rows} == {("prior", 9, 2), ("sumo", 0, 2)}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"steps": 9}, "steps 8, not 9"),
        ({"scenario": "shared-space"}, "scenario"),
        ({"bundle": "shared-space"}, "bundle"),
    ],
)
def test_episodes_of_other_settings_are_not_mixed_in(
    small: tuple[dict[str, Any], Path], tmp_path: Path, change: dict[str, Any], word: str
) -> None:
    (tmp_path / "episodes.jsonl").write_bytes((small[1] / "episodes.jsonl").read_bytes())
    with pytest.raises(InputError, match=word) as error:
        evaluate_scenario(replace(SMALL, **change), tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["nothing of ours\n", '{"a": 1}\n[]\n', "\xff\n"])
def test_a_damaged_file_of_episodes_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "episodes.jsonl").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"episodes\.jsonl"):
        evaluate_scenario(SMALL, tmp_path)


def test_policies_are_evaluated_too(tmp_path: Path) -> None:
    bundle = tmp_path / "bundle"
    replace(load_bundle("intersection"), policy=Policy(PolicyConfig()), policy_training={}).save(bundle)
    settings = EvaluationSettings("shared-space", str(bundle), agents=(5,), episodes=1, steps=6)
    rows = evaluate_scenario(settings, tmp_path / "out")["rows"]
    assert list(dict.fromkeys(row["selector"] for row in rows)) == ["prior", "greedy", "sampled", "sumo"]
    speeds = {row["selector"]: row["mean_speed_mps"] for row in rows if row["type"] == "car"}
    assert speeds["greedy"] != speeds["sampled"]


def test_recorded_road_users_are_counted_in_whole_spans(walk: Trajectories) -> None:
    spans = [outcome for (outcome,) in recorded(walk, 8)]
    assert [span.present for span in spans] == [(8,), (8,), (8,)]  # the parked one does not count
    assert [span.paper_survived for span in spans] == [(8,), (3,), (8,)]  # at 4.8 m, after 12 intervals, it is hit
    assert [span.paper_collisions for span in spans] == [0, 1, 0]
    assert all(span.speed_sum == pytest.approx(8.0) and span.off_surface is None for span in spans)
    with pytest.raises(InputError, match="25 intervals"):
        list(recorded(walk, 26))


def test_the_command_writes_tables(cli: Cli, walk: Trajectories, tmp_path: Path) -> None:
    walk.save(tmp_path / "walk.npz")
    words: list[object] = ["intersection", "--bundle", "intersection", "--selectors", "prior,sumo", "--agents", "4,4,6"]
    words += ["--episodes", 2, "--steps", 8, "--recording", tmp_path / "walk.npz", "--out", tmp_path / "out"]
    done = cli("evaluate", *words)
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads((tmp_path / "out" / "results.json").read_text())
    parties = {(row["selector"], row["agents"]) for row in result["rows"]}
    assert parties == {("prior", 4), ("prior", 6), ("sumo", 0), ("recorded", 0)}
    (walker,) = (row for row in result["rows"] if row["selector"] == "recorded")
    assert (walker["mean_speed_mps"], walker["off_surface_share"], walker["episodes"]) == (1.0, None, 3)
    assert {row["table"] for row in result["published"]} == {"Table 1", "Table 2"}
    with open(tmp_path / "out" / "results.csv", newline="") as file:
        assert len(list(csv.DictReader(file))) == len(result["rows"])
    assert "SL+RL (inD)*" in done.stdout
    assert "measured elsewhere" in done.stdout
    assert "uniD" not in done.stdout


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["intersection", "--starts", 3], "--starts 3: belongs to a recording"),
        (["some.npz", "--agents", 16], "--agents 16: belongs to a scenario"),
        (["some.npz", "--workers", 1], "--workers 1: belongs to a scenario"),
        (["nowhere"], "nowhere: no such file, folder or shipped scenario"),
        (["intersection", "--selectors", "prior,best"], "--selectors best: there is none of that name"),
        (["intersection", "--selectors", "greedy"], "no trained selector"),
        (["intersection", "--agents", "16;32"], "--agents 16;32: give whole numbers"),
        (["intersection", "--agents", "0"], "--agents 0: give numbers from 1"),
        (["intersection", "--episodes", 0], "--episodes 0"),
        (["intersection", "--seeds", -1], "--seeds -1"),
        (["intersection", "--recording", "none.npz"], "none.npz"),
        (["intersection", "--agents", "5000"], "fit into this network"),
    ],
)
def test_what_cannot_be_evaluated_is_refused_in_one_line(
    cli: Cli, tmp_path: Path, untrained: Path, words: list[str], complaint: str
) -> None:
    done = cli("evaluate", *words, "--bundle", untrained, "--out", tmp_path / "out", cwd=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert complaint in line
    assert not (tmp_path / "out" / "results.json").exists()


@pytest.fixture(scope="session")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle without a policy."""
    folder = tmp_path_factory.mktemp("bundles") / "untrained"
    replace(load_bundle("intersection"), policy=None).save(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_keeps_what_is_finished(tmp_path: Path, number: signal.Signals, code: int) -> None:
    log = tmp_path / "out" / "episodes.jsonl"
    (tmp_path / "tmp").mkdir()
    words = "evaluate intersection --bundle intersection --selectors prior --agents 4 --steps 8 --episodes 100000"
    with subprocess.Popen(
        [sys.executable, "-m", "slrl_sumo", *words.split(), "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path / "tmp")},
        start_new_session=True,
    ) as process:
        deadline = time.monotonic() + 120
        while not log.exists() or log.read_bytes().count(b"\n") < 4:
            assert process.poll() is None
            assert time.monotonic() < deadline, "no episode is finished"
            time.sleep(0.05)
        os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (code, "")
    (line,) = err.splitlines()
    assert "interrupted" in line
    assert all(json.loads(each) for each in log.read_text().splitlines())
    assert list((tmp_path / "tmp").iterdir()) == []
