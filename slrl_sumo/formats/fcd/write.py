"""Floating car data (FCD) as SUMO writes it (https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html)."""

import gzip
import os
import re
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import CSV_COLUMNS, OWN_COLUMNS, Places, check_fcd_path, figures, learned_modes
from slrl_sumo.scene.state import WorldState

if TYPE_CHECKING:
    from slrl_sumo.formats.fcd.parquet import ParquetWriter

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n\n'
    '<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">\n'
)

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

_FLUSH_CHARACTERS = 1 << 18


def open_fcd(path: str | os.PathLike[str]) -> "FcdWriter | ParquetWriter":
    """A writer for the format of the file's suffix. Raises InputError as FcdWriter does."""
    if check_fcd_path(path) != ".parquet":
        return FcdWriter(path)
    from slrl_sumo.formats.fcd.parquet import ParquetWriter  # pyarrow is an extra

    return ParquetWriter(path)


class FcdWriter:
    """Writes an FCD file as XML or CSV, step by step; a context manager.

    The same worlds give the same bytes. The file on disk is valid at any time, even if the process dies, and after
    `close` it holds every time step up to the last one that could be written completely. A pipe is valid after `close`.
    Raises InputError, with path and reason, on construction if the suffix is unknown or the file cannot be written, and
    in `write` or `close` if writing fails; the file is then closed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        suffix = check_fcd_path(path)
        self._gzip = suffix == ".xml.gz"
        self._csv = suffix == ".csv"
        self._tail = b"" if self._csv else self._encode("</fcd-export>\n")
        self._whole = 0
        """Bytes on disk up to the last complete time step; the tail follows, and the next steps overwrite it."""
        self._waiting: list[str] = []
        self._waiting_characters = 0
        try:
            self._file = open(self.path, "wb", buffering=0)  # noqa: SIM115 (closed by close)
        except OSError as e:
            raise InputError(f"cannot write {self.path}: {e.strerror or e}") from e
        self._seekable = self._file.seekable()
        self._put([";".join(CSV_COLUMNS + OWN_COLUMNS) + "\n" if self._csv else _HEAD])

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
        self._waiting.append(text)
        self._waiting_characters += len(text)
        if self._waiting_characters >= _FLUSH_CHARACTERS:
            self._flush()

    def close(self) -> None:
        """Finish the file. May be called twice."""
        if not self._file.closed:
            self._flush()
            if not self._seekable:
                self._put([""])
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            self.close()
        except InputError:
            if error is None:  # else the first error says more
                raise

    def _flush(self) -> None:
        steps, self._waiting, self._waiting_characters = self._waiting, [], 0
        if steps:
            self._put(steps)

    def _encode(self, text: str) -> bytes:
        # Each piece is a separate gzip member, so that the file can be cut back to the last complete one.
        return gzip.compress(text.encode(), compresslevel=4, mtime=0) if self._gzip else text.encode()

    def _put(self, steps: list[str]) -> None:
        """Write complete time steps and the tail; if that fails, as many steps as fit."""
        try:
            self._put_text("".join(steps))
        except OSError as e:
            # It is unknown how much of the text a pipe has passed on.
            with suppress(OSError):
                for step in steps if self._seekable else ():
                    self._put_text(step)
            self._file.close()
            raise InputError(f"cannot write {self.path}: {e.strerror or e}") from e

    def _put_text(self, text: str) -> None:
        data = self._encode(text) if text else b""
        if not self._seekable:
            self._write(data or self._tail)
            return
        try:
            self._file.seek(self._whole)
            self._write(data + self._tail)
        except BaseException:  # an interrupt must not leave half a step behind either
            with suppress(OSError):  # a device cannot be cut
                self._file.truncate(self._whole)
                self._file.seek(self._whole)
                self._write(self._tail)
            raise
        self._whole += len(data)

    def _write(self, data: bytes) -> None:
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
