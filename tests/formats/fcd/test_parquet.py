import resource
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import sumo
from builders import make_world

from slrl_sumo import extras
from slrl_sumo.api import run as outputs
from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import Heights, Places
from slrl_sumo.formats.fcd.parquet import ROW_GROUP, ParquetWriter
from slrl_sumo.formats.fcd.read import read_fcd
from slrl_sumo.formats.fcd.table import read_table
from slrl_sumo.formats.fcd.write import open_fcd
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.settings import RunSettings

HOME = Path(sumo.SUMO_HOME)


def scene(time: float, n: int = 6) -> tuple[WorldState, Places]:
    """Cars and, every third, persons; every fourth is on no lane, every second is learned."""
    i = np.arange(n)
    world = make_world(
        10.0 * i + time,
        100.0 - i,
        speed=1.0 + i,
        type=np.where(i % 3 == 2, 2, 0),
        length=5.0,
        width=1.8,
        learned=i % 2 == 0,
        ids=[f"u{k}" for k in i],
        time=time,
    )
    places = Places(
        sumo_type=("some",) * n,
        lane=tuple("" if k % 4 == 3 else f"place{k}" for k in i),
        lane_position=np.where(i % 4 == 3, np.nan, 5.0 * i),
        person=i % 3 == 2,
    )
    return world, places


