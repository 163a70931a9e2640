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
