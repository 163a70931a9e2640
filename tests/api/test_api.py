"""The Python API: runs, simulations and errors as scripts and notebooks use them."""

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
import torch

import slrl_sumo
from slrl_sumo.sumo.scenario import find_scenario

WORDS: dict[str, Any] = {"agents": 10, "takeover": {"car": 0.5, "bicycle": 1}, "steps": 30, "seed": 2}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> slrl_sumo.RunResult:
    """A run of ten spawned road users and some of the scenario's own, with its summary as a file."""
    folder = tmp_path_factory.mktemp("run")
    return slrl_sumo.run("intersection", **WORDS, fcd=folder / "a.csv", summary=folder / "s.json")


def test_all_public_names_exist_and_importing_the_package_is_cheap() -> None:
    for name in slrl_sumo.__all__:
        assert getattr(slrl_sumo, name) is not None
    assert set(slrl_sumo.__all__) <= set(dir(slrl_sumo))
    with pytest.raises(AttributeError, match="has no attribute 'walk'"):
        slrl_sumo.walk  # noqa: B018
    code = "import slrl_sumo, sys; print({'torch', 'numpy', 'libsumo', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_the_summary_is_typed_and_is_that_of_the_file(result: slrl_sumo.RunResult) -> None:
    assert result.fcd is not None
    assert result.summary.to_dict() == json.loads(result.fcd.with_name("s.json").read_text())
    assert (result.summary.scenario, result.summary.seed, result.summary.decisions) == ("intersection", 2, 30)
    assert result.summary.per_type["car"].count > 0
    page = result._repr_html_()
    assert page == result.summary._repr_html_()
    assert page.startswith("<table><caption>intersection: ")
    assert page.count("<tr>") == 1 + sum(values.count > 0 for values in result.summary.per_type.values())


def test_a_notebook_shows_the_replay_and_the_summary_as_a_table(result: slrl_sumo.RunResult) -> None:
    shown = result.show(height=300)._repr_html_()
    assert shown.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert 'height="300"' in shown
    assert shown.count('"') == 2 * shown.count('="')  # the page is inside one attribute
    table = result.summary.to_pandas()
    assert list(table.index) == [name for name, values in result.summary.per_type.items() if values.count]
    assert table.loc["car", "mean_speed_mps"] == result.summary.per_type["car"].mean_speed_mps


def test_a_comparison_is_a_table(tmp_path: Path) -> None:
    found = slrl_sumo.compare("intersection", out=tmp_path / "c", takeover={"car": 1}, seeds=1, seconds=12, workers=1)
    table = found.to_pandas()
    row = table[(table.measure == "speed") & (table.type == "car")].iloc[0]
    assert (row.unit, row.verdict, row.seeds) == ("m/s", "too few seeds", 1)
    assert row.difference == pytest.approx(row.learned - row.sumo)
    assert found.page.is_file()
    assert found._repr_html_().count("<tr>") == 1 + len(table)
    assert json.loads((tmp_path / "c" / "results.json").read_text()) == found.result
    with pytest.raises(slrl_sumo.InputError, match="seeds=0: give a whole number"):
        slrl_sumo.compare("intersection", out=tmp_path / "d", seeds=0)


def test_trajectories_are_a_table_with_modes(result: slrl_sumo.RunResult) -> None:
    tracks = result.trajectories
    frame = tracks.to_pandas()
    assert len(frame) == len(tracks)
    assert list(frame.columns[:7]) == ["time_s", "id", "type", "learned", "mode", "x_m", "y_m"]
    assert set(frame.columns[7:]) == {
        *("heading_rad", "speed_mps", "acceleration_mps2", "yaw_rate_radps", "length_m", "width_m"),
    }
    assert frame.time_s.nunique() == 31
    learned = frame[frame.learned]
    assert (learned[learned.id.str.startswith("learned_")].groupby("time_s", observed=True).size() == 10).all()
    assert not learned.id.str.startswith("learned_").all()
    # A mode leads to every row of a learned road user but the first ones.
    assert learned[learned.time_s > learned.time_s.min()]["mode"].notna().mean() > 0.9
    assert frame[~frame.learned]["mode"].isna().all()
    assert set(frame.type.unique()) <= {"car", "bicycle", "pedestrian"}


