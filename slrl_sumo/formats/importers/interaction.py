"""INTERACTION and TAF-BW: vehicle_tracks_NNN.csv, with pedestrian_tracks_NNN.csv beside it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.classes import BICYCLE
from slrl_sumo.formats.importers.parts import Part, parts_of, samples_of
from slrl_sumo.formats.importers.resampling.resample import Samples, resample
from slrl_sumo.formats.importers.timed import period_of, read_timed
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "INTERACTION: for non-commercial research, on request (https://interaction-dataset.com)"
LICENCE_TAF_BW = "CC BY-NC-SA 4.0 (Test Area Autonomous Driving Baden-Württemberg, Fleck et al. 2018)"

CYCLING = 2.5
"""m/s. A "pedestrian/bicycle" with a higher median speed while moving counts as a bicycle."""


TRACKED = 0.1
"""s⁴, as `resample.SMOOTHING`, for the online tracker of TAF-BW: a period of 3.5 s. Its cars go from 5 to 17 m/s and
back within a second: a tenth of the accelerations is above 6.3 m/s²; smoothed so, above 1.8 m/s², and a hundredth above
3.5 m/s². This moves positions by 0.48 m (root mean square)."""


def read_interaction(vehicles: Path) -> Trajectories:
    """Read the recording with vehicles in `vehicle_tracks_NNN.csv`; pedestrians, if any, are in files beside it.

    The class "pedestrian/bicycle" of the pedestrian files is decided per track by its speed.
    """
    return resample(_samples(vehicles, LICENCE, smoothing=0.0))


def read_taf_bw(vehicles: Path) -> Trajectories:
    """Read a recording of TAF-BW, which has the form of INTERACTION but is not smoothed: positions are smoothed here.

    Headings follow from the smoothed motion: in k733_2018-05-02 psi_rad is against the motion of 48 of 132 cars.
    """
    return resample(_samples(vehicles, LICENCE_TAF_BW, smoothing=TRACKED))


def _samples(vehicles: Path, licence: str, smoothing: float) -> Samples:
    walkers = vehicles.with_name(vehicles.name.replace("vehicle_tracks", "pedestrian_tracks"))
    files = [(vehicles, _read_vehicles), (walkers, _read_walkers)]
    parts, notes = parts_of(files if walkers != vehicles else files[:1])
    source = f"{vehicles.resolve().parent.name} {vehicles.stem}"
    return samples_of(parts, source, licence, period_of(parts), notes, smoothing)


def _read_vehicles(file: Path) -> Part:
    return read_timed(file, "psi_rad")


def _read_walkers(file: Path) -> Part:
    return _settle(read_timed(file, None, ["vx", "vy"]))


def _settle(part: Part) -> Part:
    """Replace the class "pedestrian/bicycle" by one of the two types."""
    speed = np.hypot(part.table.numbers("vx"), part.table.numbers("vy"))
    moving = np.flatnonzero(speed > 0.5)
    order = moving[np.lexsort((speed[moving], part.user[moving]))]
    count = np.bincount(part.user[order], minlength=len(part.ids))
    some = count > 0
    _, first = np.unique(part.user, return_index=True)
    median = np.zeros(len(part.ids))
    median[some] = speed[order[(np.cumsum(count) - count + count // 2)[some]]]
    mixed = np.char.lower(part.table.words("agent_type")[first]) == "pedestrian/bicycle"
    cycling = mixed & (median > CYCLING)
    users = replace(
        part.users,
        type=np.where(cycling, BICYCLE.type, part.users.type).astype(np.int8),
        length=np.where(cycling, BICYCLE.length, part.users.length),
        width=np.where(cycling, BICYCLE.width, part.users.width),
    )
    return part._replace(users=users)
