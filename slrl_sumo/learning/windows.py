"""Windows: what road users saw in recordings, what they did next and where they were 4.8 s later."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.features import FEATURES, features
from slrl_sumo.records.trajectories import Trajectories
from slrl_sumo.world.geometry import Floats, to_ego

PAST = 2
"""Intervals a road user must have been recorded for: a speed needs one, an acceleration two."""

FUTURE = 12
"""Intervals from a window to its destination: 4.8 s (paper, section 3.2)."""


@dataclass(frozen=True, eq=False)
class Windows:
    """N moments of recorded road users, as parallel arrays. Ego frame: that of the moment itself."""

    vector: NDArray[np.float32]
    """Features at the moment, (N, 12)."""
    type: NDArray[np.int64]
    """RoadUserType, (N,)."""
    acceleration: Floats
    """m/s² carried out in the next interval, (N,)."""
    yaw_rate: Floats
    """rad/s carried out in the next interval, (N,)."""
    displacement: Floats
    """Position after the next interval, (N, 2) m, ego frame."""
    destination: Floats
    """Position after 12 intervals, (N, 2) m, ego frame."""
    track: NDArray[np.int64]
    """Index of the track in its recording, (N,)."""
    recording: NDArray[np.int64]
    """Index of the recording, (N,)."""

    def __len__(self) -> int:
        return len(self.type)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "Windows":
        """The windows `rows` (a mask or indices)."""
        return Windows(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


def windows(recordings: Sequence[Trajectories], stride: int = 1) -> Windows:
    """All windows of the recordings: each row that has 2 rows before it and 12 after it in its track.

    With `stride` > 1 only every stride-th frame number counts. Features come from the same code that live simulation
    uses, with every recorded road user of the frame around.
    """
    parts = [_of_one(recording, index, stride) for index, recording in enumerate(recordings)]
    names = Windows.__dataclass_fields__
    return Windows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _of_one(recording: Trajectories, index: int, stride: int) -> Windows:
    row = np.arange(PAST, len(recording.frame) - FUTURE)
    # Rows of a track follow each other frame by frame, so both ends in one track mean a window without a gap.
    row = row[(recording.track[row - PAST] == recording.track[row + FUTURE]) & (recording.frame[row] % stride == 0)]
    heading = recording.heading[row]

    def seen_from_here(later: int) -> Floats:
        dx = recording.x[row + later] - recording.x[row]
        dy = recording.y[row + later] - recording.y[row]
        return np.stack(to_ego(dx, dy, heading), -1)

    return Windows(
        vector=_vectors(recording, row),
        type=recording.type[recording.track[row]].astype(np.int64),
        acceleration=recording.acceleration[row + 1],
        yaw_rate=recording.yaw_rate[row + 1],
        displacement=seen_from_here(1),
        destination=seen_from_here(FUTURE),
        track=recording.track[row].astype(np.int64),
        recording=np.full(len(row), index, np.int64),
    )


def _vectors(recording: Trajectories, row: NDArray[np.intp]) -> NDArray[np.float32]:
    """Feature vectors (len(row), 12) of rows of a recording, frame by frame."""
    vector = np.zeros((len(row), len(FEATURES)), np.float32)
    place = np.full(len(recording), -1)
    place[row] = np.arange(len(row))
    for frame in np.unique(recording.frame[row]):
        here = place[recording.rows_at(frame)]  # in the order of the frame's world
        wanted = np.flatnonzero(here >= 0)
        vector[here[wanted]] = features(recording.world(frame), wanted)
    return vector
