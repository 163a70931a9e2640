"""Conflicts of vehicles with road users on their paths: swept boxes against predicted boxes."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.swept_boxes import Sweep
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Box, Floats, cos_sin
from slrl_sumo.scene.kernels import apart, overlap
from slrl_sumo.scene.levels import FLAT, Levels

SMALLEST_BOX = 0.1
"""Least size (m) of a box with a negative margin."""
LEADER_COSINE = 0.5
"""Least cosine of the angle between the directions of a vehicle and its leader; below it, a road user crosses the
path."""


def approaching(
    path_x: Floats,
    path_y: Floats,
    size: Floats,
    vehicle: NDArray[np.intp],
    boxes: Floats,
    agent: NDArray[np.intp],
    margin: float,
) -> NDArray[np.bool_]:
    """Whether each path comes within `margin` (m) of the circles around all boxes of a road user, for p pairs."""
    vehicle, agent = np.ascontiguousarray(vehicle), np.ascontiguousarray(agent)
    return _approaching(np.stack([path_x, path_y]), size, vehicle, boxes, agent, margin)


@compiled
def _approaching(
    paths: Floats, size: Floats, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp], margin: float
) -> NDArray[np.bool_]:
    """See `approaching`; `paths`: (2, n, k)."""
    stride = 4
    near = np.zeros(len(vehicle), np.bool_)
    for p in range(len(vehicle)):
        v, box = vehicle[p], boxes[agent[p]]
        x, y = 0.5 * (box[0, 0] + box[-1, 0]), 0.5 * (box[0, 1] + box[-1, 1])
        radius = 0.0
        for m in range(len(box)):
            radius = max(radius, math.hypot(box[m, 0] - x, box[m, 1] - y))
        radius += 0.5 * math.hypot(box[0, 3], box[0, 4])
        # Distance from the path to the farthest corner: behind the vehicle, or ahead on the other side of the lane.
        reach = radius + size[v, 0] + size[v, 1] + stride * SPACING + margin
        for j in range(0, paths.shape[2], stride):
            dx, dy = paths[0, v, j] - x, paths[1, v, j] - y
            if dx * dx + dy * dy < reach * reach:
                near[p] = True
                break
    return near


def conflicts(
    ahead: Sweep,
    vehicle: NDArray[np.intp],
    boxes: Floats,
    agent: NDArray[np.intp],
    count: NDArray[np.intp],
    margin: Floats,
    levels: Levels = FLAT,
) -> tuple[Floats, Floats]:
    """Distances (m) driven at the first and last touch of vehicles with road users, (p, q) each; inf and -inf: never.

    For p pairs of `vehicle` (index into `ahead`) and `agent` (index into `boxes`, (n, q, 5), at q moments, of which the
    first `count` (n,) are predicted). Road users are larger by `margin` (m, (p,)) on every side. A road user that the
    vehicle is passing, or that drives into its side or rear, is no reason to stop, unless the vehicle would turn into
    it. Nor is a road user on another of the `levels`.
    """
    vehicle, agent = np.ascontiguousarray(vehicle), np.ascontiguousarray(agent)
    return _conflicts(ahead, vehicle, boxes, agent, count, margin, levels)


@compiled
def _conflicts(
    ahead: Sweep,
    vehicle: NDArray[np.intp],
    boxes: Floats,
    agent: NDArray[np.intp],
    count: NDArray[np.intp],
    margin: Floats,
    levels: Levels,
) -> tuple[Floats, Floats]:
    """See `conflicts`."""
    enter = np.full((len(vehicle), boxes.shape[1]), np.inf)
    leave = -enter
    for p in range(len(vehicle)):
        v, a = vehicle[p], agent[p]
        x_ahead, y_ahead, headings, widths = ahead.x[v], ahead.y[v], ahead.heading[v], ahead.width[v]
        length = ahead.length[v]
        widest = 0.0
        for width in widths:
            widest = max(widest, width)
        their_length, their_width = boxes[a, 0, 3], boxes[a, 0, 4]
        close = 0.5 * (math.hypot(length, widest) + math.hypot(their_length, their_width)) + 1.5 * max(margin[p], 0.0)
        towards_x, towards_y = math.cos(headings[0]), math.sin(headings[0])
        for m in range(count[a]):
            x, y = boxes[a, m, 0], boxes[a, m, 1]
            before = (x - x_ahead[0]) * towards_x + (y - y_ahead[0]) * towards_y > 0.5 * length
            aside = False
            for j in range(len(x_ahead)):
                dx, dy = x - x_ahead[j], y - y_ahead[j]
                # Circles are compared before boxes.
                if not ahead.valid[v, j] or dx * dx + dy * dy >= close * close:
                    continue
                # A road user already beside the vehicle counts without the margin.
                more = 2.0 * margin[p] if before else 0.0
                mine = Box(math.cos(headings[j]), math.sin(headings[j]), length, widths[j])
                theirs = boxes[a, m, 2]
                size = max(their_length + more, SMALLEST_BOX), max(their_width + more, SMALLEST_BOX)
                c, s = math.cos(theirs), math.sin(theirs)
                if not overlap(dx, dy, mine, Box(c, s, size[0], size[1])):
                    continue
                if apart(levels, x_ahead[j], y_ahead[j], mine.cos, mine.sin, x, y, c, s):
                    continue
                if j == 0 and not before:
                    aside = True
                    break
                enter[p, m] = min(enter[p, m], j * SPACING)
                leave[p, m] = j * SPACING
            if aside:
                enter[p, m], leave[p, m] = np.inf, -np.inf
                # The road user has run into the vehicle: its later moments do not happen.
                break
    return enter, leave


def touched(enter: Floats) -> NDArray[np.intp]:
    """Index of the place ahead at which a vehicle first touches a road user, (p, q); 0 without a touch.

    `enter`: see `conflicts`.
    """
    return np.where(np.isfinite(enter), enter / SPACING, 0.0).astype(np.intp)


def cosine_at_touch(
    ahead: Sweep, vehicle: NDArray[np.intp], place: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp]
) -> Floats:
    """Cosine of the angle between the directions of vehicles and road users at a `place` ahead, (p, q)."""
    return cos_sin(boxes[agent, :, 2] - ahead.heading[vehicle[:, None], place])[0]


def speed_along(cosine: Floats, speed: Floats) -> Floats:
    """Speed (m/s) of road users in the direction of vehicles, (p, q); 0 for crossing road users.

    `cosine`: see `cosine_at_touch`, (p, q). `speed`: m/s, (p,).
    """
    return np.where(cosine > LEADER_COSINE, speed[:, None] * cosine, 0.0)
