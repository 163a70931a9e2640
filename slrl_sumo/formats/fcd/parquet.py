"""FCD as Parquet, with the columns of SUMO 1.28 and our own; needs pyarrow (`slrl-sumo[parquet]`)."""

import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import (
    CSV_COLUMNS,
    HEIGHT_COLUMN,
    Places,
    figures,
    height_figures,
    learned_modes,
    table_columns,
)
from slrl_sumo.formats.fcd.steps import FcdStep, missing_columns, steps_of_rows
from slrl_sumo.input_files import check_content
from slrl_sumo.scene.state import WorldState

_DOUBLES = ("timestep_time", "vehicle_x", "vehicle_y")
_TEXTS = ("vehicle_id", "vehicle_type", "vehicle_lane", "vehicle_edge")
_TYPES = (
    {name: pa.float32() for name in (*CSV_COLUMNS, HEIGHT_COLUMN)}
    | {name: pa.float64() for name in _DOUBLES}
    | {name: pa.string() for name in _TEXTS}
    | {"mode": pa.int8(), "learned": pa.bool_()}
)
BYTES_PER_ROW = 50
"""Memory of a row that was read (FcdTable)."""
ROW_GROUP = 1 << 16
"""Rows that are collected before they are written."""


class ParquetWriter:
    """Writes an FCD file as Parquet, step by step; a context manager with the arguments and methods of FcdWriter. Types
    are those of SUMO's Parquet; missing values are null.

    Memory holds ROW_GROUP rows and those of one time step. Parquet is readable only after `close`: if the process is
    killed or writing fails, the file is unreadable. Raises InputError if the file cannot be written; an incomplete file
    is then removed.
    """

    def __init__(self, path: str | os.PathLike[str], *, elevated: bool = False) -> None:
        self.path = Path(path)
        self._elevated = elevated
        self._schema = pa.schema([(name, _TYPES[name]) for name in table_columns(elevated)])
        self._columns: dict[str, list[Any]] = {name: [] for name in self._schema.names}
        self._rows = 0
        try:
            self._file = open(self.path, "wb")  # noqa: SIM115 (closed by close)
            self._file.tell()  # raises for pipes: Parquet needs seekable files
            self._writer = pq.ParquetWriter(self._file, self._schema, compression="zstd")
        except OSError as e:
            raise InputError(f"cannot write {self.path}: {e.strerror or e}") from e

    def write(self, time: float, world: WorldState, places: Places, modes: NDArray[np.integer] | None = None) -> None:
        """Add the time step `time` (s): see FcdWriter.write."""
        if self._file.closed:
            raise ValueError(f"{self.path} is closed")
        x, y, angle, speed, position = figures(time, world, places)
        n = len(world)
        heights = height_figures(places, self._elevated)
        order = np.argsort(places.person, kind="stable")  # vehicles first
        lane = np.array(places.lane, np.object_)
        nowhere = lane == ""
        null = np.full(n, None, np.object_)
        mode = null.copy()
        if modes is not None:
            rows, values = learned_modes(world, modes)
            mode[rows] = values
        step = {
            "timestep_time": np.full(n, round(time, 3) + 0.0),
            "vehicle_id": np.array(world.ids, np.object_),
            "vehicle_x": x,
            "vehicle_y": y,
            "vehicle_angle": angle,
            "vehicle_type": np.array(places.sumo_type, np.object_),
            "vehicle_speed": speed,
            "vehicle_pos": np.where(nowhere, np.nan, position),
            "vehicle_lane": np.where(nowhere | places.person, null, lane),
            "vehicle_edge": np.where(nowhere | ~places.person, null, lane),
            "vehicle_slope": np.zeros(n) if heights is None else np.where(nowhere, np.nan, heights[1]),
            "mode": mode,
            "learned": world.learned,
        }
        if heights is not None:
            step[HEIGHT_COLUMN] = heights[0]
        for name, column in step.items():
            self._columns[name].append(column[order])
        self._rows += n
        if self._rows >= ROW_GROUP:
            self._flush()

    def close(self) -> None:
        """Finish the file. May be called twice."""
        if self._file.closed:
            return
        self._flush()
        try:
            self._writer.close()
            self._file.close()
        except OSError as e:
            self._give_up(e)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            self.close()
        except InputError:
            if error is None:  # else the first error says more
                raise

    def _flush(self) -> None:
        columns, self._columns = self._columns, {name: [] for name in self._schema.names}
        rows, self._rows = self._rows, 0
        if not rows:
            return
        # NaN marks a missing `pos` or slope; no other column has NaN.
        arrays = [
            pa.array(np.concatenate(columns[name]), self._schema.field(name).type, from_pandas=True) for name in columns
        ]
        try:
            self._writer.write_table(pa.table(arrays, schema=self._schema), row_group_size=rows)
        except OSError as e:
            self._give_up(e)

    def _give_up(self, error: OSError) -> None:
        """Remove the file, which is unreadable without its end."""
        self._file.close()
        if self.path.is_file():
            self.path.unlink()
        raise InputError(
            f"cannot write {self.path}: {error.strerror or error}; the file is removed, because Parquet cannot be read "
            "without its end (of .csv and .xml what fits stays)"
        ) from error


def parquet_steps(name: str, source: IO[bytes]) -> Iterator[FcdStep]:
    """The time steps of the Parquet file `source`, called `name` in messages, ours or SUMO's; memory holds a batch of
    rows.

    Persons are distinguished as in CSV. Raises InputError at the first error; lines in messages are rows, from 1.
    """
    try:
        with pq.ParquetFile(source) as file:
            columns = file.schema_arrow.names
            # A few bytes can stand for any number of equal rows.
            check_content(file.metadata.num_rows * BYTES_PER_ROW, os.fstat(source.fileno()).st_size)
            if missing := missing_columns(columns):
                wanted = ", ".join(CSV_COLUMNS[:5])
                raise InputError(
                    f"{name}: an FCD file in Parquet has at least the columns {wanted}; this one lacks "
                    f"{', '.join(missing)}"
                )
            yield from steps_of_rows(columns, _rows(file))
    except (pa.ArrowException, OSError, UnicodeDecodeError) as e:
        first = str(getattr(e, "strerror", None) or e).splitlines()[0].rstrip(".")
        raise InputError(f"{name}: is no Parquet file, or cut off: then nothing of it can be read ({first})") from e


def _rows(file: pq.ParquetFile) -> Iterator[tuple[int, list[Any]]]:
    number = 0
    for batch in file.iter_batches(ROW_GROUP):
        for fields in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            number += 1
            yield number, ["" if field is None else field for field in fields]
