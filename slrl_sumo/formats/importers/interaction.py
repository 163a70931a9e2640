"""INTERACTION and TAF-BW: vehicle_tracks_NNN.csv, with pedestrian_tracks_NNN.csv beside it."""

from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.classes import BICYCLE, Users
from slrl_sumo.formats.importers.resample import resample
from slrl_sumo.formats.importers.timed import Part, read_timed, samples_of
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "INTERACTION: for non-commercial research, on request (https://interaction-dataset.com); TAF-BW: its own"

CYCLING = 2.5
"""m/s. A "pedestrian/bicycle" with a higher median speed while moving counts as a bicycle."""


def read_interaction(vehicles: Path) -> Trajectories:
    """Read the recording whose vehicles are in `vehicle_tracks_NNN.csv`; pedestrians, if any, are in files beside it.

    The class "pedestrian/bicycle" of the pedestrian files is decided per track by its speed.
    """
    parts = [read_timed(vehicles, "psi_rad")]
    walkers = vehicles.with_name(vehicles.name.replace("vehicle_tracks", "pedestrian_tracks"))
    if walkers != vehicles and walkers.exists():
        parts.append(_settle(read_timed(walkers, None, ["vx", "vy"])))
    return resample(samples_of(parts, f"{vehicles.resolve().parent.name} {vehicles.stem}", LICENCE))


def _settle(part: Part) -> Part:
    """With "pedestrian/bicycle" made one of the two."""
    speed = np.hypot(part.table.numbers("vx"), part.table.numbers("vy"))
    moving = np.flatnonzero(speed > 0.5)
    order = moving[np.lexsort((speed[moving], part.user[moving]))]
    count = np.bincount(part.user[order], minlength=len(part.first))
    some = count > 0
    median = np.zeros(len(part.first))
    median[some] = speed[order[(np.cumsum(count) - count + count // 2)[some]]]
    mixed = np.char.lower(part.table.words("agent_type")[part.first]) == "pedestrian/bicycle"
    cycling = mixed & (median > CYCLING)
    users = Users(
        type=np.where(cycling, BICYCLE.type, part.users.type).astype(np.int8),
        length=np.where(cycling, BICYCLE.length, part.users.length),
        width=np.where(cycling, BICYCLE.width, part.users.width),
    )
    return part._replace(users=users)
