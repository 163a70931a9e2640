"""`slrl-sumo train` as a user types it, up to a run with the new selector."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

Cli = Callable[..., subprocess.CompletedProcess[str]]

SMALL = """
[ppo]
num_steps = 8
update_epochs = 1
[arena]
agents = 12
[imitation]
epochs = 1
seconds = 40
[networks]
count = 2
reset_every = 2
"""

TRIPS = (
    SMALL
    + """
[policy]
preset = "extended"
image = false
prior_logits = false
[reward]
danger = 0.0
"""
)


@pytest.mark.slow
def test_a_selector_goes_on_in_trips_through_a_town(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "trips.toml").write_text(TRIPS.replace("agents = 12", "agents = 12\ntrips = true\nwarm_up = 20.0"))
    words = ["--config", "trips.toml", "--workers", "1", "--episodes", "0"]
    first = cli("train", "town", "--bundle", "intersection", "--out", "a", "--steps", "192", *words, cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    assert "reached" in first.stderr
    assert "contacts" in first.stderr
    more = cli("train", "town", "--from", "a", "--out", "b", "--steps", "96", *words, cwd=tmp_path)
    assert more.returncode == 0, more.stderr
    record = json.loads((tmp_path / "b" / "selector.json").read_text())
    assert record["image"] is False
    assert record["training"]["goes_on"] is True
    run = cli("run", "intersection", "--bundle", "b", "--selector", "greedy", "--agents", 4, "--steps", 3, cwd=tmp_path)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("words", [["--bundle", "intersection", "--from", "intersection"]])
def test_a_training_starts_anew_or_goes_on(cli: Cli, tmp_path: Path, words: list[str]) -> None:
    done = cli("train", "random", "--out", "a", *words, cwd=tmp_path)
    assert done.returncode == 1
    assert "give either --bundle" in done.stderr


@pytest.mark.slow
def test_from_a_bundle_to_a_run_of_its_trained_selector(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    words = ["train", "shared-space", "--bundle", "intersection", "--out", "mine", "--config", "small.toml"]
    done = cli(*words, "--steps", "600", "--workers", "2", "--episodes", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "training: 576/576" in done.stderr
    assert "mine: bundle with a trained selector" in done.stdout
    assert (tmp_path / "mine" / "selector.safetensors").is_file()
    assert list((tmp_path / "mine-training" / "tensorboard").glob("events*"))
    assert len(list((tmp_path / "mine-training" / "networks").iterdir())) == 2
    closing = json.loads((tmp_path / "mine-training" / "evaluation" / "results.json").read_text())
    assert {row["selector"] for row in closing["rows"]} == {"prior", "greedy", "sampled", "sumo"}
    assert json.loads((tmp_path / "mine" / "selector.json").read_text())["training"]["scenarios"] == "shared-space"

    summaries = []
    for selector in ("greedy", "sampled"):
        run = ["run", "shared-space", "--bundle", "mine", "--selector", selector, "--agents", "8", "--steps", "10"]
        done = cli(*run, "--summary", "s.json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        summaries.append(json.loads((tmp_path / "s.json").read_text()))
        assert summaries[-1]["selector"] == selector
    assert summaries[0]["per_type"] != summaries[1]["per_type"]

    again = cli(*words, "--steps", "600", cwd=tmp_path)
    assert again.returncode == 1
    assert "continue it with --resume" in again.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "nowhere: no such file, folder or shipped scenario"),
        (["random", "--steps", "0"], "--steps 0: give a whole number"),
        (["random", "--workers", "0"], "--workers 0: give a whole number"),
        (["random", "--device", "abacus"], "--device abacus"),
        (["random", "--config", "gone.toml"], "gone.toml: cannot be read"),
    ],
)
def test_wrong_words_get_one_line(cli: Cli, tmp_path: Path, words: list[str], message: str) -> None:
    done = cli("train", *words, "--bundle", "intersection", "--out", str(tmp_path / "b"), cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "b").exists()
    assert not (tmp_path / "b-training" / "networks").exists()
