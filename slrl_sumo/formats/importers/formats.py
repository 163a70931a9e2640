"""The formats by name: search for recordings in a folder, reading, and joining of several recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.read import read_fcd
from slrl_sumo.formats.importers.dut import read_citr, read_dut
from slrl_sumo.formats.importers.hc import read_hc
from slrl_sumo.formats.importers.interaction import read_interaction, read_taf_bw
from slrl_sumo.formats.importers.levelx import read_levelx
from slrl_sumo.formats.importers.ngsim import read_ngsim
from slrl_sumo.formats.importers.sdd import read_sdd
from slrl_sumo.formats.importers.sind import read_sind
from slrl_sumo.formats.importers.tgsim import read_tgsim
from slrl_sumo.formats.trajectories import Trajectories, track_names

RECORDING_PAUSE = 250
"""Intervals between two joined recordings: 100 s, longer than any rollout."""


@dataclass(frozen=True)
class Format:
    """Rules to find and read the recordings of a data set."""

    read: Callable[[Path], Trajectories]
    """From the main file of a recording."""
    files: tuple[str, ...]
    """Patterns of the names of main files."""
    parts: tuple[str, ...] = ()
    """Patterns of the names of files that are a recording even where its main file is missing."""
    siblings: dict[str, str] = field(default_factory=dict)
    """Parts of the names of a recording's other files, and their counterparts in the name of the main file."""
    folders: int = 0
    """Folders above the file that are part of the recording's name."""
    stem: bool = True
    """Whether the name of the file is part of it."""


_LEVELX = Format(
    read_levelx,
    ("*_tracks.csv",),
    siblings={"_tracksMeta.csv": "_tracks.csv", "_recordingMeta.csv": "_tracks.csv", "_background.png": "_tracks.csv"},
)
_TRACKS = ("vehicle_tracks_*.csv",), ("pedestrian_tracks_*.csv",), {"pedestrian_tracks_": "vehicle_tracks_"}, 1
_CLIPS = ("*_traj_ped_filtered.csv",), ("*_traj_veh_filtered.csv",), {"_traj_veh_filtered": "_traj_ped_filtered"}

FORMATS = {
    "levelx": _LEVELX,
    "ind": _LEVELX,
    "round": _LEVELX,
    "unid": _LEVELX,
    "exid": _LEVELX,
    "sind": Format(
        read_sind, ("Veh_smoothed_tracks.csv",), ("Ped_smoothed_tracks.csv",), {"Ped_": "Veh_"}, folders=1, stem=False
    ),
    "interaction": Format(read_interaction, *_TRACKS),
    "taf-bw": Format(read_taf_bw, *_TRACKS),
    "sdd": Format(read_sdd, ("annotations.txt",), siblings={"reference.jpg": "annotations.txt"}, folders=2, stem=False),
    "dut": Format(read_dut, *_CLIPS),
    "citr": Format(read_citr, *_CLIPS),
    "ngsim": Format(read_ngsim, ("*.csv", "*.txt")),
    "tgsim": Format(read_tgsim, ("*.csv",)),
    "hc": Format(read_hc, ("*.csv",)),
    "fcd": Format(read_fcd, ("*.xml", "*.xml.gz", "*.csv", "*.parquet")),
}
"""By the name that users give, in lower case."""


@dataclass(frozen=True)
class Recording:
    """One recording of a data set."""

    name: str
    """Unique among the recordings found with it; fit for a file name."""
    path: Path
    """Its main file."""
    format: Format

    def read(self) -> Trajectories:
        """Its trajectories. Raises InputError if a file is invalid or no road user is there for a whole interval."""
        try:
            trajectories = self.format.read(self.path)
        except ValueError as error:  # Trajectories that cannot be
            raise InputError(f"{self.path}: {error}") from None
        if not len(trajectories):
            raise InputError(f"{self.path} holds no road user at any whole interval of {trajectories.dt} s")
        return trajectories


def find_recordings(format: str, path: Path) -> list[Recording]:
    """The recordings in a folder and its subfolders, by name, or the recording of a file.

    Raises InputError on an unknown format and where there is none.
    """
    found = FORMATS.get(format.lower())
    if found is None:
        raise InputError(f"{format!r} is not a format; known are {', '.join(FORMATS)}")
    if path.is_file():
        files = [_main(found, path)]
    elif path.is_dir():
        patterns = (*found.files, *found.parts)
        files = sorted({_main(found, file) for pattern in patterns for file in path.rglob(pattern) if file.is_file()})
    else:
        raise InputError(f"{path} does not exist; name a file or a folder of recordings")
    if not files:
        raise InputError(f"{path} holds no recording of format {format}: no file {' or '.join(found.files)}")
    names = track_names(_name(found, file) for file in files)
    return [Recording(name, file, found) for name, file in zip(names, files, strict=True)]


def _main(format: Format, file: Path) -> Path:
    """The main file of the recording that a file belongs to; it need not be there."""
    name = file.name
    for part, main in format.siblings.items():
        name = name.replace(part, main)
    return file.with_name(name)


def _name(format: Format, file: Path) -> str:
    folders = file.resolve().parent.parts[1:][-format.folders :] if format.folders else ()
    stem = file.name.split(".")[0]
    for end in ("_tracks", "_traj_ped_filtered"):
        stem = stem.removesuffix(end)
    return "-".join([*folders, *([stem] if format.stem else [])])


def join(recordings: Sequence[tuple[str, Trajectories]]) -> Trajectories:
    """Several named recordings as one, each `RECORDING_PAUSE` intervals after the previous: their road users do not
    interact.

    Tracks are called `name/id`. A single recording stays as it is.
    """
    if len(recordings) == 1:
        return recordings[0][1]
    parts = [part for _, part in recordings]
    offsets, first = [], 0
    for part in parts:
        offsets.append(first - part.frames.start)
        first += len(part.frames) + RECORDING_PAUSE
    tracks = np.cumsum([0] + [len(part.ids) for part in parts])

    return Trajectories(
        track=np.concatenate([part.track + offset for part, offset in zip(parts, tracks, strict=False)]),
        frame=np.concatenate([part.frame + offset for part, offset in zip(parts, offsets, strict=True)]),
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        heading=np.concatenate([part.heading for part in parts]),
        ids=tuple(f"{name}/{i}" for name, part in recordings for i in part.ids),
        type=np.concatenate([part.type for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        width=np.concatenate([part.width for part in parts]),
        source="; ".join(dict.fromkeys(part.source for part in parts)),
        licence="; ".join(dict.fromkeys(part.licence for part in parts)),
        parked=np.concatenate([part.parked for part in parts]),
        learned=np.concatenate([part.learned for part in parts]),
        mode=np.concatenate([part.mode for part in parts]),
        notes=tuple(f"{name}: {note}" for name, part in recordings for note in part.notes),
    )
