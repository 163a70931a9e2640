"""Pictures and counts of modes, of all ways to find them side by side."""

import csv
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.supervised.goals import CLUSTERINGS, goals, ranges, weigh
from slrl_sumo.learning.supervised.modes import assign, cluster
from slrl_sumo.learning.supervised.windows import windows
from slrl_sumo.models.displacement import MODES
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.studies.prediction.plots import draw_modes

MODES_FILES = ("modes.csv", "modes-*.png")
"""What is written into the folder."""


def write_modes(recordings: Sequence[Trajectories], folder: Path, seed: int, types: Collection[str]) -> None:
    """Write modes-TYPE.png for each of `types`, names of types, and modes.csv, into `folder`, which is created.

    Clustered is what `fit` would learn from, without its mirrored windows.
    """
    every = windows(recordings)
    rows = []
    try:
        folder.mkdir(exist_ok=True)
        for t in (TYPE_NAMES.index(name) for name in types):
            mine = every.take(every.type == t)
            modes, known = {}, ranges(mine, (RoadUserType(t),))
            for name in CLUSTERINGS:
                goal = goals(mine, name, known)
                centres = cluster(goal, MODES, seed, TYPE_NAMES[t], weigh=weigh(name, RoadUserType(t)))
                modes[name] = assign(goal, centres)
                counts = np.bincount(modes[name], minlength=MODES)
                rows += [(name, TYPE_NAMES[t], mode, *centres[mode], counts[mode]) for mode in range(MODES)]
            draw_modes(mine, modes, MODES).savefig(folder / f"modes-{TYPE_NAMES[t]}.png", dpi=72)
        with open(folder / "modes.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("clustering", "type", "mode", "ahead_m", "left_m", "windows"))
            writer.writerows(rows)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); name another folder") from None
