"""Swept boxes: the boxes that vehicles will cover on their paths."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats

STRAIGHTENING = 15.0
"""Greatest distance (m) within which a vehicle beside the centre line of its lane is expected to return to it."""


class Sweep(NamedTuple):
    """Boxes of n vehicles at k places ahead, `SPACING` m apart, beginning at the present position; arrays (n, k)."""

    x: Floats
    y: Floats
    heading: Floats
    width: Floats
    """Width (m) of the box, larger than the width of the vehicle if its lateral offset is uncertain."""
    length: Floats
    """Length (m) of the vehicle, (n,)."""
    valid: NDArray[np.bool_]
    """False beyond the end of a path."""


def sweep(
    path_x: Floats, path_y: Floats, room: Floats, front_x: Floats, front_y: Floats, heading: Floats, size: Floats
) -> Sweep:
    """The boxes that vehicles sweep on their paths.

    `path_x`, `path_y`: points ahead, (n, k), the first beside the front. `room`: m to the path's end, (n,).
    `front_x`, `front_y`, `heading`: present middle of the front edge and direction, (n,). `size`: length and width,
    (n, 2). Fronts follow the path, rears follow the fronts: long vehicles cut corners, as SUMO draws them.
    """
    boxes, valid = _swept(np.stack([path_x, path_y]), room, np.stack([front_x, front_y, heading]), size)
    return Sweep(boxes[0], boxes[1], boxes[2], boxes[3], size[:, 0].copy(), valid)


@compiled
def _swept(paths: Floats, room: Floats, fronts: Floats, size: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """x, y, heading, width (4, n, k) and validity of boxes, for paths (2, n, k), and front x, y, heading (3, n)."""
    _, n, k = paths.shape
    boxes, valid = np.empty((4, n, k)), np.empty((n, k), np.bool_)
    along, front = np.empty((2, k)), np.empty((2, k))
    for i in range(n):
        front_x, front_y, length, width = fronts[0, i], fronts[1, i], size[i, 0], size[i, 1]
        towards_x, towards_y = math.cos(fronts[2, i]), math.sin(fronts[2, i])
        for j in range(k):
            # The direction is the difference of the two neighbouring points; at the ends, of the point and its
            # neighbour.
            after, before = min(j + 1, k - 1), max(j - 1, 0)
            dx, dy = paths[0, i, after] - paths[0, i, before], paths[1, i, after] - paths[1, i, before]
            norm = max(math.sqrt(dx * dx + dy * dy), 1e-9)
            along[0, j], along[1, j] = dx / norm, dy / norm
        # For a vehicle against the direction of its lane (overtaking on the opposite side, or a path of one point),
        # straight on is the better prediction.
        off_path = along[0, 0] * towards_x + along[1, 0] * towards_y < 0.5
        if off_path:
            along[0], along[1] = towards_x, towards_y
        first_x = front_x if off_path else paths[0, i, 0]
        first_y = front_y if off_path else paths[1, i, 0]
        beside = (front_y - first_y) * along[0, 0] - (front_x - first_x) * along[1, 0]
        behind = round(length / SPACING) if 0.0 <= length < k * SPACING else k
        for j in range(k):
            s = j * SPACING
            kept = max(1.0 - s / STRAIGHTENING, 0.0)
            # The box covers both a vehicle that keeps its lateral offset and a vehicle that returns to the centre line.
            lateral = beside * (1.0 + kept) / 2.0
            x = front_x + s * towards_x if off_path else paths[0, i, j]
            y = front_y + s * towards_y if off_path else paths[1, i, j]
            x, y = x - lateral * along[1, j], y + lateral * along[0, j]
            front[0, j], front[1, j] = x, y
            if j >= behind:
                rear_x, rear_y = front[0, j - behind], front[1, j - behind]
            else:
                still = max(length - s, 0.0)
                rear_x, rear_y = front_x - still * towards_x, front_y - still * towards_y
            turned = math.atan2(y - rear_y, x - rear_x)
            boxes[0, i, j] = x - 0.5 * length * math.cos(turned)
            boxes[1, i, j] = y - 0.5 * length * math.sin(turned)
            boxes[2, i, j] = turned
            boxes[3, i, j] = width + abs(beside) * (1.0 - kept)
            valid[i, j] = off_path or j == 0 or s <= room[i] + 1e-9
    return boxes, valid
