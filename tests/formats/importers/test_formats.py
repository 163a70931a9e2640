import sys
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo import cli
from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.formats import RECORDING_PAUSE, find_recordings, join
from slrl_sumo.formats.importers.hc import read_hc
from slrl_sumo.formats.trajectory_file import load_trajectories


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A folder with two recordings in the format of HC."""
    folder = tmp_path / "street"
    folder.mkdir()
    for name, first in (("D1", 40), ("D2", 7)):
        lines = [f"{f},{i},{20 * f},{300 * i},{i}" for i in (1, 2) for f in range(first, first + 21)]
        (folder / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
    return folder


def test_finds_recordings_of_a_folder_and_of_any_of_their_files(tmp_path: Path) -> None:
    for file in (
        "inD/data/00_tracks.csv", "inD/data/00_tracksMeta.csv", "inD/data/01_tracks.csv", "inD/data/00_background.png",
        "s/8_02_1/Veh_smoothed_tracks.csv", "s/8_02_1/Ped_smoothed_tracks.csv", "s/8_03_2/Veh_smoothed_tracks.csv",
        "i/DR_X/vehicle_tracks_000.csv", "i/DR_X/pedestrian_tracks_000.csv", "i/TC_Y/vehicle_tracks_000.csv",
        "v/gates/video3/annotations.txt", "v/gates/video3/reference.jpg", "v/quad/video3/annotations.txt",
        "d/a_traj_ped_filtered.csv", "d/a_traj_veh_filtered.csv", "f/one/fcd.xml", "f/two/fcd.xml", "f/x.xml.gz",
    ):  # fmt: skip
        path = tmp_path / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()

    def names(format: str, where: str) -> list[str]:
        return [r.name for r in find_recordings(format, tmp_path / where)]

    for format in ("levelx", "inD", "rounD", "uniD", "exiD"):
        assert names(format, "inD") == ["00", "01"]
    assert names("levelx", "inD/data/00_tracksMeta.csv") == names("inD", "inD/data/00_background.png") == ["00"]
    assert find_recordings("inD", tmp_path / "inD/data/00_tracksMeta.csv")[0].path.name == "00_tracks.csv"
    assert names("sind", "s") == ["8_02_1", "8_03_2"]
    assert names("sind", "s/8_02_1/Ped_smoothed_tracks.csv") == ["8_02_1"]
    assert names("interaction", "i") == ["DR_X-vehicle_tracks_000", "TC_Y-vehicle_tracks_000"]
    assert names("taf-bw", "i/DR_X/pedestrian_tracks_000.csv") == ["DR_X-vehicle_tracks_000"]
    assert names("sdd", "v") == ["gates-video3", "quad-video3"]
    assert names("sdd", "v/gates/video3/reference.jpg") == names("sdd", "v/gates") == ["gates-video3"]
    assert names("dut", "d") == names("citr", "d/a_traj_veh_filtered.csv") == ["a"]
    assert names("fcd", "f") == ["fcd", "fcd#1", "x"]
    with pytest.raises(InputError, match=r"'nuscenes' is not a format; known are levelx, ind"):
        names("nuscenes", "inD")
    with pytest.raises(InputError, match=r"holds no recording of format sind: no file Veh_smoothed_tracks\.csv"):
        names("sind", "inD")
    with pytest.raises(InputError, match=r"nowhere does not exist"):
        names("sind", "nowhere")


def test_joined_recordings_never_meet(street: Path) -> None:
    parts = [(r.name, r.read()) for r in find_recordings("hc", street)]
    t = join(parts)
    assert t.ids == ("D1/1", "D1/2", "D2/1", "D2/2")
    assert t.source == "HC D1; HC D2"
    first, second = t.frame[t.track < 2], t.frame[t.track >= 2]
    assert first.min() == 0
    assert second.min() - first.max() == RECORDING_PAUSE + 1
    np.testing.assert_array_equal(t.x, np.concatenate([part.x for _, part in parts]))
    np.testing.assert_array_equal(t.type, [2, 1, 2, 1])
    assert join(parts[:1]) is parts[0][1]


def imported(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["slrl-sumo", "import", *(str(word) for word in words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


def test_command_writes_one_file_or_one_per_recording(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    one, many = tmp_path / "all.npz", tmp_path / "many"
    assert imported(monkeypatch, "hc", street, "--out", one) == 0
    assert imported(monkeypatch, "HC", street, "--out", many) == 0
    assert len(load_trajectories(one).ids) == 4
    assert sorted(file.name for file in many.iterdir()) == ["D1.npz", "D2.npz"]
    alone = load_trajectories(many / "D2.npz")
    assert alone.ids == ("1", "2")
    np.testing.assert_array_equal(alone.x, read_hc(street / "D2.csv").x)
    said = capsys.readouterr()
    assert f"{one}: 2 recordings, 4 tracks, {len(load_trajectories(one))} positions" in said.out
    assert said.err == ""


def test_command_says_what_is_wrong_in_one_line(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (street / "D2.csv").write_text("1,1,2,3,8\n", encoding="utf-8")
    out = tmp_path / "all.npz"
    for words, message in (
        (("hc", street / "D2.csv", "--out", out), "D2.csv, line 1: unknown type '8'"),
        (("hc", street, "--out", tmp_path / "no" / "a.npz"), "does not exist; create it or name another"),
        (("hc", street, "--out", street / "D1.csv"), "is a file; name a folder"),
        (("mars", street, "--out", out), "'mars' is not a format"),
    ):
        assert imported(monkeypatch, *words) == 1
        said = capsys.readouterr().err
        assert message in said
        assert said.count("\n") == 1
    assert not out.exists()


def test_bad_files_do_not_hide_the_others(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every file is tried; those that cannot be read are named, and counted beside the result."""
    (street / "C.csv").write_text("1,1,2\n", encoding="utf-8")
    (street / "D3.csv").write_bytes(b"")
    (street / "E.csv").write_text("1,1,2,3,1\n", encoding="utf-8")
    out = tmp_path / "all.npz"
    assert imported(monkeypatch, "hc", street, "--out", out) == 0
    said = capsys.readouterr()
    assert "all.npz: 3 recordings, 5 tracks" in said.out
    assert said.out.endswith("; 2 of 5 left out, see above\n")
    bad = said.err.splitlines()
    assert [line.partition(":")[0] for line in bad] == ["left out"] * 2
    assert "C.csv, line 1: the file is cut off, the last line has 3 of 5 columns" in bad[0]
    assert "D3.csv is empty" in bad[1]
    assert {name.partition("/")[0] for name in load_trajectories(out).ids} == {"D1", "D2", "E"}
    assert imported(monkeypatch, "hc", street, "--out", tmp_path / "many") == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("many: 3 recordings; 2 of 5 left out, see above")

    for name in ("D1", "D2", "E"):
        (street / f"{name}.csv").unlink()
    for number in range(30):
        (street / f"F{number}.csv").write_bytes(b"")
    assert imported(monkeypatch, "hc", street, "--out", tmp_path / "none.npz") == 1
    bad = capsys.readouterr().err.splitlines()
    assert len(bad) == 22
    assert bad[20] == "left out: … and 12 recordings more"
    assert "none of the 32 recordings can be read" in bad[21]
    assert not (tmp_path / "none.npz").exists()


def test_notes_are_shown_and_stay_in_the_file(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (street / "D2.csv").read_text(encoding="utf-8")
    (street / "D2.csv").write_text(f"{text}\n7,9,20,300,6\n" + text.splitlines()[0], encoding="utf-8")
    assert imported(monkeypatch, "hc", street, "--out", tmp_path / "all.npz") == 0
    notes = (
        "D2: 1 road user of the unknown type '6' left out",
        "D2: 1 of 43 rows twice for one road user and time, the first of each two dropped",
    )
    assert capsys.readouterr().err.splitlines() == [f"note: {note}" for note in notes]
    assert load_trajectories(tmp_path / "all.npz").notes == notes
