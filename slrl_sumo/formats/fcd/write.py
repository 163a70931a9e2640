"""Floating car data (FCD) as SUMO writes it (https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html)."""

import os
import re
import zlib
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import CSV_COLUMNS, OWN_COLUMNS, Places, check_fcd_path, figures, learned_modes
from slrl_sumo.formats.output_files import check_writable
from slrl_sumo.scene.state import WorldState

if TYPE_CHECKING:
    from slrl_sumo.formats.fcd.parquet import ParquetWriter

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n\n'
    '<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">\n'
)

_TAIL = b"</fcd-export>\n"

# In the order (id, x, y, angle, type, speed, pos, lane or edge).
_POSE = ' id="%s" x="%.3f" y="%.3f" angle="%.2f" type="%s" speed="%.3f"'
_VEHICLE = f'        <vehicle{_POSE} pos="%.3f" lane="%s" slope="0.00"/>\n'
_PERSON = f'        <person{_POSE} pos="%.3f" edge="%s" slope="0.00"/>\n'
_VEHICLE_NOWHERE = f'        <vehicle{_POSE} slope="0.00"/>\n'
_PERSON_NOWHERE = f'        <person{_POSE} slope="0.00"/>\n'
_CSV_POSE = "%s;%.3f;%.3f;%.2f;%s;%.3f"
_CSV_VEHICLE = f"{_CSV_POSE};%.3f;%s;;0.00;%s\n"
_CSV_PERSON = f"{_CSV_POSE};%.3f;;%s;0.00;%s\n"
_CSV_NOWHERE = f"{_CSV_POSE};;;;0.00;%s\n"

_ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)
_TO_ESCAPE = re.compile(r'[&<>"\n\r\t]')
_TO_QUOTE = re.compile(r'[;"\n\r]')
_NOT_IN_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")

_GZIP = 16 + zlib.MAX_WBITS
"""Window of zlib that writes the header and the checksum of a gzip file."""


def open_fcd(path: str | os.PathLike[str]) -> "FcdWriter | ParquetWriter":
    """A writer for the format of the file's suffix. Raises InputError as FcdWriter does."""
    if check_fcd_path(path) != ".parquet":
        return FcdWriter(path)
    from slrl_sumo.formats.fcd.parquet import ParquetWriter  # pyarrow is an extra

    return ParquetWriter(path)


