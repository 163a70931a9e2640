"""HC, a real shared street: D1.csv, D2.csv, D3.csv with frame, id, x, y (pixels), type and no header."""

from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import BICYCLE, CAR, PEDESTRIAN
from slrl_sumo.formats.importers.resample import Samples, resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "MIT (Hao Cheng 2020)"

PIXELS_PER_METRE = 21.1857
PERIOD = 0.5
"""s between two frames; inferred from speeds, the source does not say it."""

_CLASSES = {1: PEDESTRIAN, 2: BICYCLE, 3: CAR}


def read_hc(path: Path) -> Trajectories:
    """Read one recording. y is turned up; boxes are the defaults of the types, headings come from smoothed motion."""
    table = read_table(path, ["frame", "id", "x", "y", "type"], names=["frame", "id", "x", "y", "type"])
    ids, first, user = codes(table.integers("id"))
    numbers = table.integers("type")
    if (unknown := ~np.isin(numbers, list(_CLASSES))).any():
        row = int(np.flatnonzero(unknown)[0])
        raise InputError(
            f"{table.where(row)}: unknown type {numbers[row]}; known are 1 pedestrian, 2 cyclist, 3 vehicle"
        )
    classes = [_CLASSES[n] for n in numbers[first].tolist()]
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
            type=np.array([c.type for c in classes], np.int8),
            length=np.array([c.length for c in classes]),
            width=np.array([c.width for c in classes]),
            still=np.zeros(len(ids)),
            noisy=True,
        )
    )
