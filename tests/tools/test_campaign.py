"""The campaign tool: the same seed draws the same runs, and what goes wrong in them is counted."""

import json
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from slrl_sumo.sumo.scenario import find_scenario
from tools.campaign import counts, draw_scenario, one
from tools.odd_runs import Verdict, draw_others, draw_run, ends_by_itself, judged, wrong_trace

ROOT = Path(__file__).parents[2]
STEP = '<timestep time="{}"><vehicle id="learned_car.0"/></timestep>'


def test_a_seed_and_a_number_draw_the_same_run(tmp_path: Path) -> None:
    drawn = []
    for name in ("a", "b"):
        folder = tmp_path / name / "here"
        folder.mkdir(parents=True)
        random = Random("5")
        scenario, odd = draw_scenario(random, folder)
        words = [*draw_others(random, scenario, folder), draw_run(random, scenario, folder)]
        files = {f.name: f.read_bytes() for f in folder.glob("odd.*") if f.suffix != ".xml" or ".net" not in f.name}
        drawn.append((odd, files, [word.replace(str(folder), "") for command in words for word in command]))
    assert drawn[0] == drawn[1]
    assert {"odd.sumocfg", "odd.rou.xml", "odd.add.xml"} <= set(drawn[0][1])


@pytest.mark.parametrize(
    ("code", "errors", "outcome"),
    [
        (0, "", "ok"),
        (1, "slrl-sumo: no such file", "refused"),
        (1, "Traceback (most recent call last):", "traceback"),
        (2, "Usage: run", "usage"),
        (3, "slrl-sumo: SUMO died", "exit 3"),
        (4, "slrl-sumo: please report", "traceback"),
        (-11, "", "crash"),
    ],
)
def test_outcomes(code: int, errors: str, outcome: str) -> None:
    assert judged(code, errors, find_scenario("intersection"))[0] == outcome


def test_what_plain_sumo_refuses_is_no_failure_of_the_package(tmp_path: Path) -> None:
    (tmp_path / "x.sumocfg").write_text('<configuration><net-file value="gone.net.xml"/></configuration>')
    outcome, line = judged(3, "", find_scenario(str(tmp_path)))
    assert outcome == "SUMO refuses"
    assert "gone.net.xml" in line


@pytest.mark.parametrize(("plan", "ends"), [('<stop lane="in0_0" duration="1e9"/>', False), ("", True)])
def test_scenarios_that_plain_sumo_does_not_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plan: str, ends: bool
) -> None:
    net = find_scenario("intersection").config.with_name("intersection.net.xml")
    person = f'<person id="p" depart="0">{plan}<walk from="in0" to="out2"/></person>'
    (tmp_path / "n.rou.xml").write_text(f"<routes>{person}</routes>")
    files = f'<net-file value="{net}"/><route-files value="n.rou.xml"/><step-length value="0.4"/>'
    (tmp_path / "n.sumocfg").write_text(f"<configuration>{files}</configuration>")
    monkeypatch.setattr("tools.odd_runs.PATIENCE", 3.0)
    assert ends_by_itself(find_scenario(str(tmp_path))) == ends


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        (STEP.format(0) + STEP.format(0.4), ""),
        (STEP.format(0), "1 time steps, not 2"),
        (STEP.format(0) + '<timestep time="0.4"/>', "0 of 1 spawned road users at 0.4 s"),
        (STEP.format(0) + "<timestep", "not well-formed after 1 time steps"),
    ],
)
def test_traces_that_do_not_fit_the_run(tmp_path: Path, text: str, wrong: str) -> None:
    trace = tmp_path / "trace.xml"
    trace.write_text(f"<fcd-export>{text}</fcd-export>")
    found = wrong_trace(trace, steps=2, spawned=1)
    assert found.startswith(wrong)
    assert bool(found) == bool(wrong)
    if wrong.startswith("0 of 1"):
        assert wrong_trace(trace, steps=2, spawned=1, removed=[0.2]) == ""


def test_failures_are_counted() -> None:
    rows = [{"outcome": "ok", "figures": {"agent_steps": 7}}, {"outcome": "hang", "figures": {}}]
    found = counts([{"commands": rows}])
    assert (found["runs"], found["commands"], found["agent_steps"], found["hang"], found["lost"]) == (1, 2, 7, 1, 0)
    assert Verdict(["run"], "hang").failed
    assert not Verdict(["run"], "refused").failed


def test_the_folder_of_a_failure_is_kept_with_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.campaign.execute", lambda words, scenario: Verdict(words, "crash"))
    run = one(5, 0, tmp_path / "kept")
    assert {row["failed"] for row in run["commands"]} == {True}
    assert str(tmp_path / "kept" / "5-0") in run["commands"][-1]["command"]
    assert (tmp_path / "kept" / "5-0").is_dir()


@pytest.mark.slow
def test_a_small_campaign_is_continued(tmp_path: Path) -> None:
    """Seed 9 draws doctor and two runs in generated networks: half the work of seed 2, which compares, too."""
    file = tmp_path / "campaign.json"
    for runs in (1, 2):
        words = ["--runs", str(runs), "--agent-steps", "1", "--seed", "9", "--json", str(file), "--keep", str(tmp_path)]
        command = [sys.executable, "-m", "tools.campaign", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
        record = json.loads(file.read_text())
        assert [run["number"] for run in record["runs"]] == list(range(runs))
    assert record["counts"]["agent_steps"] > 0