@pytest.mark.parametrize(
    ("scenario", "words", "suffix"),
    [
        # Added road users leave the scene and are reinserted at its other side.
        ("intersection", {"agents": 24, "steps": 60, "seed": 1}, ".csv"),
        ("intersection", {"agents": 24, "steps": 60, "seed": 1}, ".xml"),
        ("intersection", WORDS, ".parquet"),
        # In CSV a trace begins with its first road user: here between two decisions.
        ("signalised", {"takeover": {"car": 0.5, "pedestrian": 0.5}, "steps": 100, "step_length": 0.1}, ".xml"),
    ],
)
def test_a_trace_is_read_as_the_trajectories_of_its_run(
    tmp_path: Path, scenario: str, words: dict[str, Any], suffix: str
) -> None:
    result = slrl_sumo.run(scenario, **words, fcd=tmp_path / f"t{suffix}")
    tracks, trace = result.trajectories, slrl_sumo.read_fcd(tmp_path / f"t{suffix}")
    assert sorted(trace.ids) == sorted(tracks.ids)
    assert trace.t0 == pytest.approx(tracks.t0)
    if "takeover" not in words:
        assert result.summary.wrapped_around > 5
        assert len(tracks.ids) > len({name.partition("#")[0] for name in tracks.ids}) + 5
    for number, name in enumerate(tracks.ids):
        theirs = trace.ids.index(name)
        mine, same = tracks.track == number, trace.track == theirs
        np.testing.assert_array_equal(trace.frame[same], tracks.frame[mine], name)
        np.testing.assert_array_equal(trace.mode[same], tracks.mode[mine], name)
        assert trace.learned[theirs] == tracks.learned[number]
        # Traces have no lengths: where the default is another, centres turn about the front bumpers otherwise.
        usual = abs(tracks.length[number] - trace.length[theirs]) < 1e-9
        for axis, along in (("x", np.cos), ("y", np.sin)):
            fronts = [
                getattr(each, axis)[rows] + 0.5 * each.length[k] * along(each.heading[rows])
                for each, rows, k in ((trace, same, theirs), (tracks, mine, number))
            ]
            np.testing.assert_allclose(*fronts, atol=0.002, err_msg=name)
        np.testing.assert_allclose(trace.speed[same], tracks.speed[mine], atol=0.01 if usual else 0.5, err_msg=name)


def test_report_and_replay_can_be_written_afterwards(result: slrl_sumo.RunResult, tmp_path: Path) -> None:
    page = result.report(tmp_path / "report")
    assert page == tmp_path / "report" / "report.html"
    assert {p.name for p in page.parent.iterdir()} >= {"report.html", "paths.png", "modes.png", "ego_images.png"}
    of_trace = result.replay(tmp_path / "trace.html")
    assert of_trace.stat().st_size > 30_000
    kept = slrl_sumo.RunResult(result.settings, result.summary, result.record)
    assert kept.replay(tmp_path / "kept.html").stat().st_size > 30_000
    with pytest.raises(slrl_sumo.InputError, match="does not exist"):
        result.report(tmp_path / "no" / "report")
    bare = slrl_sumo.RunResult(result.settings, result.summary)
    with pytest.raises(slrl_sumo.InputError, match=r"keep_trajectories=True"):
        _ = bare.trajectories


