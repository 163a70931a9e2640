"""inD, rounD, uniD and exiD (levelXdata): NN_tracks.csv, NN_tracksMeta.csv, NN_recordingMeta.csv."""

from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import users_of
from slrl_sumo.formats.importers.resampling.resample import Samples, resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.types import RoadUserType

LICENCE = "levelXdata: for non-commercial research, on request (https://levelxdata.com)"


def read_levelx(tracks_file: Path) -> Trajectories:
    """Read the recording that `NN_tracks.csv` belongs to. The two meta files must be beside it.

    Boxes and headings are those of the data. Pedestrians and bicycles, which have no box there (width 0), get the
    default box of their class and the heading of their smoothed motion: headings of the data jitter at standstill.
    """
    number = tracks_file.name.removesuffix("_tracks.csv")
    about = read_table(tracks_file.with_name(f"{number}_recordingMeta.csv"), ["frameRate"])
    rate = float(about.numbers("frameRate")[0])
    if not 1 <= rate <= 240:
        raise InputError(f"{about.where(0)}: column 'frameRate' is {rate:g}, which is not a rate in frames per second")
    meta = read_table(
        tracks_file.with_name(f"{number}_tracksMeta.csv"), ["trackId", "numFrames", "width", "length"], ["class"]
    )
    table = read_table(tracks_file, ["trackId", "frame", "xCenter", "yCenter", "heading"])

    ids, first, user = codes(table.integers("trackId"))
    listed, entry, which = codes(meta.integers("trackId"))
    if len(entry) != len(meta):
        row = int(np.setdiff1d(np.arange(len(meta)), entry)[0])
        raise InputError(f"{meta.where(row)}: trackId {listed[which[row]]} is there twice")
    if (unknown := ~np.isin(ids, listed)).any():
        row = int(first[unknown].min())
        raise InputError(f"{table.where(row)}: trackId {ids[user[row]]} is not in {meta.path.name}")
    rows = np.bincount(user, minlength=len(ids))
    due = np.zeros(len(listed), np.int64)
    due[np.searchsorted(listed, ids)] = rows
    if (short := due != meta.integers("numFrames")[entry]).any():
        at = int(np.flatnonzero(short)[0])
        raise InputError(
            f"{tracks_file}: {due[at]} rows of trackId {listed[at]}, {meta.path.name} says "
            f"{meta.integers('numFrames')[entry[at]]}; the file is cut off or not of this recording"
        )
    users = users_of(meta, "class", which, sizes=True).take(np.searchsorted(listed, ids))
    degrees = table.numbers("heading")
    if (odd := np.abs(degrees) > 360).any():
        row = int(np.flatnonzero(odd)[0])
        raise InputError(f"{table.where(row)}: column 'heading' is {degrees[row]:g}, not an angle in degrees")
    heading = wrap_angle(np.radians(degrees))
    boxless = (users.type != RoadUserType.CAR) & (meta.numbers("width")[entry[np.searchsorted(listed, ids)]] == 0)
    return resample(
        Samples(
            file=str(tracks_file),
            source=f"levelXdata {number}",
            licence=LICENCE,
            user=user,
            time=table.numbers("frame") / rate,
            x=table.numbers("xCenter"),
            y=table.numbers("yCenter"),
            heading=np.where(boxless[user], np.nan, heading),
            period=1 / rate,
            ids=tuple(str(i) for i in ids),
            type=users.type,
            length=users.length,
            width=users.width,
            still=heading[first],
            notes=users.notes,
        )
    )
