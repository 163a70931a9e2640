"""Tables whose rows have track_id, timestamp_ms, agent_type, x and y: SinD, INTERACTION and similar data."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import CLASSES, RoadUserClass, Users, users_of
from slrl_sumo.formats.importers.resample import Samples
from slrl_sumo.formats.importers.table import Table, codes, read_table
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats, wrap_angle


class Part(NamedTuple):
    """One file of a recording."""

    table: Table
    users: Users
    first: Integers
    """First row of each road user, (U,)."""
    user: Integers
    """Road user of each row, (N,)."""
    heading: str | None
    """Column with the orientation of the box, or None."""


def read_timed(path: Path, heading: str | None, more: Sequence[str] = ()) -> Part:
    """Read a file.

    `heading` names the column with the orientation of the box in rad, which comes with length and width; None where
    the file has points only. `more` names further columns of numbers.
    """
    boxes = (heading, "length", "width") if heading else ()
    table = read_table(path, ["timestamp_ms", "x", "y", *boxes, *more], ["track_id", "agent_type"])
    _, first, user = codes(table.words("track_id"))
    users = users_of(table, "agent_type", first, sizes=bool(heading), classes=CLASSES_MIXED)
    return Part(table, users, first, user, heading)


CLASSES_MIXED: dict[str, RoadUserClass] = {**CLASSES, "pedestrian/bicycle": CLASSES["pedestrian"]}
"""With the class of INTERACTION that means either of the two; see `interaction`."""


def samples_of(parts: Sequence[Part], source: str, licence: str) -> Samples:
    """The rows of the files of one recording."""
    counts = np.cumsum([0] + [len(part.first) for part in parts])
    time = np.concatenate([part.table.numbers("timestamp_ms") for part in parts]) / 1000
    user = np.concatenate([part.user + offset for part, offset in zip(parts, counts, strict=False)])
    order = np.lexsort((time, user))
    waits = np.diff(time[order])[np.diff(user[order]) == 0]
    period = float(np.median(waits)) if len(waits) else 0.1
    if not 0.005 <= period <= 1.0:
        raise InputError(
            f"{parts[0].table.path}: rows of a track follow each other every {period:g} s (median); check that "
            "column 'timestamp_ms' is in milliseconds"
        )
    return Samples(
        file=str(parts[0].table.path),
        source=source,
        licence=licence,
        user=user,
        time=time,
        x=np.concatenate([part.table.numbers("x") for part in parts]),
        y=np.concatenate([part.table.numbers("y") for part in parts]),
        heading=np.concatenate([_headings(part) for part in parts]),
        period=period,
        ids=tuple(str(i) for part in parts for i in part.table.words("track_id")[part.first]),
        type=np.concatenate([part.users.type for part in parts]),
        length=np.concatenate([part.users.length for part in parts]),
        width=np.concatenate([part.users.width for part in parts]),
        still=np.zeros(counts[-1]),
    )


def _headings(part: Part) -> Floats:
    if part.heading is None:
        return np.full(len(part.user), np.nan)
    angle = part.table.numbers(part.heading)
    if (odd := np.abs(angle) > 2 * np.pi + 1e-3).any():
        row = int(np.flatnonzero(odd)[0])
        raise InputError(f"{part.table.where(row)}: column {part.heading!r} is {angle[row]:g}, not an angle in radians")
    return wrap_angle(angle)
