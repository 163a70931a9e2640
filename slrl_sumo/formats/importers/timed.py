"""Tables with the columns track_id, timestamp_ms, agent_type, x and y: SinD, INTERACTION and similar data."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import CLASSES, RoadUserClass, users_of
from slrl_sumo.formats.importers.parts import Part
from slrl_sumo.formats.importers.table import Table, codes, read_table
from slrl_sumo.scene.geometry import Floats, wrap_angle

CLASSES_MIXED: dict[str, RoadUserClass] = {**CLASSES, "pedestrian/bicycle": CLASSES["pedestrian"]}
"""With the class of INTERACTION that means either of the two; see `interaction`."""


def read_timed(path: Path, heading: str | None, more: Sequence[str] = ()) -> Part:
    """Read a file.

    `heading` names the column with the orientation of the box in rad, which comes with length and width (cells of the
    three may be empty); None where the file has points only. `more` names further columns of numbers.
    """
    boxes = (heading, "length", "width") if heading else ()
    numbers = ["timestamp_ms", "x", "y", *boxes, *more]
    table = read_table(path, numbers, ["track_id", "agent_type"], optional=boxes)
    ids, _, user = codes(table.words("track_id"))
    return Part(
        table=table,
        users=users_of(table, "agent_type", user, sizes=bool(heading), classes=CLASSES_MIXED),
        ids=tuple(str(name) for name in ids),
        user=user,
        time=table.numbers("timestamp_ms") / 1000,
        x=table.numbers("x"),
        y=table.numbers("y"),
        heading=_headings(table, heading),
    )


def period_of(parts: Sequence[Part]) -> float:
    """Median time (s) between two rows of a road user. Raises InputError for an unusual value."""
    waits = []
    for part in parts:
        order = np.lexsort((part.time, part.user))
        wait = np.diff(part.time[order])
        waits.append(wait[(np.diff(part.user[order]) == 0) & (wait > 1e-6)])
    period = float(np.median(every)) if len(every := np.concatenate(waits)) else 0.1
    if not 0.005 <= period <= 1.0:
        raise InputError(
            f"{parts[0].table.path}: rows of a track follow each other every {period:g} s (median); check that "
            "column 'timestamp_ms' is in milliseconds"
        )
    return period


def _headings(table: Table, column: str | None) -> Floats:
    if column is None:
        return np.full(len(table), np.nan)
    angle = table.numbers(column)
    if (odd := np.abs(angle) > 2 * np.pi + 1e-3).any():
        row = int(np.flatnonzero(odd)[0])
        raise InputError(f"{table.where(row)}: column {column!r} is {angle[row]:g}, not an angle in radians")
    return wrap_angle(angle)
