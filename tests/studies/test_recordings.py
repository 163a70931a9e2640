"""`record --seeds`: one file for each seed, the same as one after the other."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.jobs.pool import Backend
from slrl_sumo.studies.recordings import Recordings, write_recordings

Cli = Callable[..., subprocess.CompletedProcess[str]]


def test_many_seeds_are_those_of_single_commands(cli: Cli, tmp_path: Path) -> None:
    done = cli("record", "intersection", "--seconds", 20, "--seed", 4, "--seeds", 2, "--out", tmp_path / "many")
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 recordings of 20 s" in done.stdout
    for seed in (4, 5):
        assert (
            cli("record", "intersection", "--seconds", 20, "--seed", seed, "--out", tmp_path / "one.npz").stderr == ""
        )
        assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "many" / f"seed-{seed}.npz").read_bytes()
    assert len(list((tmp_path / "many").iterdir())) == 3


def test_what_is_there_is_not_recorded_again_and_other_settings_are_not_mixed_in(tmp_path: Path) -> None:
    wanted = Recordings("intersection", range(1, 3), 4.0)
    assert write_recordings(wanted, tmp_path / "many", Backend(1)) == 0
    first, second = (tmp_path / "many" / f"seed-{seed}.npz" for seed in (1, 2))
    (whole, before), _ = (second.read_bytes(), first.stat().st_mtime_ns), second.unlink()
    assert write_recordings(wanted, tmp_path / "many", Backend(1)) == 0
    assert second.read_bytes() == whole
    assert first.stat().st_mtime_ns == before
    with pytest.raises(InputError, match="other settings"):
        write_recordings(Recordings("intersection", range(1, 3), 5.0), tmp_path / "many", Backend(1))


def test_recordings_of_nobody_are_told(cli: Cli, tmp_path: Path) -> None:
    done = cli("record", "signalised", "--seconds", 0.4, "--seeds", 2, "--out", tmp_path / "many")
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line.startswith("note: 2 of them hold no road user, as ")
    assert line.endswith("seed-1.npz; give more --seconds")
    done = cli("evaluate", tmp_path / "many" / "seed-1.npz", "--out", tmp_path / "e")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "slrl-sumo: the recording holds no road user; make one with `slrl-sumo record` or `slrl-sumo import`"
    ]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--workers", 2], "--workers: one recording is one simulation; give --seeds, too"),
        (["--ray"], "--ray: one recording is one simulation; give --seeds, too"),
        (["--seeds", 0], "--seeds 0: give a whole number"),
    ],
)
def test_words_that_make_no_sense_get_one_line(cli: Cli, tmp_path: Path, words: list[object], complaint: str) -> None:
    done = cli("record", "intersection", "--out", tmp_path / "out", *words)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert complaint in line
