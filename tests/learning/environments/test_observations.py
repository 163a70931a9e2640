"""Training has the vector of the paper: bundles that read more are refused."""

import subprocess
from collections.abc import Callable
from pathlib import Path

from builders import make_bundle

Cli = Callable[..., "subprocess.CompletedProcess[str]"]


def test_bundles_that_read_the_past_are_refused_in_one_line(cli: Cli, tmp_path: Path) -> None:
    make_bundle("history").save(tmp_path / "past")
    done = cli("train", "shared-space", "--bundle", tmp_path / "past", "--steps", 64, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "its models read the preset history, environments and training have the vector of paper" in done.stderr
    assert done.stderr.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"past"}