def write(path: Path, steps: int, n: int = 6, modes: bool = True) -> None:
    with open_fcd(path) as writer:
        for k in range(steps):
            world, places = scene(0.4 * k, n)
            writer.write(world.time, world, places, np.arange((n + 1) // 2) if modes else None)


def test_columns_and_types_are_those_of_sumo_and_our_two(tmp_path: Path) -> None:
    write(tmp_path / "t.parquet", 1)
    # With the usual precision: with more digits, as in cross_fcd, SUMO makes all figures doubles.
    command = [HOME / "bin" / "sumo", "-c", HOME / "tools" / "game" / "cross.sumocfg", "--end", "5"]
    subprocess.run([*command, "--fcd-output", tmp_path / "n.parquet"], check=True, capture_output=True, timeout=60)
    ours, native = pq.read_schema(tmp_path / "t.parquet"), pq.read_schema(tmp_path / "n.parquet")
    assert ours.names == [*native.names, "mode", "learned"]
    assert ours.types[: len(native)] == native.types


def test_heights_are_in_the_column_of_sumo(tmp_path: Path) -> None:
    world, places = scene(0.0, 4)
    slope = np.array([1.0, 2.0, 3.0, np.nan])
    with open_fcd(tmp_path / "t.parquet", elevated=True) as writer:
        writer.write(0.0, world, replace(places, heights=Heights(np.arange(4.0), slope)), np.arange(2))
    table = pd.read_parquet(tmp_path / "t.parquet")
    assert list(table.columns[:5]) == ["timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_z"]
    assert str(table.vehicle_z.dtype) == "float32"
    by_id = table.set_index("vehicle_id")
    assert by_id.vehicle_z.to_dict() == {"u0": 0.0, "u1": 1.0, "u2": 2.0, "u3": 3.0}
    assert by_id.vehicle_slope.dropna().to_dict() == {"u0": 1.0, "u1": 2.0, "u2": 3.0}


def test_pandas_reads_what_was_written(tmp_path: Path) -> None:
    write(tmp_path / "t.parquet", 3)
    table = pd.read_parquet(tmp_path / "t.parquet")
    step = table[table.timestep_time == 0.4].set_index("vehicle_id")
    assert list(step.index) == ["u0", "u1", "u3", "u4", "u2", "u5"]  # persons come last
    assert step.vehicle_x.tolist() == [2.9, 12.9, 32.9, 42.9, 22.9, 52.9]  # front bumpers, 2.5 m ahead
    assert step.vehicle_angle.unique().tolist() == [90.0]
    assert step.vehicle_speed.tolist() == [1.0, 2.0, 4.0, 5.0, 3.0, 6.0]
    assert step.vehicle_lane.dropna().to_dict() == {"u0": "place0", "u1": "place1", "u4": "place4"}
    assert step.vehicle_edge.dropna().to_dict() == {"u2": "place2", "u5": "place5"}
    assert step.vehicle_pos.dropna().to_dict() == {"u0": 0.0, "u1": 5.0, "u4": 20.0, "u2": 10.0, "u5": 25.0}
    assert step["mode"].dropna().to_dict() == {"u0": 0, "u4": 2, "u2": 1}
    assert step.learned.to_dict() == {"u0": True, "u1": False, "u3": False, "u4": True, "u2": True, "u5": False}


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_modes_and_learned_come_back(tmp_path: Path, suffix: str) -> None:
    write(tmp_path / f"t{suffix}", 2)
    table, flaw = read_table(tmp_path / f"t{suffix}")
    assert flaw is None
    assert table.marks_learned
    assert [table.users[key][0] for key in table.key] == 2 * ["u0", "u1", "u3", "u4", "u2", "u5"]
    assert list(table.mode) == 2 * [1, 0, 0, 3, 2, 0]  # 1 + mode
    assert list(table.learned) == 2 * [1, 0, 0, 1, 1, 0]
    assert list(table.speed) == 2 * [1.0, 2.0, 4.0, 5.0, 3.0, 6.0]
    write(tmp_path / f"t{suffix}", 2, modes=False)
    table, _ = read_table(tmp_path / f"t{suffix}")
    assert set(table.mode) == {0}
    assert list(table.learned) == 2 * [1, 0, 0, 1, 1, 0]


def test_what_pandas_writes_is_read(tmp_path: Path) -> None:
    """A column with gaps becomes one of floats in pandas."""
    write(tmp_path / "t.csv", 2)
    whole = pd.read_csv(tmp_path / "t.csv", sep=";")
    whole.to_csv(tmp_path / "again.csv", sep=";", index=False)
    whole.to_parquet(tmp_path / "again.parquet")
    first, _ = read_table(tmp_path / "t.csv")
    for name in ("again.csv", "again.parquet"):
        again, _ = read_table(tmp_path / name)
        assert again.mode == first.mode
        assert again.learned == first.learned
        assert np.allclose(again.x, first.x)
    assert "2.0" in (tmp_path / "again.csv").read_text()


def test_rows_are_written_in_groups(tmp_path: Path) -> None:
    path, n = tmp_path / "t.parquet", 5000
    sizes = []
    with ParquetWriter(path) as writer:
        for k in range(40):
            world, places = scene(0.4 * k, n)
            writer.write(world.time, world, places)
            sizes.append(path.stat().st_size)
    groups = [pq.ParquetFile(path).metadata.row_group(i).num_rows for i in range(3)]
    assert groups == [70_000, 70_000, 60_000]
    assert ROW_GROUP <= groups[0] < ROW_GROUP + n
    # They are on disk before the end: memory does not hold a run.
    assert 0 < sizes[20] < sizes[35] < path.stat().st_size
    assert pq.ParquetFile(path).metadata.num_rows == 40 * n


def test_a_full_disk_says_that_nothing_is_left(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill() -> None:
        rng = np.random.default_rng(1)
        with ParquetWriter(path) as writer:
            for k in range(100):
                world, places = scene(0.4 * k, 5000)
                world.x[:] = rng.random(5000)
                writer.write(world.time, world, places)

    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, limits[1]))
        with pytest.raises(InputError, match=r"cannot write .*t\.parquet: .*File too large.*; the file is removed"):
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not path.exists()


def test_after_close_nothing_can_be_written(tmp_path: Path) -> None:
    writer = ParquetWriter(tmp_path / "t.parquet")
    writer.close()
    writer.close()
    with pytest.raises(ValueError, match="is closed"):
        writer.write(0.0, *scene(0.0))
    assert pd.read_parquet(tmp_path / "t.parquet").empty


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write .*/missing/t\.parquet: No such file or directory"):
        open_fcd(tmp_path / "missing" / "t.parquet")
    (tmp_path / "folder.parquet").mkdir()
    with pytest.raises(InputError, match="Is a directory"):
        open_fcd(tmp_path / "folder.parquet")


def test_without_pyarrow_one_line_before_the_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_simulation(*_: object) -> None:
        raise AssertionError("SUMO has been started")

    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    monkeypatch.setattr(outputs, "run_isolated", no_simulation)
    path = tmp_path / "t.parquet"
    with pytest.raises(InputError, match=r"Parquet needs pyarrow.*pip install 'slrl-sumo\[parquet\]'"):
        outputs.write_run(RunSettings("intersection", agents=1), fcd=path)
    assert not path.exists()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def other_columns(path: Path) -> None:
    pd.DataFrame({"a": [1]}).to_parquet(path)


def text(path: Path) -> None:
    path.write_text("timestep_time;vehicle_id")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (cut, r"t\.parquet: is no Parquet file, or cut off: then nothing of it can be read"),
        (text, r"t\.parquet: is no Parquet file, or cut off: then nothing of it can be read"),
        (other_columns, r"t\.parquet: an FCD file in Parquet has at least the columns timestep_time, vehicle_id"),
    ],
)
def test_what_is_no_trace_gets_one_line(change: Callable[[Path], None], message: str, tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    write(path, 2)
    change(path)
    with pytest.raises(InputError, match=message) as error:
        read_fcd(path)
    assert "\n" not in str(error.value)
