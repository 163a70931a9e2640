"""TGSIM (Third Generation Simulation Data of the U.S. Department of Transportation): all road users at 10 Hz, CSV."""

from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.classes import BICYCLE, CAR, CLASSES, PEDESTRIAN, users_of
from slrl_sumo.formats.importers.resampling.resample import Samples, resample
from slrl_sumo.formats.importers.table import codes, first_cells, read_table
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "TGSIM: public domain of the U.S. Department of Transportation (https://data.transportation.gov)"

PERIOD = 0.1
"""s between two rows of a road user."""

RUN_PAUSE = 100.0
"""s between two runs."""

CODES = {
    "0": PEDESTRIAN,
    "1": BICYCLE,
    "2": BICYCLE,  # scooter
    "3": CAR,
    "4": CAR,  # automated
    "5": CLASSES["motorcycle"],
    "6": CLASSES["bus"],
    "7": CLASSES["truck"],
}
"""Of `type_most_common` in Foggy Bottom and I-395; class names are known as well."""


def read_tgsim(path: Path) -> Trajectories:
    """Read one recording, all its runs one after another.

    Positions and times are those of the source, m and s. They are filtered there; headings follow from the motion.
    """
    run = [name for name in ("run_index",) if name in first_cells(path)]
    numbers = ["id", "time", "xloc_kf", "yloc_kf", "length_smoothed", "width_smoothed", *run]
    table = read_table(path, numbers, ["type_most_common"])
    which = table.integers("run_index") if run else np.zeros(len(table), np.int64)
    number = table.integers("id")
    _, first, user = codes(which * (int(number.max()) + 1) + number)
    table.columns["length"] = table.columns.pop("length_smoothed")
    table.columns["width"] = table.columns.pop("width_smoothed")
    users = users_of(table, "type_most_common", user, sizes=True, classes={**CLASSES, **CODES})
    # Runs begin at time 0 each; they must not overlap in time.
    time, runs = table.numbers("time"), np.unique(which)
    starts, ends = (np.array([reach(time[which == one]) for one in runs]) for reach in (np.min, np.max))
    offset = np.r_[0.0, np.cumsum(ends - starts + RUN_PAUSE)[:-1]] - starts
    return resample(
        Samples(
            file=str(path),
            source=f"TGSIM {path.stem}",
            licence=LICENCE,
            user=user,
            time=time + offset[np.searchsorted(runs, which)],
            x=table.numbers("xloc_kf"),
            y=table.numbers("yloc_kf"),
            heading=np.full(len(table), np.nan),
            period=PERIOD,
            ids=tuple(f"{r}-{i}" if run else str(i) for r, i in zip(which[first], number[first], strict=True)),
            type=users.type,
            length=users.length,
            width=users.width,
            still=np.zeros(len(first)),
            notes=users.notes,
        )
    )
