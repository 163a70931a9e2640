"""INTERACTION and TAF-BW: vehicle_tracks_NNN.csv, with pedestrian_tracks_NNN.csv beside it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from slrl_sumo.records.importers.classes import BICYCLE, Users
from slrl_sumo.records.importers.resample import resample
from slrl_sumo.records.importers.table import Table
from slrl_sumo.records.importers.timed import read_timed, samples_of
from slrl_sumo.records.trajectories import Integers, Trajectories

LICENCE = "INTERACTION: for non-commercial research, on request (https://interaction-dataset.com); TAF-BW: its own"

CYCLING = 2.5
"""m/s. Who is called "pedestrian/bicycle" and moves at more (median while moving) is taken for a bicycle."""


def read_interaction(vehicles: Path) -> Trajectories:
    """Read the recording whose vehicles are in `vehicle_tracks_NNN.csv`; pedestrians lie beside it, if there are any.

    The class "pedestrian/bicycle" of the pedestrian files is settled per track by its speed.
    """
    parts = [(*read_timed(vehicles, "psi_rad"), "psi_rad")]
    walkers = vehicles.with_name(vehicles.name.replace("vehicle_tracks", "pedestrian_tracks"))
    if walkers != vehicles and walkers.exists():
        table, users, first, user = read_timed(walkers, None, ["vx", "vy"])
        parts.append((table, _settle(table, users, first, user), first, user, None))
    return resample(samples_of(parts, f"{vehicles.resolve().parent.name} {vehicles.stem}", LICENCE))


def _settle(table: Table, users: Users, first: Integers, user: Integers) -> Users:
    speed = np.hypot(table.numbers("vx"), table.numbers("vy"))
    moving = np.flatnonzero(speed > 0.5)
    order = moving[np.lexsort((speed[moving], user[moving]))]
    count = np.bincount(user[order], minlength=len(first))
    some = count > 0
    middle = (np.cumsum(count) - count + count // 2)[some]
    median = np.zeros(len(first))
    median[some] = speed[order[middle]]
    cycling = (np.char.lower(table.words("agent_type")[first]) == "pedestrian/bicycle") & (median > CYCLING)
    return replace(
        users,
        type=np.where(cycling, BICYCLE.type, users.type).astype(np.int8),
        length=np.where(cycling, BICYCLE.length, users.length),
        width=np.where(cycling, BICYCLE.width, users.width),
    )
