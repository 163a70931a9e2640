"""A trace, with additional files for data that its format lacks: learned road users (XML) and states of signals.

SUMO's schema of FCD has no attribute for a mode, and a processing instruction in its place would be an element to many
scripts that read it by lxml. Signals belong to no road user, and have no place in any of the formats.
"""

import csv
import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import Places, check_fcd_path, learned_modes, time_text
from slrl_sumo.formats.fcd.table import FcdTable
from slrl_sumo.formats.fcd.write import open_fcd, quoted
from slrl_sumo.formats.growing_file import GrowingFile
from slrl_sumo.formats.signal_states import SignalState, SignalsWriter
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.input_files import open_input, text_lines
from slrl_sumo.scene.state import WorldState

_COLUMNS = ["timestep_time", "vehicle_id", "person_id", "mode"]


def signals_file(fcd: Path) -> Path:
    """The file of signal states beside a trace: trace.signals.xml of trace.xml.gz. See formats.signal_states."""
    return _beside(fcd, ".signals.xml")


def learned_file(fcd: Path) -> Path | None:
    """The table of learned road users beside a trace in XML: trace.learned.csv; None of formats with these columns."""
    return _beside(fcd, ".learned.csv") if check_fcd_path(fcd).startswith(".xml") else None


def trace_files(fcd: Path) -> tuple[Path, ...]:
    """All files that a TraceWriter may write."""
    learned = learned_file(fcd)
    return (fcd, signals_file(fcd), *([] if learned is None else [learned]))


def _beside(fcd: Path, ending: str) -> Path:
    return fcd.with_name(fcd.name[: -len(check_fcd_path(fcd))] + ending)


class TraceWriter:
    """Writes a trace, and the files beside it where there are signals, or learned road users in XML; older files
    of these names are removed. A context manager.

    `elevated`: whether its places have heights. Each file is whole after each `write` (see GrowingFile). Raises
    InputError where one cannot be written.
    """

    def __init__(self, fcd: Path, *, elevated: bool = False) -> None:
        self._fcd = open_fcd(fcd, elevated=elevated)
        for file in trace_files(fcd)[1:]:
            file.unlink(missing_ok=True)
        self._signals = SignalsWriter(signals_file(fcd))
        self._learned_file = learned_file(fcd)
        self._learned: GrowingFile | None = None

    def write(self, time: float, world: WorldState, places: Places, modes: NDArray[np.integer] | None = None) -> None:
        """Add the time step `time` (s), as FcdWriter does."""
        self._fcd.write(time, world, places, modes)
        if self._learned_file is None or not world.learned.any():
            return
        rows, mode = learned_modes(world, modes)
        names, stamp = quoted([world.ids[row] for row in rows]), time_text(time)
        lines = [
            f"{stamp};;{name};{m}\n" if person else f"{stamp};{name};;{m}\n"
            for name, person, m in zip(names, places.person[rows].tolist(), mode, strict=True)
        ]
        self._learned = self._learned or GrowingFile(self._learned_file, ";".join(_COLUMNS) + "\n", "")
        self._learned.put("".join(lines))

    def write_signals(self, time: float, states: Iterable[SignalState]) -> None:
        """Add the states of traffic lights from `time` (s) on."""
        self._signals.write(time, states)

    def close(self) -> None:
        """Finish the files. May be called twice."""
        for file in (self._fcd, self._signals, self._learned):
            if file is not None:
                file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def add_learned(table: FcdTable, path: Path, *, complete: bool = True) -> None:
    """Mark the learned road users of the file `path` (see `learned_file`) in a table of the trace beside it.

    Raises InputError where it cannot be read, and where it names road users that are not in the trace at that time,
    unless the trace is not `complete`.
    """
    key, now, mode = _read_learned(table, path)
    users = len(table.users)
    known = np.frombuffer(table.step, np.int32).astype(np.int64) * users + np.frombuffer(table.key, np.int32)
    order = np.argsort(known)
    wanted = now * users + key
    at = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(order) - 1)]
    foreign = known[at] != wanted
    if complete and foreign.any():
        raise InputError(
            f"{path}: {int(foreign.sum())} of its {len(at)} rows are not in the trace; is it another run's?"
        )
    np.frombuffer(table.learned, np.int8)[at[~foreign]] = 1
    np.frombuffer(table.mode, np.int8)[at[~foreign]] = mode[~foreign]
    table.marks_learned = True


def _read_learned(table: FcdTable, path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8]]:
    """Road user and step (indices in `table`; -1 of another trace) and 1 + mode (0: none) of each row."""
    steps = {time: number for number, time in enumerate(table.steps)}
    users = {(name, key in table.persons): key for key, (name, _) in enumerate(table.users)}
    rows: list[tuple[int, int, int]] = []
    lines = csv.reader("")
    try:
        with open_input(path) as raw:
            lines = csv.reader(text_lines(raw), delimiter=";", strict=True)
            if next(lines, []) != _COLUMNS:
                raise ValueError(f"the columns are not {';'.join(_COLUMNS)}")
            for time, vehicle, person, mode in lines:
                seconds = parse_time(time)
                step = -1 if seconds is None else steps.get(round(1000 * seconds), -1)
                key = users.get((vehicle or person, not vehicle), -1)
                rows.append((key, step, 1 + int(mode) if mode else 0))
                if not 0 <= rows[-1][2] <= 100:
                    raise ValueError(f"there is no mode {mode}")
    except (ValueError, csv.Error) as error:
        raise InputError(
            f"{path}, line {lines.line_num}: {error}; remove the file, or write it again with the run"
        ) from None
    except OSError as error:
        raise InputError(f"cannot read {os.fspath(path)}: {error.strerror or error}") from None
    found = np.array(rows, np.int64).reshape(-1, 3)
    return found[:, 0], np.where(found[:, 0] < 0, -1, found[:, 1]), found[:, 2].astype(np.int8)
