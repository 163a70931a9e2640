import dataclasses
import io
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories, road_users, track_names
from slrl_sumo.formats.trajectory_builder import TrajectoryBuilder
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.state import WorldState, empty_world


def make(**changes: Any) -> Trajectories:
    """A car in frames 2 to 5 and a pedestrian in frames 4 and 5."""
    fields: dict[str, Any] = {
        "track": np.array([0, 0, 0, 0, 1, 1]),
        "frame": np.array([2, 3, 4, 5, 4, 5]),
        "x": np.array([0.0, 4.0, 8.0, 8.0, -1.0, -1.0]),
        "y": np.array([0.0, 0.0, 3.0, 3.0, 7.0, 7.4]),
        "heading": np.array([0.0, 0.1, 3.1, -3.1, 1.5, 1.6]),
        "ids": ("car", "ped"),
        "type": np.array([0, 2], np.int8),
        "length": np.array([4.5, 0.4]),
        "width": np.array([1.9, 0.5]),
        "t0": 10.0,
        "source": "by hand",
        "licence": "MIT",
    }
    return Trajectories(**(fields | changes))


def world(time: float, **x_of: float) -> WorldState:
    return make_world(list(x_of.values()), 5.0, 0.5, type=1, length=1.7, width=0.6, ids=tuple(x_of), time=time)


def test_kinematics_are_backward_differences_within_tracks() -> None:
    t = make()
    # Covered: 4 m, 5 m (3-4-5), 0 m; each in 0.4 s. The first row takes the speed of the second.
    np.testing.assert_allclose(t.speed, [10.0, 10.0, 12.5, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(t.acceleration, [0.0, 0.0, 6.25, -31.25, 0.0, 0.0])
    over_pi = (2 * np.pi - 6.2) / 0.4  # from 3.1 on to -3.1, the short way
    np.testing.assert_allclose(t.yaw_rate, [0.0, 0.25, 7.5, over_pi, 0.0, 0.25])


def test_a_track_of_one_row_stands() -> None:
    one = np.array([3.0])
    t = make(
        track=np.array([0, 1]),
        frame=np.array([0, 0]),
        **{name: np.concatenate([one, one]) for name in ("x", "y", "heading")},
    )
    assert t.speed.tolist() == t.acceleration.tolist() == t.yaw_rate.tolist() == [0.0, 0.0]


def test_kinematics_agree_with_advance() -> None:
    rng = np.random.default_rng(0)
    state = dataclasses.replace(world(0.0, a=0.0, b=9.0), speed=np.array([5.0, 2.0]))
    builder = TrajectoryBuilder()
    worlds = [state]
    for _ in range(20):
        state = advance(state, rng.normal(0, 1, 2), rng.normal(0, 0.5, 2), np.full(2, 20.0), 0.4)
        worlds.append(state)
    for state in worlds:
        builder.append(state)
    t = builder.build()
    for frame in range(2, 21):
        for name in ("x", "y", "heading", "speed", "acceleration", "yaw_rate"):
            np.testing.assert_allclose(getattr(t.world(frame), name), getattr(worlds[frame], name), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame": np.array([2, 3, 5, 6, 4, 5])}, r"'car' goes from frame 3 to 5.*split the track"),
        ({"frame": np.array([2, 3, 3, 4, 4, 5])}, r"'car' goes from frame 3 to 3"),
        ({"track": np.array([1, 1, 1, 1, 0, 0])}, "not sorted"),
        ({"track": np.array([0, 0, 0, 0, 2, 2])}, "not sorted"),
        ({"track": np.array([0, 0, 0, 0, 0, 0]), "frame": np.arange(6)}, "a track has no row"),
        ({"ids": ("car", "car")}, "unique"),
        ({"x": np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])}, "x holds values that are not finite"),
        ({"y": np.zeros(5)}, r"y has shape \(5,\)"),
        ({"length": np.ones(6)}, "length has shape"),
        ({"dt": 0.0}, "dt"),
    ],
)
def test_a_broken_table_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(**changes)


def test_world_of_a_frame() -> None:
    t = make()
    assert t.frames == range(2, 6)
    w = t.world(4)
    assert w.ids == ("car", "ped")
    assert w.time == pytest.approx(11.6)
    assert (w.type.tolist(), w.length.tolist(), w.width.tolist()) == ([0, 2], [4.5, 0.4], [1.9, 0.5])
    assert (w.x.tolist(), w.y.tolist(), w.heading.tolist()) == ([8.0, -1.0], [3.0, 7.0], [3.1, 1.5])
    np.testing.assert_allclose(w.speed, [12.5, 1.0])
    assert not w.learned.any()
    assert t.world(2).ids == ("car",)
    assert t.world(1).ids == t.world(6).ids == ()


