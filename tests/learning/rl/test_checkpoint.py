"""Checkpoints and records of trainings that are damaged."""

import os
import zipfile
from pathlib import Path

import pytest
import torch

from slrl_sumo.errors import InputError
from slrl_sumo.learning.rl.checkpoint import STATES, read_checkpoint, read_record
from slrl_sumo.learning.rl.training_log import TrainingLog, read_rows


def test_a_checkpoint_is_tensors_and_numbers_of_the_size_of_its_file(tmp_path: Path) -> None:
    file = tmp_path / "checkpoint.pt"
    good = {"iteration": 3} | {name: {"weight": torch.zeros(50)} for name in STATES}
    torch.save(good, file)
    assert read_checkpoint(file)["iteration"] == 3
    whole = file.read_bytes()
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    bomb = tmp_path / "bomb"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, bytes(1 << 20) if name.endswith("data/0") else data)
    for content in (b"", whole[:200], b"\x80\x04.", bomb.read_bytes()):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"checkpoint\.pt: is damaged \(.*\); delete it") as error:
            read_checkpoint(file)
        assert "\n" not in str(error.value)
    for changed in (
        {"iteration": 3},
        good | {"iteration": "many"},
        good | {"policy": 5},
        [1],
        good | {"policy": Path()},
    ):
        torch.save(changed, file)
        with pytest.raises(InputError, match="is damaged"):
            read_checkpoint(file)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="it is a pipe"):
        read_checkpoint(file)


@pytest.mark.parametrize("content", ["", "[1]", "{", '{"steps": 1e999}', '{"a":' * 30_000])
def test_a_damaged_record_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "settings.json").write_text(content)
    with pytest.raises(InputError, match=r"settings\.json: is damaged"):
        read_record(tmp_path / "settings.json")


def test_damaged_figures_are_named(tmp_path: Path) -> None:
    assert read_rows(tmp_path, 3) == []
    (tmp_path / "log.csv").write_text("iteration,loss\n0,1.5\n1,nan\n2,0.5\n")
    assert [row["iteration"] for row in read_rows(tmp_path, 2)] == [0.0, 1.0]
    for content in ("iteration,loss\n0,word\n", "loss\n1\n", "iteration,loss\n0\n", "iteration\n0,1\n"):
        (tmp_path / "log.csv").write_text(content)
        with pytest.raises(InputError, match=r"log\.csv: is damaged"):
            read_rows(tmp_path, 2)


def test_a_log_with_other_columns_is_not_continued(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path, [{"iteration": 0.0, "agent_steps": 9.0, "episode/success": 0.5}], 1, 9)
    with pytest.raises(InputError, match=r"log\.csv: has other columns than this version writes; delete it"):
        log.add(1, {"episode/completed": 0.5})
    log.close()
