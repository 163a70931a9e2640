"""Windows of recorded trajectories: observation, next motion and path over the following 4.8 s."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.jobs.progress import bar_console
from slrl_sumo.perception.features import FEATURES, STATES, state
from slrl_sumo.perception.past_motion import recorded_past
from slrl_sumo.scene.geometry import Floats, to_ego
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

PAST = 2
"""Number of recorded intervals needed before a window: a speed needs one, an acceleration two."""

FUTURE = 12
"""Number of intervals from a window to its destination: 4.8 s (paper, section 3.2)."""

OWN_SPEED = 0.75
"""Share of the constant-velocity displacement that is subtracted in relative destinations. With 1, modes describe only
changes. With 0, they are the modes of the paper, of which half of the 20 modes of pedestrians belong to speeds that a
given pedestrian does not have. Of 0, 0.5, 0.75 and 1, this value predicted held-out recordings of HC and SDD best
(docs/measurements/archive/prediction.md)."""

BACKWARDS = 0.3
"""Speed (m/s) against its heading above which a car reverses."""


@dataclass(frozen=True, eq=False)
class Windows:
    """N moments of recorded road users, as parallel arrays, in the ego frame of each moment."""

    vector: NDArray[np.float32]
    """Features at the moment, (N, columns of the preset)."""
    type: NDArray[np.int64]
    """RoadUserType, (N,)."""
    acceleration: Floats
    """m/s² during the next interval, (N,)."""
    yaw_rate: Floats
    """rad/s during the next interval, (N,)."""
    path: Floats
    """Positions after each of the next 12 intervals or more, (N, intervals, 2) m, ego frame."""
    track: NDArray[np.int64]
    """Index of the track in its recording, (N,)."""
    recording: NDArray[np.int64]
    """Index of the recording, (N,)."""
    frame: NDArray[np.int64]
    """Frame of the moment in its recording, (N,)."""

    def __len__(self) -> int:
        return len(self.type)

    @property
    def displacement(self) -> Floats:
        """Position after the next interval, (N, 2) m, ego frame."""
        return self.path[:, 0]

    @property
    def destination(self) -> Floats:
        """Position after 12 intervals, (N, 2) m, ego frame."""
        return self.path[:, FUTURE - 1]

    @property
    def relative(self) -> Floats:
        """Destination less OWN_SPEED of the displacement at constant velocity, (N, 2) m, ego frame."""
        ahead = OWN_SPEED * FUTURE * DECISION_INTERVAL * self.vector[:, FEATURES.index("speed")].astype(np.float64)
        return self.destination - np.stack([ahead, np.zeros(len(self))], -1)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "Windows":
        """The windows `rows` (a mask or indices)."""
        return Windows(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


def windows(
    recordings: Sequence[Trajectories], stride: int = 1, preset: str = "paper", future: int = FUTURE
) -> Windows:
    """All windows of the recordings: each row with 2 rows before it and `future` after it in its track.

    `preset`: preset of the vector (see features.STATES).

    With `stride` > 1, only every stride-th frame number is used. There are no windows of parked road users, and of cars
    that reverse in the intervals before or in the next interval: the models drive forwards only and would learn to
    accelerate. A car that stands and reverses later has windows, because standing is the nearest motion of the models.
    Features are computed by the code of live simulation, with all recorded road users of the frame as neighbours,
    including parked and reversing road users."""
    console = bar_console()
    numbered = track(
        enumerate(recordings),
        "windows",
        total=len(recordings),
        console=console,
        transient=True,
        disable=console.quiet,
    )
    return joined([_of_one(recording, index, stride, preset, future) for index, recording in numbered])


def joined(parts: Sequence[Windows]) -> Windows:
    """Concatenate the windows of all parts."""
    names = Windows.__dataclass_fields__
    return Windows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def mirrored(windows: Windows) -> Windows:
    """The mirror images of the windows, left and right exchanged."""
    vector = windows.vector.copy()
    names = STATES["history"][: vector.shape[1]]
    to_the_left = [name == "heading" or name.startswith("yaw_rate") or "_left" in name for name in names]
    vector[:, to_the_left] *= -1
    return replace(windows, vector=vector, yaw_rate=-windows.yaw_rate, path=windows.path * np.array([1.0, -1.0]))


def reversing(recording: Trajectories) -> NDArray[np.bool_]:
    """Whether the row's car moved backwards in the last interval, (R,). Steps below BACKWARDS are noise."""
    dx, dy = np.diff(recording.x, prepend=0.0), np.diff(recording.y, prepend=0.0)
    ahead = dx * np.cos(recording.heading) + dy * np.sin(recording.heading)
    back = (ahead < 0.0) & (np.hypot(dx, dy) > BACKWARDS * recording.dt)
    back[recording.starts[:-1]] = False
    return np.asarray(back & (recording.type[recording.track] == RoadUserType.CAR))


def _of_one(recording: Trajectories, index: int, stride: int, preset: str, future: int) -> Windows:
    row = np.arange(PAST, max(len(recording.frame) - future, PAST))
    # Rows of a track are consecutive frames, so a window with both ends in one track has no gap.
    whole = recording.track[row - PAST] == recording.track[row + future]
    backwards = np.cumsum(reversing(recording))
    forwards = backwards[row - PAST] == backwards[row + 1]
    row = row[whole & forwards & (recording.frame[row] % stride == 0) & ~recording.parked[recording.track[row]]]
    heading = recording.heading[row, None]
    later = row[:, None] + np.arange(1, future + 1)
    dx = recording.x[later] - recording.x[row, None]
    dy = recording.y[later] - recording.y[row, None]
    return Windows(
        vector=_vectors(recording, row, preset),
        type=recording.type[recording.track[row]].astype(np.int64),
        acceleration=recording.acceleration[row + 1],
        yaw_rate=recording.yaw_rate[row + 1],
        path=np.stack(to_ego(dx, dy, heading), -1),
        track=recording.track[row].astype(np.int64),
        recording=np.full(len(row), index, np.int64),
        frame=recording.frame[row].astype(np.int64),
    )


def _vectors(recording: Trajectories, row: NDArray[np.intp], preset: str) -> NDArray[np.float32]:
    """Feature vectors (len(row), columns) of rows of a recording, frame by frame."""
    vector = np.zeros((len(row), len(STATES[preset])), np.float32)
    place = np.full(len(recording), -1)
    place[row] = np.arange(len(row))
    for frame in np.unique(recording.frame[row]):
        rows = recording.rows_at(frame)  # in the order of the frame's world
        here = place[rows]
        wanted = np.flatnonzero(here >= 0)
        past = None if preset == "paper" else recorded_past(recording, rows)
        vector[here[wanted]] = state(recording.world(frame), wanted, None, past, preset)
    return vector
