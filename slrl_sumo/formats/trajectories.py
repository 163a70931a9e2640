"""Tracks of road users over time."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import replacing
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, MAX_POSITION, TYPE_NAMES

Integers = NDArray[np.int64]

FILE_KIND = "slrl_sumo trajectories"
FILE_VERSION = 2
"""Version 1 had no `parked`."""

MAX_FRAME = 10_000_000
"""Highest number of a frame, also below 0: 46 days of 0.4 s. Some figures need memory for every frame."""
MAX_SIZE = 1000.0
"""Greatest length of a box, m."""


@dataclass(frozen=True, eq=False)
class Trajectories:
    """T tracks in R rows, sorted by track, then frame; a track has a row in every frame from its first to its last.

    Frame: metres, x east, y north; headings in radians counter-clockwise from +x. Positions are centres of boxes.
    Arrays are not copied and must not be written to. Raises ValueError if the table breaks these rules.
    """

    track: Integers
    """Index of the row's track, (R,), 0 to T - 1; every track has a row."""
    frame: Integers
    """Number of intervals since `t0`, (R,)."""
    x: Floats
    y: Floats
    heading: Floats
    ids: tuple[str, ...]
    """One unique name per track, (T,)."""
    type: NDArray[np.int8]
    """RoadUserType per track, (T,)."""
    length: Floats
    """Box length in m per track, (T,)."""
    width: Floats
    """Box width in m per track, (T,)."""
    dt: float = DECISION_INTERVAL
    """Length of an interval in s."""
    t0: float = 0.0
    """Time of frame 0 in s."""
    source: str = ""
    """Source of the tracks."""
    licence: str = ""
    """Terms of use."""
    parked: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Whether the road user is parked, per track, (T,): others perceive it, models do not learn from it.
    Default: none."""
    learned: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Whether learned models moved the road user when the track began, per track, (T,). Default: none."""
    mode: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    """Mode that led to each row, (R,); -1 without a mode. Default: none."""
    notes: tuple[str, ...] = ()
    """Corrections and omissions of the importer, with counts."""

    def __post_init__(self) -> None:
        rows, tracks = len(self.track), len(self.ids)
        for name, default in (("parked", np.zeros(tracks, np.bool_)), ("learned", np.zeros(tracks, np.bool_))):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, default)
        if not len(self.mode):
            object.__setattr__(self, "mode", np.full(rows, -1, np.int8))
        for name in ("frame", "x", "y", "heading", "mode"):
            if getattr(self, name).shape != (rows,):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, track has {(rows,)}")
        for name in ("type", "length", "width", "parked", "learned"):
            if getattr(self, name).shape != (tracks,):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, but there are {tracks} ids")
        if len(set(self.ids)) != tracks:
            raise ValueError("ids of tracks are not unique")
        if not 0.001 <= self.dt <= 3600.0:
            raise ValueError(f"dt must lie between 0.001 and 3600 s, it is {self.dt}")
        if not abs(self.t0) < 1e12:  # also where it is NaN
            raise ValueError(f"t0 must be a time in s, it is {self.t0}")
        for name, least, most in (
            *(("x", -MAX_POSITION, MAX_POSITION), ("y", -MAX_POSITION, MAX_POSITION), ("heading", -1e4, 1e4)),
            *(("length", 0.0, MAX_SIZE), ("width", 0.0, MAX_SIZE), ("type", 0, len(TYPE_NAMES) - 1)),
            *(("mode", -1, 127), ("frame", -MAX_FRAME, MAX_FRAME)),
        ):
            values = getattr(self, name)
            if not np.isfinite(values).all():
                raise ValueError(f"{name} holds values that are not finite")
            if len(values) and not (least <= values.min() and values.max() <= most):
                odd = values.min() if values.min() < least else values.max()
                raise ValueError(f"{name} holds {odd:g}; possible are {least:g} to {most:g}")
        step = np.diff(self.track, prepend=-1, append=tracks)
        if step[0] != 1 or step[-1] != 1 or not np.isin(step, (0, 1)).all():
            raise ValueError("rows are not sorted by track, or a track has no row")
        gap = (np.diff(self.track) == 0) & (np.diff(self.frame) != 1)
        if gap.any():
            row = int(np.flatnonzero(gap)[0])
            raise ValueError(
                f"track {self.ids[self.track[row]]!r} goes from frame {self.frame[row]} to {self.frame[row + 1]}: "
                "frames of a track must follow each other; split the track at the gap"
            )

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.track)

    @cached_property
    def starts(self) -> Integers:
        """First row of each track, and R at the end, (T + 1,)."""
        return np.searchsorted(self.track, np.arange(len(self.ids) + 1)).astype(np.int64)

    @cached_property
    def speed(self) -> Floats:
        """m/s per row, (R,): distance covered in the last interval over dt.

        The first row of a track has no last interval and takes the speed of the second; a track of one row has 0.
        """
        speed = np.hypot(self._change(self.x), self._change(self.y)) / self.dt
        first = self.starts[:-1][np.diff(self.starts) > 1]
        speed[first] = speed[first + 1]
        return speed

    @cached_property
    def acceleration(self) -> Floats:
        """m/s² per row, (R,): change of speed over the last interval over dt; 0 at the first two rows of a track."""
        return self._change(self.speed) / self.dt

    @cached_property
    def yaw_rate(self) -> Floats:
        """rad/s per row, (R,): change of heading over the last interval over dt; 0 at the first row of a track."""
        turn = wrap_angle(self._change(self.heading))
        return turn / self.dt

    def _change(self, values: Floats) -> Floats:
        """Backward differences within tracks, 0 at the first row of each."""
        change = np.diff(values, prepend=0.0)
        change[self.starts[:-1]] = 0.0
        return change

    @property
    def frames(self) -> range:
        """All frames from the first to the last with a road user."""
        return range(int(self.frame.min()), int(self.frame.max()) + 1) if len(self) else range(0)

    @cached_property
    def _by_frame(self) -> tuple[NDArray[np.intp], Integers]:
        order = np.argsort(self.frame, kind="stable")
        return order, self.frame[order]

    def rows_at(self, frame: int) -> NDArray[np.intp]:
        """The rows of a frame, in the order of their tracks."""
        order, frames = self._by_frame
        first, end = np.searchsorted(frames, (frame, frame + 1))
        return order[first:end]

    def world(self, frame: int) -> WorldState:
        """The road users of a frame (none outside `frames`), in the order of their tracks."""
        rows = self.rows_at(frame)
        tracks = self.track[rows]
        return WorldState(
            time=self.t0 + frame * self.dt,
            ids=tuple([self.ids[i] for i in tracks.tolist()]),
            type=self.type[tracks],
            x=self.x[rows],
            y=self.y[rows],
            heading=self.heading[rows],
            speed=self.speed[rows],
            acceleration=self.acceleration[rows],
            yaw_rate=self.yaw_rate[rows],
            length=self.length[tracks],
            width=self.width[tracks],
            learned=self.learned[tracks],
        )

    def to_pandas(self) -> Any:
        """The rows as a pandas DataFrame, in their order, with units in the names of the columns.

        time_s, id (of the track), type, learned, mode (missing where none was chosen), x_m, y_m, heading_rad,
        speed_mps, acceleration_mps2, yaw_rate_radps, length_m, width_m. Raises InputError where pandas is missing.
        """
        require("pandas", "to_pandas")
        import pandas as pd

        return pd.DataFrame(
            {
                "time_s": self.t0 + self.dt * self.frame,
                "id": pd.Categorical.from_codes(self.track, list(self.ids)),
                "type": pd.Categorical.from_codes(self.type[self.track], list(TYPE_NAMES)),
                "learned": self.learned[self.track],
                "mode": pd.arrays.IntegerArray(self.mode, self.mode < 0),
                "x_m": self.x,
                "y_m": self.y,
                "heading_rad": self.heading,
                "speed_mps": self.speed,
                "acceleration_mps2": self.acceleration,
                "yaw_rate_radps": self.yaw_rate,
                "length_m": self.length[self.track],
                "width_m": self.width[self.track],
            }
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an .npz file that `load_trajectories` reads; an existing file is replaced atomically."""
        with replacing(Path(path)) as part, open(part, "wb") as file:
            np.savez_compressed(
                file,
                kind=np.array(FILE_KIND),
                version=np.array(FILE_VERSION),
                ids=np.array(self.ids, np.str_),
                dt=np.array(self.dt),
                t0=np.array(self.t0),
                source=np.array(self.source),
                licence=np.array(self.licence),
                notes=np.array(self.notes, np.str_),
                **{name: getattr(self, name) for name in DTYPES},
            )


DTYPES: dict[str, type[np.generic]] = {
    "track": np.int64,
    "frame": np.int64,
    "x": np.float64,
    "y": np.float64,
    "heading": np.float64,
    "type": np.int8,
    "length": np.float64,
    "width": np.float64,
    "parked": np.bool_,
    "learned": np.bool_,
    "mode": np.int8,
}
OPTIONAL = ("parked", "learned", "mode")
"""Files of older versions lack them."""


def track_names(ids: Iterable[str]) -> tuple[str, ...]:
    """Unique names for tracks from the ids of their road users: `id` for the first track, then `id#1`, `id#2`, …"""
    ids = list(ids)
    taken: set[str] = set(ids)
    seen: dict[str, int] = {}
    names = []
    for name in ids:
        count = seen.get(name)
        if count is None:
            seen[name] = 0
            names.append(name)
            continue
        while True:  # `id#1` may be the id of another road user
            count += 1
            new = f"{name}#{count}"
            if new not in taken:
                break
        seen[name] = count
        taken.add(new)
        names.append(new)
    return tuple(names)


def road_users(names: Sequence[str]) -> tuple[str, ...]:
    """The id of the road user of each track: the reverse of `track_names`. `a#1` without a track `a` is an id."""
    known = set(names)
    parts = [name.rpartition("#") for name in names]
    return tuple(
        [
            user if number.isdecimal() and user in known else name
            for name, (user, _, number) in zip(names, parts, strict=True)
        ]
    )
