"""Levels of streets that cross without a junction: road users on different levels do not collide, although their boxes
overlap."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats

LANE_REACH = 3.0
"""Distance (m) from a point of a lane within which a road user is on the lane: half a lane, and half the spacing of the
points."""
ALIGNED = 0.5
"""Sine of the angle between a lane and a road user on it, in either direction, above which its level is unknown."""


class Levels(NamedTuple):
    """p points along the lanes of streets that cross without a junction, near these crossings, from west to east."""

    x: Floats
    """m, (p,)."""
    y: Floats
    cos: Floats
    """Of the direction of the lane."""
    sin: Floats
    level: NDArray[np.int8]
    """Number from 1 on that differs from the numbers of all streets that the street crosses; not a height."""


FLAT = Levels(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))
"""Levels of a network in which no streets cross on different levels."""


def apart(
    levels: Levels, x: float, y: float, cos: float, sin: float, to_x: float, to_y: float, to_cos: float, to_sin: float
) -> bool:
    """Whether two places are on different levels.

    Each place has a position (m) and the cosine and sine of the direction of the road user there, because two crossing
    streets share a position. A place has the level of the lane within LANE_REACH whose direction fits best; no level if
    no lane fits.
    """
    mine = 0
    for place in range(2):
        if place == 1:
            x, y, cos, sin = to_x, to_y, to_cos, to_sin
        low, high = 0, len(levels.x)
        while low < high:
            middle = (low + high) // 2
            if levels.x[middle] < x - LANE_REACH:
                low = middle + 1
            else:
                high = middle
        best, level = ALIGNED, 0
        while low < len(levels.x) and levels.x[low] <= x + LANE_REACH:
            dx, dy = levels.x[low] - x, levels.y[low] - y
            turned = abs(cos * levels.sin[low] - sin * levels.cos[low])
            if turned < best and dx * dx + dy * dy < LANE_REACH * LANE_REACH:
                best, level = turned, int(levels.level[low])
            low += 1
        if level == 0:
            return False
        if place == 1:
            return level != mine
        mine = level
    return False


def together(levels: Levels, places: Floats, others: Floats) -> NDArray[np.bool_]:
    """Whether each of k pairs of places is not on different levels, (k,).

    `places`, `others`: (k, 3), x, y (m) and heading (rad).
    """
    there = [
        np.column_stack([x_y, np.cos(heading), np.sin(heading)]).tolist()
        for x_y, heading in ((each[:, :2], each[:, 2]) for each in (places, others))
    ]
    return np.array([not apart(levels, *a, *b) for a, b in zip(*there, strict=True)], np.bool_)
