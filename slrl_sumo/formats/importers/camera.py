"""Detection of camera motion: cars, including parked ones, that all slide in one direction at once."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats

SPAN = 1.0
"""s of the time windows in which motion is compared; they overlap by half."""

FEWEST_CARS = 5
"""Least number of cars for a decision."""

SLIDE = 0.3
"""m that 80 % of them must have moved in a window …"""

ONE_WAY = 0.8
"""… with their displacements adding up to this share of the distances covered."""

SETTLED = 3.0
"""s that a camera must be still between two moves, and at the end, for the time to count."""


def camera_moves(car: Integers, frame: Integers, x: Floats, y: Floats, rate: float) -> NDArray[np.int64]:
    """Spans of frames (S, 2), first and last included, in which the camera rather than the cars moved.

    Rows (N,) are those of cars: index, frame (`rate` per s) and position in m. At least 5 cars of which nearly all
    move, and all in one direction, count as camera motion: cars in SDD are parked or come one by one. A column of
    moving cars without standing or oncoming road users looks the same and is dropped as well.
    """
    span = round(SPAN * rate)
    spans = []
    for first in range(int(frame.min(initial=0)), int(frame.max(initial=0)) - span + 1, span // 2):
        now, then = frame == first, frame == first + span
        _, a, b = np.intersect1d(car[now], car[then], assume_unique=True, return_indices=True)
        if len(a) < FEWEST_CARS:
            continue
        dx, dy = x[then][b] - x[now][a], y[then][b] - y[now][a]
        length = np.hypot(dx, dy)
        if np.mean(length > SLIDE) >= 0.8 and np.hypot(dx.sum(), dy.sum()) >= ONE_WAY * length.sum():
            spans.append((first, first + span))
    settle = round(SETTLED * rate)
    joined: list[tuple[int, int]] = []
    for start, end in [*spans, (int(frame.max(initial=0)),) * 2] if spans else []:
        if joined and start - joined[-1][1] < settle:
            joined[-1] = joined[-1][0], end
        elif start < end:
            joined.append((start, end))
    return np.array(joined, np.int64).reshape(-1, 2)
