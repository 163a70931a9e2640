"""NGSIM (US 101, I-80, Lankershim, Peachtree): vehicles at 10 Hz in feet, as text without or CSV with a header."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import CAR, RoadUserClass, users_of
from slrl_sumo.formats.importers.resampling.resample import Samples, resample
from slrl_sumo.formats.importers.table import Table, codes, first_cells, read_table
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.types import RoadUserType

LICENCE = "NGSIM: public domain of the U.S. Department of Transportation (https://doi.org/10.21949/1504477)"

FOOT = 0.3048
"""m."""
PERIOD = 0.1
"""s between two rows of a vehicle."""
TRACKED = 0.1
"""s⁴, as `resample.SMOOTHING`: a period of 3.5 s, as for the tracker of TAF-BW. Speeds of NGSIM are differences of
positions from video and go to zero and back within a second."""

COLUMNS = (
    *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y"),
    *("v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc"),
)
"""The first columns of all files; further ones, such as Lane_ID, differ and are not read."""

CLASSES = {
    "1": RoadUserClass(RoadUserType.CAR, 2.2, 0.9),  # motorcycle
    "2": CAR,
    "3": RoadUserClass(RoadUserType.CAR, 7.1, 2.4),  # truck or bus
}


def read_ngsim(path: Path) -> Trajectories:
    """Read one recording.

    x points to the right of the study section and y along it (Local_X, Local_Y). Positions are smoothed, headings
    follow from the motion, and positions, which are those of the middle of the front, are moved to the centre of the
    box. Raises InputError where a file holds several locations.
    """
    table = _table(path)
    # Numbers of vehicles begin anew in each period of a recording; a vehicle has one Total_Frames.
    vehicle, frames = table.integers("Vehicle_ID"), table.integers("Total_Frames")
    _, first, user = codes(vehicle * 100_000 + frames)
    table.columns["length"] = FOOT * table.numbers("v_Length")
    table.columns["width"] = FOOT * table.numbers("v_Width")
    users = users_of(table, "v_Class", user, sizes=True, classes=CLASSES)
    made = resample(
        Samples(
            file=str(path),
            source=f"NGSIM {path.stem}",
            licence=LICENCE,
            user=user,
            time=table.numbers("Global_Time") / 1000.0,
            x=FOOT * table.numbers("Local_X"),
            y=FOOT * table.numbers("Local_Y"),
            heading=np.full(len(table), np.nan),
            period=PERIOD,
            ids=tuple(str(i) for i in vehicle[first]),
            type=users.type,
            length=users.length,
            width=users.width,
            still=np.full(len(first), 0.5 * np.pi),
            smoothing=TRACKED,
            notes=users.notes,
        )
    )
    back = 0.5 * made.length[made.track]
    return replace(made, x=made.x - back * np.cos(made.heading), y=made.y - back * np.sin(made.heading))


def _table(path: Path) -> Table:
    cells = first_cells(path)
    if cells and cells[0].isdigit():
        names = (*COLUMNS, *(f"more_{k}" for k in range(len(cells) - len(COLUMNS))))
        return read_table(path, [name for name in COLUMNS if name != "v_Class"], ["v_Class"], names, delimiter=None)
    lower = {name.lower(): name for name in cells}
    *numbers, kind = [lower.get(name.lower(), name) for name in (*(c for c in COLUMNS if c != "v_Class"), "v_Class")]
    place = [name for name in ("Location",) if name in cells]
    table = read_table(path, numbers, [kind, *place])
    if place and len(found := np.unique(table.words("Location"))) > 1:
        raise InputError(
            f"{path} holds {len(found)} locations ({', '.join(found)}), which have coordinates of their own; "
            "make a file of each"
        )
    # Some files write v_length: from here on as documented.
    return replace(table, columns=table.columns | {c: table.columns[lower[c.lower()]] for c in COLUMNS})
