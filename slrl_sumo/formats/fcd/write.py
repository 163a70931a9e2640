"""Floating car data (FCD) as SUMO writes it (https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html)."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import (
    Places,
    check_fcd_path,
    figures,
    height_figures,
    learned_modes,
    table_columns,
    time_text,
)
from slrl_sumo.formats.growing_file import GrowingFile
from slrl_sumo.formats.xml_text import escaped
from slrl_sumo.scene.state import WorldState

if TYPE_CHECKING:
    from slrl_sumo.formats.fcd.parquet import ParquetWriter

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n\n'
    '<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">\n'
)

_TAIL = "</fcd-export>\n"

_TAGS = "vehicle", "person"

_TO_QUOTE = re.compile(r'[;"\n\r]')


def open_fcd(path: str | os.PathLike[str], *, elevated: bool = False) -> "FcdWriter | ParquetWriter":
    """A writer for the format of the file's suffix, see FcdWriter, which raises the same."""
    if check_fcd_path(path) != ".parquet":
        return FcdWriter(path, elevated=elevated)
    from slrl_sumo.formats.fcd.parquet import ParquetWriter  # pyarrow is an extra

    return ParquetWriter(path, elevated=elevated)


class _Forms:
    """Rows of the road users as text, from (id, x, y, angle, type, speed, pos, lane or edge); with heights z follows y,
    and the slope comes last."""

    def __init__(self, csv: bool, elevated: bool) -> None:
        slope = "%.2f" if elevated else "0.00"
        if csv:
            z, unknown = ("%.3f;", "") if elevated else ("", "0.00")
            pose = f"%s;%.3f;%.3f;{z}%.2f;%s;%.3f"
            self.with_lane, self.with_edge = f"{pose};%.3f;%s;;{slope};%s\n", f"{pose};%.3f;;%s;{slope};%s\n"
            self.vehicle_nowhere = self.person_nowhere = f"{pose};;;;{unknown};%s\n"
        else:
            z, unknown = (' z="%.3f"', "") if elevated else ("", ' slope="0.00"')
            pose = f' id="%s" x="%.3f" y="%.3f"{z} angle="%.2f" type="%s" speed="%.3f"'
            self.with_lane = f'        <vehicle{pose} pos="%.3f" lane="%s" slope="{slope}"/>\n'
            self.with_edge = f'        <person{pose} pos="%.3f" edge="%s" slope="{slope}"/>\n'
            self.vehicle_nowhere, self.person_nowhere = (f"        <{tag}{pose}{unknown}/>\n" for tag in _TAGS)


class FcdWriter:
    """Writes an FCD file as XML or CSV, step by step; a context manager. `elevated`: whether its places have heights.

    The same worlds give the same bytes. Each time step is on disk when `write` returns, and the file is complete and
    valid after each, also if the process dies. Only a kill inside the one system call that writes a step can cut the
    file off; `replay` then shows the steps before it, and `read_fcd` counts them in its error. Raises InputError, with
    path and reason, on construction if the suffix is unknown or the file cannot be written, and in `write` if writing
    fails; the file then ends with the step before and is closed.
    """

    def __init__(self, path: str | os.PathLike[str], *, elevated: bool = False) -> None:
        self.path = Path(path)
        suffix = check_fcd_path(path)
        if suffix == ".parquet":
            raise InputError(f"{self.path}: Parquet has a writer of its own; call open_fcd")
        self._csv, self._elevated = suffix == ".csv", elevated
        self._forms = _Forms(self._csv, elevated)
        head, tail = (";".join(table_columns(elevated)) + "\n", "") if self._csv else (_HEAD, _TAIL)
        self._file = GrowingFile(self.path, head, tail)

    def write(self, time: float, world: WorldState, places: Places, modes: NDArray[np.integer] | None = None) -> None:
        """Add the time step `time` (s): first the vehicles, then the persons, each in the order of `world`.

        Positions become those of front bumpers, headings SUMO's angles. `modes`: of the learned road users, in their
        order; None where they have none. Raises ValueError if a value is not finite.
        """
        if self._file.closed:
            raise ValueError(f"{self.path} is closed")
        x, y, angle, speed, position = figures(time, world, places)
        escape = quoted if self._csv else escaped
        heights = height_figures(places, self._elevated)
        z, slope = ([], []) if heights is None else ([each.tolist()] for each in heights)
        columns = [
            *(escape(world.ids), x.tolist(), y.tolist(), *z, angle.tolist(), escape(places.sumo_type)),
            *(speed.tolist(), position.tolist(), escape(places.lane), *slope),
        ]
        # The places of pos, lane and slope.
        begin = 6 + len(z)
        lane, end = begin + 1, begin + 2 + len(slope)
        stamp = time_text(time)
        forms = self._forms
        with_lane, with_edge, nowhere, person_nowhere = (
            f"{stamp};{form}" if self._csv else form
            for form in (forms.with_lane, forms.with_edge, forms.vehicle_nowhere, forms.person_nowhere)
        )
        if self._csv:
            columns.append(_own_fields(world, modes))
        rows = zip(*columns, strict=True)
        if places.person.any():
            vehicles, persons = [], []
            for person, row in zip(places.person.tolist(), rows, strict=True):
                if person:
                    persons.append(with_edge % row if row[lane] else person_nowhere % (row[:begin] + row[end:]))
                else:
                    vehicles.append(with_lane % row if row[lane] else nowhere % (row[:begin] + row[end:]))
            lines = vehicles + persons
        else:
            lines = [with_lane % row if row[lane] else nowhere % (row[:begin] + row[end:]) for row in rows]
        text = "".join(lines)
        if not self._csv:
            text = (
                f'    <timestep time="{stamp}">\n{text}    </timestep>\n'
                if text
                else f'    <timestep time="{stamp}"/>\n'
            )
        self._file.put(text)

    def close(self) -> None:
        """Finish the file. May be called twice."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _own_fields(world: WorldState, modes: NDArray[np.integer] | None) -> list[str]:
    """The OWN_COLUMNS of each road user."""
    fields = [";0"] * len(world)
    for row, mode in zip(*learned_modes(world, modes), strict=True):
        fields[row] = f"{mode};1"
    return fields


def quoted(names: Sequence[str]) -> Sequence[str]:
    """Names as CSV fields."""
    if not _TO_QUOTE.search("".join(names)):
        return names
    return ['"' + name.replace('"', '""') + '"' if _TO_QUOTE.search(name) else name for name in names]