class FcdWriter:
    """Writes an FCD file as XML or CSV, step by step; a context manager.

    The same worlds give the same bytes. Each time step is on disk when `write` returns, and the file is complete and
    valid after each, also if the process dies. Only a kill inside the one system call that writes a step can cut the
    file off; `replay` then shows the steps before it, and `read_fcd` counts them in its error. Raises InputError, with
    path and reason, on construction if the suffix is unknown or the file cannot be written, and in `write` if writing
    fails; the file then ends with the step before and is closed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        suffix = check_fcd_path(path)
        if suffix == ".parquet":
            raise InputError(f"{self.path}: Parquet has a writer of its own; call open_fcd")
        check_writable(self.path)
        self._csv = suffix == ".csv"
        self._stream = zlib.compressobj(4, wbits=_GZIP) if suffix == ".xml.gz" else None
        self._whole = 0
        """Bytes on disk up to the last complete time step; the tail follows, and the next step overwrites it."""
        self._tail = b""
        try:
            self._file = open(self.path, "wb", buffering=0)  # noqa: SIM115 (closed by close)
        except OSError as e:
            raise InputError(f"cannot write {self.path}: {e.strerror or e}") from e
        self._put(";".join(CSV_COLUMNS + OWN_COLUMNS) + "\n" if self._csv else _HEAD)

    def write(self, time: float, world: WorldState, places: Places, modes: NDArray[np.integer] | None = None) -> None:
        """Add the time step `time` (s): first the vehicles, then the persons, each in the order of `world`.

        Positions become those of front bumpers, headings SUMO's angles. `modes`: of the learned road users, in their
        order; None where they have none. Raises ValueError if a value is not finite.
        """
        if self._file.closed:
            raise ValueError(f"{self.path} is closed")
        x, y, angle, speed, position = figures(time, world, places)
        escape = _quoted if self._csv else _escaped
        columns = [
            *(escape(world.ids), x.tolist(), y.tolist(), angle.tolist(), escape(places.sumo_type)),
            *(speed.tolist(), position.tolist(), escape(places.lane)),
        ]
        stamp = f"{time + 0.0:.2f}" if abs(round(time, 2) - time) < 1e-6 else f"{time:.3f}"
        if self._csv:
            with_lane, with_edge, nowhere = (f"{stamp};{form}" for form in (_CSV_VEHICLE, _CSV_PERSON, _CSV_NOWHERE))
            person_nowhere = nowhere
            columns.append(_own_fields(world, modes))
        else:
            with_lane, with_edge, nowhere, person_nowhere = _VEHICLE, _PERSON, _VEHICLE_NOWHERE, _PERSON_NOWHERE
        rows = zip(*columns, strict=True)
        if places.person.any():
            vehicles, persons = [], []
            for person, row in zip(places.person.tolist(), rows, strict=True):
                if person:
                    persons.append(with_edge % row if row[7] else person_nowhere % (row[:6] + row[8:]))
                else:
                    vehicles.append(with_lane % row if row[7] else nowhere % (row[:6] + row[8:]))
            lines = vehicles + persons
        else:
            lines = [with_lane % row if row[7] else nowhere % (row[:6] + row[8:]) for row in rows]
        text = "".join(lines)
        if not self._csv:
            text = (
                f'    <timestep time="{stamp}">\n{text}    </timestep>\n'
                if text
                else f'    <timestep time="{stamp}"/>\n'
            )
        self._put(text)

    def close(self) -> None:
        """Finish the file. May be called twice."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _put(self, text: str) -> None:
        """Write a complete time step, and the tail behind it; if that fails, the file ends as before."""
        before = self._whole + len(self._tail)
        try:
            data, tail = self._encoded(text)
            self._write(self._whole, data + tail)
            if self._whole + len(data) + len(tail) < before:
                self._file.truncate()
        except BaseException as error:  # an interrupt must not leave half a step behind either
            with suppress(OSError):
                self._file.truncate(self._whole)
                self._write(self._whole, self._tail)
            self._file.close()
            if not isinstance(error, OSError):
                raise
            raise InputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._whole += len(data)
        self._tail = tail

    def _encoded(self, text: str) -> tuple[bytes, bytes]:
        """The bytes of `text`, and those that end a valid file behind it."""
        if self._csv:
            return text.encode(), b""
        if self._stream is None:
            return text.encode(), _TAIL
        # All of the step leaves the compressor; a copy of it ends the file.
        data = self._stream.compress(text.encode()) + self._stream.flush(zlib.Z_SYNC_FLUSH)
        end = self._stream.copy()
        return data, end.compress(_TAIL) + end.flush()

    def _write(self, at: int, data: bytes) -> None:
        self._file.seek(at)
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]


def _own_fields(world: WorldState, modes: NDArray[np.integer] | None) -> list[str]:
    """The OWN_COLUMNS of each road user."""
    fields = [";0"] * len(world)
    for row, mode in zip(*learned_modes(world, modes), strict=True):
        fields[row] = f"{mode};1"
    return fields


def _escaped(names: tuple[str, ...]) -> tuple[str, ...] | list[str]:
    """Names as XML attribute values; most need no change, which one search over all of them shows."""
    together = "".join(names)
    if _NOT_IN_XML.search(together):
        bad = next(name for name in names if _NOT_IN_XML.search(name))
        raise InputError(f"id {bad!r} has a character that XML cannot hold; rename it")
    return [name.translate(_ESCAPES) for name in names] if _TO_ESCAPE.search(together) else names


def _quoted(names: tuple[str, ...]) -> tuple[str, ...] | list[str]:
    """Names as CSV fields."""
    if not _TO_QUOTE.search("".join(names)):
        return names
    return ['"' + name.replace('"', '""') + '"' if _TO_QUOTE.search(name) else name for name in names]