@pytest.mark.slow
def test_a_script_needs_no_main_guard_and_its_threads_may_run(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import slrl_sumo\n"
        "result = slrl_sumo.run('intersection', agents=3, steps=2, keep_trajectories=False)\n"
        "print(result.summary.agent_steps)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(slrl_sumo.__file__).parents[1])}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr, done.returncode) == ("6\n", "", 0)


def test_a_run_in_another_thread(tmp_path: Path) -> None:
    results: list[slrl_sumo.RunResult] = []
    work = threading.Thread(
        target=lambda: results.append(slrl_sumo.run("intersection", agents=2, steps=2, keep_trajectories=False))
    )
    work.start()
    work.join(timeout=120)
    assert results[0].summary.agent_steps == 4


def test_a_simulation_yields_the_decisions_of_a_run(result: slrl_sumo.RunResult) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with slrl_sumo.Simulation("intersection", **WORDS) as simulation:
            assert simulation.started.decisions == 30
            positions = []
            for decision in simulation:
                assert torch.get_num_threads() == 2
                assert simulation.world is decision.steps[-1].world
                positions.append(simulation.world.x[simulation.world.ids.index("learned_car.0")])
        assert libsumo.isLoaded() is False
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    frame = result.trajectories.to_pandas()
    theirs = frame[frame.id == "learned_car.0"].x_m.to_numpy()
    assert positions[: len(theirs) - 1] == theirs[1:].tolist()
    with pytest.raises(slrl_sumo.InputError, match="with statement"):
        next(simulation)


def test_a_simulation_that_is_left_early_closes_sumo() -> None:
    simulation = slrl_sumo.Simulation(find_scenario("intersection"), agents=2)
    with simulation:
        next(simulation)
        assert libsumo.isLoaded()
    assert libsumo.isLoaded() is False


def test_attach_takes_typed_arguments_and_leaves_the_thread_count() -> None:
    config = str(find_scenario("intersection").config)
    libsumo.start(["sumo", "-c", config, "--step-length", "0.4", "--no-step-log", "--time-to-teleport", "-1"])
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        for _ in range(40):
            libsumo.simulationStep()
        region = slrl_sumo.JunctionRegion("centre", radius=120)
        words: dict[str, Any] = {"agents": 4, "mix": {"car": 1, "bicycle": 1}, "takeover": {"car": 1}}
        with slrl_sumo.attach(libsumo, **words, region=region) as learned:
            assert torch.get_num_threads() == 2
            for _ in range(3):
                learned.step()
            assert torch.get_num_threads() == 2
            assert sum(name.startswith("learned_") for name in learned.ids) == 4
            assert len(learned.ids) > 4
    finally:
        torch.set_num_threads(before)
        libsumo.close()


@pytest.mark.parametrize(
    ("words", "python", "options"),
    [
        (
            {"takeover": {"car": 3}},
            "takeover={'car': 3}: the share of car must be a number from 0 to 1; write for example car=0.3",
            None,
        ),
        (
            {"takeover": "car=3"},
            "takeover='car=3': the share of car must be a number from 0 to 1; write for example car=0.3",
            "--takeover car=3: the share of car must be a number from 0 to 1; write for example car=0.3",
        ),
        ({"agents": 0}, "agents=0: give a whole number from 1 to 1000000", "--agents 0: give a whole number from 1 to"),
        ({"agents": 2, "seed": 1.5}, "seed=1.5: give a whole number", "--seed 1.5: "),
        ({"agents": 2, "until": 0.0}, "until=0.0: the scenario begins at 0 s", "--until 0: the scenario begins at 0 s"),
        (
            {"mix": {"car": 1}, "takeover": {"car": 1}},
            "mix={'car': 1}: the shares are those of `agents`, which is not given; add `agents=N`",
            "--mix {'car': 1}: the shares are those of --agents, which is not given; add --agents N",
        ),
        ({}, "no learned road user: give `agents=N`, or `takeover=", "give --agents N, or --takeover car=0.3 to take"),
        (
            {"agents": 2, "selector": "lane", "guard": True},
            "guard: `selector='lane'` chooses no modes",
            "--guard: --selector lane chooses no modes",
        ),
        ({"agents": 2, "selector": "best"}, "selector='best': there is none of that name", "--selector best: there is"),
        ({"agents": 2, "step_length": 0.3}, "step_length=0.3: ", "--step-length 0.3: "),
        ({"agents": 2, "sumo_options": "-c x"}, "sumo_options: -c names", "--sumo-options: -c names"),
    ],
)
def test_errors_name_arguments_here_and_options_on_the_command_line(
    words: dict[str, Any], python: str, options: str | None
) -> None:
    with pytest.raises(slrl_sumo.InputError) as caught, slrl_sumo.Simulation("intersection", **words):
        pass
    assert str(caught.value).startswith(python)
    assert "--" not in re.sub("write --name value", "", str(caught.value))
    if options is not None:
        assert options in caught.value.as_options()


def test_errors_of_the_child_process_keep_their_argument() -> None:
    with pytest.raises(slrl_sumo.InputError, match=r"^agents=5000: only") as caught:
        slrl_sumo.run("intersection", agents=5000, steps=1)
    assert caught.value.argument == "agents"
    assert caught.value.as_options().startswith("--agents 5000: only")


def test_the_package_runs_as_a_module(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "slrl_sumo", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == slrl_sumo.__version__


def test_pandas_is_asked_for_where_it_is_missing(result: slrl_sumo.RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(slrl_sumo.InputError, match=r"pip install 'slrl-sumo\[pandas\]'"):
        result.trajectories.to_pandas()


def test_the_example_runs(tmp_path: Path) -> None:
    root = Path(slrl_sumo.__file__).parents[1]
    command = [sys.executable, root / "docs" / "examples" / "run_and_look.py", "intersection", tmp_path]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1000 decisions, ")
    assert (tmp_path / "report" / "report.html").is_file()
    assert (tmp_path / "replay.html").is_file()
