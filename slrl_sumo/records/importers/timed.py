"""Tables whose rows have track_id, timestamp_ms, agent_type, x and y: SinD, INTERACTION and their kin."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.records.importers.classes import CLASSES, RoadUserClass, Users, users_of
from slrl_sumo.records.importers.resample import Samples
from slrl_sumo.records.importers.table import Table, codes, read_table
from slrl_sumo.records.trajectories import Integers
from slrl_sumo.world.geometry import Floats, wrap_angle


def read_timed(path: Path, heading: str | None, more: Sequence[str] = ()) -> tuple[Table, Users, Integers, Integers]:
    """The table, its road users, their first rows, and per row which road user it is.

    `heading` names the column with the orientation of the box in rad, which comes with length and width; None where
    the file has points only. `more` names further columns of numbers.
    """
    boxes = (heading, "length", "width") if heading else ()
    table = read_table(path, ["timestamp_ms", "x", "y", *boxes, *more], ["track_id", "agent_type"])
    _, first, user = codes(table.words("track_id"))
    return table, users_of(table, "agent_type", first, sizes=bool(heading), classes=CLASSES_MIXED), first, user


CLASSES_MIXED: dict[str, RoadUserClass] = {**CLASSES, "pedestrian/bicycle": CLASSES["pedestrian"]}
"""With the class of INTERACTION that leaves open which of the two it is; see `interaction`."""


def samples_of(
    parts: Sequence[tuple[Table, Users, Integers, Integers, str | None]], source: str, licence: str
) -> Samples:
    """The rows of several tables of one recording, each as `read_timed` gave it and with the name of its heading."""
    counts = np.cumsum([0] + [len(first) for _, _, first, _, _ in parts])
    time = np.concatenate([table.numbers("timestamp_ms") for table, *_ in parts]) / 1000
    user = np.concatenate([u + offset for (_, _, _, u, _), offset in zip(parts, counts, strict=False)])
    order = np.lexsort((time, user))
    waits = np.diff(time[order])[np.diff(user[order]) == 0]
    period = float(np.median(waits)) if len(waits) else 0.1
    if not 0.005 <= period <= 1.0:
        raise InputError(
            f"{parts[0][0].path}: rows of a track follow each other every {period:g} s (median); check that "
            "column 'timestamp_ms' is in milliseconds"
        )
    headings = []
    for table, _, _, rows, name in parts:
        angle = table.numbers(name) if name else np.full(len(rows), np.nan)
        if (odd := np.abs(angle) > 2 * np.pi + 1e-3).any():
            row = int(np.flatnonzero(odd)[0])
            raise InputError(f"{table.where(row)}: column {name!r} is {angle[row]:g}, not an angle in radians")
        headings.append(angle if name is None else wrap_angle(angle))

    def of_users(field: str) -> Floats:
        return np.concatenate([getattr(users, field) for _, users, *_ in parts])

    return Samples(
        file=str(parts[0][0].path),
        source=source,
        licence=licence,
        user=user,
        time=time,
        x=np.concatenate([table.numbers("x") for table, *_ in parts]),
        y=np.concatenate([table.numbers("y") for table, *_ in parts]),
        heading=np.concatenate(headings),
        period=period,
        ids=tuple(str(i) for table, _, first, _, _ in parts for i in table.words("track_id")[first]),
        type=of_users("type").astype(np.int8),
        length=of_users("length"),
        width=of_users("width"),
        still=np.zeros(counts[-1]),
    )
