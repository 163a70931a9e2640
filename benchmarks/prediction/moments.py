"""Moments of recorded road users with 2 s before and 6.4 s after them: what the baselines learn from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.learning.supervised.windows import reversing
from slrl_sumo.scene.geometry import Floats, to_ego
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.prediction.rollout import STEPS

PAST = 5
"""Intervals before a moment: 2 s."""


@dataclass(frozen=True, eq=False)
class Moments:
    """N moments; ego frame: that of the moment."""

    type: NDArray[np.int8]
    """RoadUserType, (N,)."""
    speed: Floats
    """m/s, (N,)."""
    yaw_rate: Floats
    """rad/s, (N,)."""
    past: Floats
    """Positions before each of the last 5 intervals, the latest first, (N, 5, 2) m."""
    path: Floats
    """Positions after each of the next 16 intervals, (N, 16, 2) m."""

    def __len__(self) -> int:
        return len(self.type)

    @property
    def straight(self) -> Floats:
        """Positions at constant velocity, (N, 16, 2) m."""
        ahead = self.speed[:, None] * DECISION_INTERVAL * np.arange(1, STEPS + 1)
        return np.stack([ahead, np.zeros_like(ahead)], -1)

    def take(self, rows: NDArray[np.bool_]) -> "Moments":
        """The moments `rows`, a mask."""
        return Moments(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


def joined(parts: Sequence[Moments]) -> Moments:
    """The moments of all parts, one after the other."""
    names = Moments.__dataclass_fields__
    return Moments(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def mirrored(moments: Moments) -> Moments:
    """The moments and their mirror images, left and right exchanged."""
    flip = np.array([1.0, -1.0])
    other = Moments(moments.type, moments.speed, -moments.yaw_rate, moments.past * flip, moments.path * flip)
    return joined([moments, other])


def has_past(recording: Trajectories, rows: Integers) -> NDArray[np.bool_]:
    """Whether the 2 s before each of the `rows` are recorded, (len(rows),)."""
    before = recording.track[np.maximum(rows - PAST, 0)]
    return np.asarray((rows >= PAST) & (before == recording.track[rows]))


def usable_rows(recording: Trajectories) -> Integers:
    """All rows that a moment can be made of, of road users that are not parked and do not reverse."""
    rows = np.arange(PAST, max(len(recording) - STEPS, PAST))
    whole = recording.track[rows - PAST] == recording.track[rows + STEPS]
    backwards = np.cumsum(reversing(recording))
    forwards = backwards[rows - PAST] == backwards[rows + STEPS]
    return np.asarray(rows[whole & forwards & ~recording.parked[recording.track[rows]]])


def moments_at(recording: Trajectories, rows: Integers) -> Moments:
    """The moments of these rows of a recording."""
    return Moments(
        type=recording.type[recording.track[rows]],
        speed=recording.speed[rows],
        yaw_rate=recording.yaw_rate[rows],
        past=_places(recording, rows, -np.arange(1, PAST + 1)),
        path=_places(recording, rows, np.arange(1, STEPS + 1)),
    )


def _places(recording: Trajectories, rows: Integers, offsets: Integers) -> Floats:
    there, here = rows[:, None] + offsets, rows[:, None]
    dx, dy = recording.x[there] - recording.x[here], recording.y[there] - recording.y[here]
    return np.stack(to_ego(dx, dy, recording.heading[here]), -1)
