"""`slrl-sumo evaluate FILE` as a process of its own."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from builders import make_bundle, make_recording

Cli = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A cyclist and a walker that go east for 12 s, at y = -3 and -6 m."""
    path = tmp_path / "recording.npz"
    ways = (np.linspace(1.0, 47.4, 30), -3.0, 0.0), (np.linspace(1.0, 15.5, 30), -6.0, 0.0)
    make_recording(*ways, type=(1, 2), ids=("a", "b"), source="made").save(path)
    return path


def test_ground_from_a_mask_or_road_everywhere(cli: Cli, file: Path, tmp_path: Path) -> None:
    mask = np.full((10, 60, 3), 255, np.uint8)  # 60 x 10 m
    mask[:, 20:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    command = ("evaluate", file, "--bundle", "shared-space-paper", "--starts", 10, "--out", tmp_path / "out")
    done = cli(*command, "--mask", tmp_path / "mask.png", "--metres-per-pixel", 1)
    assert done.returncode == 0, done.stderr
    assert "surface: mask" in done.stdout
    result = json.loads((tmp_path / "out" / "results.json").read_text())
    shares = {(row["selector"], row["type"]): row["share"] for row in result["off_surface"]}
    assert shares["recorded", "pedestrian"] == 0.0
    assert shares["recorded", "bicycle"] == pytest.approx(18 / 30)  # beyond 20 m from the 13th position on
    assert {row["selector"] for row in result["rows"]} == {
        "constant-velocity",
        "prior",
        "step-oracle",
        "mode-oracle",
        "greedy",
        "sampled",
    }

    first = _by_selector(tmp_path / "out" / "results.csv")
    plain = cli(*command)
    assert plain.returncode == 0
    assert "everything is road (no --net or --mask was given)" in plain.stdout
    second = _by_selector(tmp_path / "out" / "results.csv")
    # Only the trained selector looks at the ground.
    assert {name for name in first if first[name] != second[name]} == {"greedy", "sampled"}


def _by_selector(results: Path) -> dict[str, list[str]]:
    """The lines of a results.csv by their first column, the selector."""
    lines = results.read_text().splitlines()[1:]
    return {name: [line for line in lines if line.startswith(f"{name},")] for name in {x.split(",")[0] for x in lines}}


def test_wrong_input_gets_one_line(cli: Cli, file: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_bytes(file.read_bytes()[:500])
    given = ("--bundle", "shared-space", "--out", tmp_path / "out")
    untrained = tmp_path / "untrained"
    make_bundle().save(untrained)
    for words, message in (
        ((tmp_path / "none.npz", *given), "cannot read"),
        ((tmp_path / "broken.npz", *given), "is not a trajectories file or is damaged"),
        ((file, *given, "--bundle", untrained, "--selectors", "greedy"), "bundle random has no trained selector"),
        ((file, *given, "--mask", tmp_path / "m.png"), "--mask and --metres-per-pixel belong together"),
        ((file, *given, "--episodes", 3), "--episodes 3: belongs to a scenario"),
    ):
        done = cli("evaluate", *words)
        assert done.returncode == 1
        assert message in done.stderr
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
