"""Collecting the tracks of a running simulation."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories, track_names
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL


class TrajectoryBuilder:
    """Collects the worlds of a running simulation, one per interval, as Trajectories.

    A road user that was absent for a frame, or that jumped, continues in a new track: `id`, `id#1`, …
    """

    def __init__(self, dt: float = DECISION_INTERVAL, source: str = "", licence: str = "") -> None:
        self.dt, self.source, self.licence = dt, source, licence
        self._t0: float | None = None
        self._last_frame = -1
        self._track_of: dict[str, int] = {}
        """Track of each road user of the last frame."""
        self._ids: list[str] = []
        self._type: list[int] = []
        self._length: list[float] = []
        self._width: list[float] = []
        self._frames: list[int] = []
        self._tracks: list[Integers] = []
        self._learned: list[bool] = []
        self._poses: list[Floats] = []
        self._modes: list[NDArray[np.int8]] = []

    def append(
        self, world: WorldState, new_track_ids: Collection[str] = (), modes: NDArray[np.integer] | None = None
    ) -> None:
        """Add the road users of one frame; those of `new_track_ids` go on in a new track.

        Type, size and `learned` of a track are those of its first row; `modes` are those of the first road users, None
        where there are none. Raises ValueError where the world is not later than the last one or lies between two
        frames.
        """
        if self._t0 is None:
            self._t0 = world.time
        frame = round((world.time - self._t0) / self.dt)
        if frame <= self._last_frame or abs(self._t0 + frame * self.dt - world.time) > 0.01 * self.dt:
            raise ValueError(
                f"a world at {world.time} s is not the next of a series from {self._t0} s each {self.dt} s"
            )
        before = self._track_of if frame == self._last_frame + 1 else {}
        tracks = [-1 if name in new_track_ids else before.get(name, -1) for name in world.ids]
        for row, name in enumerate(world.ids):
            if tracks[row] < 0:
                tracks[row] = len(self._ids)
                self._ids.append(name)
                self._type.append(int(world.type[row]))
                self._learned.append(bool(world.learned[row]))
                self._length.append(float(world.length[row]))
                self._width.append(float(world.width[row]))
        self._track_of = dict(zip(world.ids, tracks, strict=True))
        self._last_frame = frame
        self._frames.append(frame)
        self._tracks.append(np.array(tracks, np.int64))
        self._poses.append(np.stack([world.x, world.y, world.heading]))
        mode = np.full(len(world), -1, np.int8)
        if modes is not None:
            mode[: len(modes)] = modes
        self._modes.append(mode)

    def build(self) -> Trajectories:
        """The tracks collected so far."""
        track = np.concatenate([np.zeros(0, np.int64), *self._tracks])
        poses = np.concatenate([np.zeros((3, 0)), *self._poses], axis=1)
        frame = np.repeat(np.array(self._frames, np.int64), [len(t) for t in self._tracks])
        order = np.argsort(track, kind="stable")  # frames came in order
        x, y, heading = poses[:, order]
        mode = np.concatenate([np.zeros(0, np.int8), *self._modes])[order]
        return Trajectories(
            track=track[order],
            frame=frame[order],
            x=x,
            y=y,
            heading=heading,
            ids=track_names(self._ids),
            type=np.array(self._type, np.int8),
            length=np.array(self._length, np.float64),
            width=np.array(self._width, np.float64),
            dt=self.dt,
            t0=0.0 if self._t0 is None else self._t0,
            source=self.source,
            licence=self.licence,
            learned=np.array(self._learned, np.bool_),
            mode=mode,
        )
