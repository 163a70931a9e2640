"""HC, a real shared street: D1.csv, D2.csv, D3.csv with frame, id, x, y (pixels), type and no header."""

from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.classes import BICYCLE, CAR, PEDESTRIAN, users_of
from slrl_sumo.formats.importers.resampling.resample import SMOOTHING, Samples, resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "MIT (Hao Cheng 2020)"

PIXELS_PER_METRE = 21.1857
PERIOD = 0.5
"""s between two frames; inferred from speeds, the source does not say it."""

_CLASSES = {"1": PEDESTRIAN, "2": BICYCLE, "3": CAR}


def read_hc(path: Path) -> Trajectories:
    """Read one recording. y is turned up; boxes are the defaults of the types, headings come from smoothed motion."""
    table = read_table(path, ["frame", "id", "x", "y"], ["type"], names=["frame", "id", "x", "y", "type"])
    ids, _, user = codes(table.integers("id"))
    users = users_of(table, "type", user, sizes=False, classes=_CLASSES)
    return resample(
        Samples(
            file=str(path),
            source=f"HC {path.stem}",
            licence=LICENCE,
            user=user,
            time=PERIOD * table.integers("frame").astype(np.float64),
            x=table.numbers("x") / PIXELS_PER_METRE,
            y=-table.numbers("y") / PIXELS_PER_METRE,
            heading=np.full(len(table), np.nan),
            period=PERIOD,
            ids=tuple(str(i) for i in ids),
            type=users.type,
            length=users.length,
            width=users.width,
            still=np.zeros(len(ids)),
            smoothing=SMOOTHING,
            notes=users.notes,
        )
    )