def test_no_tracks_at_all() -> None:
    t = TrajectoryBuilder().build()
    assert len(t) == len(t.speed) == len(t.acceleration) == len(t.yaw_rate) == 0
    assert list(t.frames) == []
    assert t.world(0).ids == ()


def test_save_and_load(tmp_path: Path) -> None:
    before = make(ids=("größe", "ped#1"), dt=0.2)
    before.save(tmp_path / "t.npz")
    after = load_trajectories(tmp_path / "t.npz")
    for field in dataclasses.fields(Trajectories):
        np.testing.assert_array_equal(getattr(after, field.name), getattr(before, field.name), field.name)
    assert after.type.dtype == np.int8
    assert [p.name for p in tmp_path.iterdir()] == ["t.npz"]  # nothing temporary is left


def test_save_and_load_without_tracks(tmp_path: Path) -> None:
    TrajectoryBuilder().build().save(tmp_path / "t.npz")
    assert load_trajectories(tmp_path / "t.npz").ids == ()


def test_a_file_that_cannot_be_written_or_found_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing/t\.npz: cannot be written \(No such file"):
        make().save(tmp_path / "missing" / "t.npz")
    with pytest.raises(InputError, match=r"cannot read .*t\.npz: No such file"):
        load_trajectories(tmp_path / "t.npz")


@pytest.mark.parametrize("keep", [0, 10, 300, -20])
def test_a_truncated_file_is_reported(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "t.npz"
    make().save(path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"t\.npz is not a trajectories file or is damaged: [^\n]+$"):
        load_trajectories(path)


def test_a_damaged_byte_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    make().save(path)
    data = bytearray(path.read_bytes())
    at = data.index(b"heading.npy") + 60
    data[at] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        load_trajectories(path)


def test_another_file_is_reported(tmp_path: Path) -> None:
    text, array, other, newer = (tmp_path / name for name in ("a.txt", "b.npy", "c.npz", "d.npz"))
    text.write_text("hello")
    np.save(array, np.zeros(3))
    np.savez(other, x=np.zeros(3))
    np.savez(newer, kind=np.array("slrl_sumo trajectories"), version=np.array(99))
    for path in (text, array, other):
        with pytest.raises(InputError, match="is not a trajectories file"):
            load_trajectories(path)
    with pytest.raises(InputError, match="format 99"):
        load_trajectories(newer)


def test_a_table_that_breaks_the_rules_is_not_loaded(tmp_path: Path) -> None:
    make().save(tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as data:
        np.savez(tmp_path / "u.npz", **{**data, "frame": np.zeros(6, np.int64)})
    with pytest.raises(InputError, match="'car' goes from frame 0 to 0"):
        load_trajectories(tmp_path / "u.npz")


def test_builder_splits_tracks_at_gaps_and_jumps() -> None:
    builder = TrajectoryBuilder(source="test", licence="MIT")
    builder.append(world(3.0, a=0.0, b=10.0))
    builder.append(world(3.4, b=11.0, a=1.0))
    builder.append(world(3.8, b=12.0))
    builder.append(world(4.2, a=3.0, b=99.0), new_track_ids={"b"})
    builder.append(world(4.6, a=4.0, b=100.0))
    t = builder.build()
    tracks = {name: (t.frame[t.track == i].tolist(), t.x[t.track == i].tolist()) for i, name in enumerate(t.ids)}
    assert tracks == {
        "a": ([0, 1], [0.0, 1.0]),
        "b": ([0, 1, 2], [10.0, 11.0, 12.0]),
        "a#1": ([3, 4], [3.0, 4.0]),
        "b#1": ([3, 4], [99.0, 100.0]),
    }
    assert (t.t0, t.dt, t.source, t.licence) == (3.0, 0.4, "test", "MIT")
    assert t.type.tolist() == [1] * 4
    assert t.length.tolist() == [1.7] * 4


def test_builder_splits_at_frames_that_were_left_out() -> None:
    builder = TrajectoryBuilder()
    builder.append(world(0.0, a=0.0))
    builder.append(world(1.2, a=3.0))
    t = builder.build()
    assert t.ids == ("a", "a#1")
    assert t.frame.tolist() == [0, 3]


def test_builder_keeps_empty_frames_of_the_clock() -> None:
    builder = TrajectoryBuilder()
    builder.append(empty_world(5.0))
    builder.append(world(5.4, a=0.0))
    t = builder.build()
    assert (t.t0, t.frame.tolist()) == (5.0, [1])


@pytest.mark.parametrize("time", [0.0, -0.4, 0.6])
def test_builder_refuses_a_world_out_of_series(time: float) -> None:
    builder = TrajectoryBuilder()
    builder.append(world(0.0, a=0.0))
    with pytest.raises(ValueError, match="not the next of a series"):
        builder.append(world(time, a=1.0))


def test_track_names_are_unique_even_where_an_id_looks_like_one() -> None:
    assert track_names(["a", "a", "a#1", "a", "b", "a#1"]) == ("a", "a#2", "a#1", "a#3", "b", "a#1#1")


def test_no_track_is_parked_by_default(tmp_path: Path) -> None:
    assert make().parked.tolist() == [False, False]
    marked = make(parked=np.array([True, False]))
    marked.save(tmp_path / "t.npz")
    assert load_trajectories(tmp_path / "t.npz").parked.tolist() == [True, False]
    with pytest.raises(ValueError, match="parked has shape"):
        make(parked=np.array([True]))


def test_files_of_version_1_have_no_parked_tracks(tmp_path: Path) -> None:
    make(parked=np.array([True, False])).save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        fields = {name: data[name] for name in data.files if name != "parked"}
    np.savez_compressed(tmp_path / "old.npz", **(fields | {"version": np.array(1)}))
    old = load_trajectories(tmp_path / "old.npz")
    assert old.parked.tolist() == [False, False]
    np.testing.assert_array_equal(old.x, make().x)
    np.savez_compressed(tmp_path / "later.npz", **(fields | {"version": np.array(3)}))
    with pytest.raises(InputError, match="has trajectories format 3, this version reads 1 to 2"):
        load_trajectories(tmp_path / "later.npz")


def entries(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def pack(file: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"'shape': (6,)", b"'shape': (10**12,)"),  # no literal
        (b"'shape': (6,), }" + b" " * 12, b"'shape': (1000000000000,), }"),
        (b"'shape': (6,)", b"'shape': (-5,)"),
        (b"'<f8'", b"'|O8'"),
        (b"'<f8'", b"'<f4'"),
        (b"'<f8'", b"((((("),
        (b"'<f8'", b"'<M8'"),
        (b"{'descr'", b'"""escr\''),
        (b"NUMPY", b"PICKL"),
    ],
)
def test_damaged_headers_of_arrays_are_reported(tmp_path: Path, old: bytes, new: bytes) -> None:
    file = tmp_path / "a.npz"
    make().save(file)
    members = entries(file)
    assert old in members["x.npy"]
    pack(file, members | {"x.npy": members["x.npy"].replace(old, new, 1)})
    with pytest.raises(InputError, match=r"a\.npz is not a trajectories file or is damaged"):
        load_trajectories(file)


def test_arrays_that_unpack_to_more_than_the_limit_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "1")
    file = tmp_path / "a.npz"
    make().save(file)
    zeros = io.BytesIO()
    np.save(zeros, np.zeros(1 << 20))
    pack(file, entries(file) | {"x.npy": zeros.getvalue()})
    with pytest.raises(InputError, match="more than 1 MiB and 30 times its size; set SLRL_SUMO_INPUT_MIB"):
        load_trajectories(file)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"type": np.array([7, 0], np.int8)}, "type holds 7; possible are 0 to 2"),
        ({"t0": np.array(np.nan)}, "t0 must be a time in s"),
        ({"dt": np.array(1e-300)}, "dt must lie between"),
        ({"frame": np.array([2, 3, 4, 5, 10**12, 10**12 + 1])}, r"frame holds 1e\+12; possible are"),
        ({"x": np.array([0.0, 1.0, 3.0, 1e30, 5.0, 5.0])}, r"x holds 1e\+30; possible are"),
        ({"length": np.array([4.0, np.inf])}, "length holds values that are not finite"),
        ({"width": np.array([-1.0, 1.0])}, "width holds -1; possible are 0 to 1000"),
        ({"mode": np.array([-7, 0, 0, 0, 0, 0], np.int8)}, "mode holds -7"),
        ({"ids": np.array(5)}, "a.npz"),
    ],
)
def test_impossible_values_are_reported(tmp_path: Path, change: dict[str, Any], reason: str) -> None:
    file = tmp_path / "a.npz"
    make().save(file)
    with np.load(file) as data:
        np.savez(file, **{**data, **change})
    with pytest.raises(InputError, match=reason):
        load_trajectories(file)


def test_pipes_and_folders_are_no_trajectories(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    for file in (tmp_path / "pipe.npz", tmp_path):
        with pytest.raises(InputError, match="cannot read"):
            load_trajectories(file)


def test_road_users_of_tracks_are_those_they_were_named_after() -> None:
    ids = ["a", "b", "a", "a#1", "flow#3", "a", "b#x"]
    assert track_names(ids) == ("a", "b", "a#2", "a#1", "flow#3", "a#3", "b#x")
    assert road_users(("a", "b", "a#2", "flow#3", "b#x")) == ("a", "b", "a", "flow#3", "b#x")
