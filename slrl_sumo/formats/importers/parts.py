"""Recordings in several files, often one for vehicles and one for pedestrians."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import Users
from slrl_sumo.formats.importers.resampling.resample import Samples
from slrl_sumo.formats.importers.table import EmptyTableError, Table
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats


class Part(NamedTuple):
    """N rows of U road users: one file of a recording. Metres, seconds, radians; x east, y north."""

    table: Table
    users: Users
    ids: tuple[str, ...]
    """(U,)"""
    user: Integers
    """Road user of each row, (N,)."""
    time: Floats
    x: Floats
    y: Floats
    heading: Floats
    """Orientation of the box, (N,); NaN where it follows from the motion."""


def parts_of(files: Sequence[tuple[Path, Callable[[Path], Part]]]) -> tuple[list[Part], tuple[str, ...]]:
    """The files of a recording, of which the first is the main one, and notes on files that do not contribute.

    A file may be missing or have no rows. Raises InputError where all have none.
    """
    parts: list[Part] = []
    notes: list[str] = []
    for number, (file, read) in enumerate(files):
        if not file.exists():
            if number == 0:
                notes.append(f"there is no {file.name}; the recording is what the file beside it holds")
            continue
        try:
            parts.append(read(file))
        except EmptyTableError:
            notes.append(f"{file.name} has no rows")
    if not parts:
        raise InputError(f"{files[0][0]}: no file of this recording has rows; give it whole")
    return parts, tuple(notes)


def samples_of(
    parts: Sequence[Part], source: str, licence: str, period: float, notes: Sequence[str] = (), smoothing: float = 0.0
) -> Samples:
    """The rows of all files of a recording; `period`, `notes` and `smoothing` as in Samples."""
    offsets = np.cumsum([0] + [len(part.ids) for part in parts])
    return Samples(
        file=str(parts[0].table.path),
        source=source,
        licence=licence,
        user=np.concatenate([part.user + offset for part, offset in zip(parts, offsets, strict=False)]),
        time=np.concatenate([part.time for part in parts]),
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        heading=np.concatenate([part.heading for part in parts]),
        period=period,
        ids=tuple(name for part in parts for name in part.ids),
        type=np.concatenate([part.users.type for part in parts]),
        length=np.concatenate([part.users.length for part in parts]),
        width=np.concatenate([part.users.width for part in parts]),
        still=np.zeros(offsets[-1]),
        smoothing=smoothing,
        notes=(*notes, *(note for part in parts for note in part.users.notes)),
    )
