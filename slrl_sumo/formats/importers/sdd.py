"""Stanford Drone Dataset: <scene>/video<k>/annotations.txt, with estimated_scales.yaml above the scenes."""

import re
from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.camera import camera_moves
from slrl_sumo.formats.importers.classes import BICYCLE, CAR, PEDESTRIAN, RoadUserClass, users_of
from slrl_sumo.formats.importers.resampling.resample import SMOOTHING, Samples, resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.input_files import read_text
from slrl_sumo.scene.types import RoadUserType

LICENCE = "CC BY-NC-SA 3.0 (Robicquet et al. 2016, Stanford Drone Dataset)"

FRAME_RATE = 30.0
SCALES = "estimated_scales.yaml"

CLASSES = {
    "pedestrian": PEDESTRIAN,
    "biker": BICYCLE,
    "skater": BICYCLE,  # median speed 4.2 m/s, bikers 4.1, pedestrians 1.3
    "car": CAR,
    "cart": RoadUserClass(RoadUserType.CAR, 2.4, 1.2),  # a golf cart
    "bus": RoadUserClass(RoadUserType.CAR, 8.5, 2.5),  # the campus shuttles' boxes at their longest
}

_NAMES = ["track", "xmin", "ymin", "xmax", "ymax", "frame", "lost", "occluded", "generated", "label"]


def read_sdd(annotations: Path) -> Trajectories:
    """Read one video. Rows with lost = 1 are gaps, y is turned up; boxes are the defaults of the classes.

    Times of camera motion are gaps as well (see `camera_moves`: the last 13 of 19 s of nexus/video5, where parked cars
    slide 10 m). Boxes of the data are axis-aligned: headings come from smoothed motion or, for road users that never
    move, from the longer side of the box. Skaters count as bicycles because of their speed.
    """
    scale = _scale(annotations)
    table = read_table(annotations, _NAMES[:-1], ["label"], names=_NAMES, delimiter=None)
    left, top, right, bottom = (table.numbers(name) for name in _NAMES[1:5])
    if (odd := (right < left) | (bottom < top)).any():
        raise InputError(f"{table.where(int(np.flatnonzero(odd)[0]))}: the box ends before it begins")
    track, frame = table.integers("track"), table.integers("frame")
    x, y = 0.5 * scale * (left + right), -0.5 * scale * (top + bottom)
    _, _, which = codes(track)
    users = users_of(table, "label", which, sizes=False, classes=CLASSES)

    kept = table.integers("lost") == 0
    cars = kept & (users.type[which] == RoadUserType.CAR)
    for start, end in camera_moves(track[cars], frame[cars], x[cars], y[cars], FRAME_RATE):
        kept &= (frame < start) | (frame > end)
    if not kept.any():
        raise InputError(f"{annotations}: every row has lost = 1 or the camera moves; nothing is left")
    ids, first, user = codes(track[kept])
    users = users.take(which[kept][first])
    upright = (bottom - top)[kept][first] > (right - left)[kept][first]
    return resample(
        Samples(
            file=str(annotations),
            source=f"SDD {'-'.join(_scene_and_video(annotations))}",
            licence=LICENCE,
            user=user,
            time=frame[kept] / FRAME_RATE,
            x=x[kept],
            y=y[kept],
            heading=np.full(len(user), np.nan),
            period=1 / FRAME_RATE,
            ids=tuple(str(i) for i in ids),
            type=users.type,
            length=users.length,
            width=users.width,
            still=np.where(upright, 0.5 * np.pi, 0.0),
            smoothing=SMOOTHING,
            notes=users.notes,
        )
    )


def _scene_and_video(annotations: Path) -> tuple[str, str]:
    folder = annotations.resolve().parent
    return folder.parent.name, folder.name


def _scale(annotations: Path) -> float:
    """Metres per pixel of the video."""
    scene, video = _scene_and_video(annotations)
    above = annotations.resolve().parents
    file = next((folder / SCALES for folder in above[:4] if (folder / SCALES).exists()), None)
    if file is None:
        raise InputError(f"{annotations}: there is no {SCALES} in the folders above; put it beside the scenes")
    names: list[str] = []
    try:
        lines = read_text(file).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise InputError(f"cannot read {file}: {reason}") from None
    for number, line in enumerate(lines, 1):
        match = re.match(r"( *)([^\s:#]+):\s*(\S*)", line)
        if match is None:
            continue
        depth = 0 if not match[1] else 1 if not match[3] else 2
        names = [*names[:depth], match[2]]
        if names == [scene, video, "scale"]:
            try:
                scale = float(match[3])
            except ValueError:
                scale = np.nan
            if not 0.001 < scale < 1:
                raise InputError(f"{file}, line {number}: {match[3]!r} is not a scale in metres per pixel")
            return scale
    raise InputError(f"{file} has no scale of {scene}, {video}; the folders must have the names of scene and video")
