"""Conflicts of vehicles with road users on their paths: swept boxes against predicted boxes."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.swept_boxes import Sweep
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Box, Floats, cos_sin
from slrl_sumo.scene.kernels import moved, overlap
from slrl_sumo.scene.state import WorldState

MARGIN = 0.3
"""m kept free on either side of a vehicle."""
SHARPEST_TURN = 1.0
"""rad/s; faster turns are expected to slow down to this."""


def predicted(learned: WorldState, moments: Floats) -> Floats:
    """Boxes of n road users that keep speed and yaw rate: (n, q, 5) rows as in `boxes_overlap`, at `moments` (q,) in s.

    Constant turn rate and velocity, the yaw rate limited to `SHARPEST_TURN`.
    """
    now = np.stack([learned.x, learned.y, learned.heading, learned.length, learned.width])
    return _predicted(now, learned.speed, learned.yaw_rate, moments)


@compiled
def _predicted(now: Floats, speed: Floats, yaw_rate: Floats, moments: Floats) -> Floats:
    """See `predicted`; `now`: (5, n)."""
    boxes = np.empty((now.shape[1], len(moments), 5))
    for i in range(len(boxes)):
        rate = min(max(yaw_rate[i], -SHARPEST_TURN), SHARPEST_TURN)
        for m, seconds in enumerate(moments):
            half, chord = 0.5 * rate * seconds, speed[i] * seconds
            if half != 0.0:
                chord *= math.sin(half) / half
            boxes[i, m, 0], boxes[i, m, 1], boxes[i, m, 2] = moved(now[0, i], now[1, i], now[2, i], chord, 2.0 * half)
            boxes[i, m, 3], boxes[i, m, 4] = now[3, i], now[4, i]
    return boxes


def approaching(
    path_x: Floats, path_y: Floats, size: Floats, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Whether the path comes near the road user, by circles around all its boxes, for each of p pairs."""
    vehicle, agent = np.ascontiguousarray(vehicle), np.ascontiguousarray(agent)
    return _approaching(np.stack([path_x, path_y]), size, vehicle, boxes, agent)


@compiled
def _approaching(
    paths: Floats, size: Floats, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp]
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
        # From the path to the farthest corner: behind the vehicle, or ahead on the other side of the lane.
        reach = radius + size[v, 0] + size[v, 1] + stride * SPACING + MARGIN
        for j in range(0, paths.shape[2], stride):
            dx, dy = paths[0, v, j] - x, paths[1, v, j] - y
            if dx * dx + dy * dy < reach * reach:
                near[p] = True
                break
    return near


def conflicts(
    ahead: Sweep, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp], moving: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Where vehicles would touch road users: m driven at first and last touch, (p, q); inf and -inf: never.

    For p pairs of `vehicle` (index into `ahead`) and `agent` (index into `boxes`, (n, q, 5), at q moments). Road users
    that are not `moving` (n,) count at their first moment only. Vehicles keep `MARGIN` on either side from road users
    ahead of their front now; one that they are passing is no reason to stop, unless they would cut into it.
    """
    vehicle, agent = np.ascontiguousarray(vehicle), np.ascontiguousarray(agent)
    return _conflicts(ahead, vehicle, boxes, agent, moving)


@compiled
def _conflicts(
    ahead: Sweep, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp], moving: NDArray[np.bool_]
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
        close = 0.5 * (math.hypot(length, widest + 2.0 * MARGIN) + math.hypot(their_length, their_width))
        towards_x, towards_y = math.cos(headings[0]), math.sin(headings[0])
        for m in range(boxes.shape[1] if moving[a] else 1):
            x, y = boxes[a, m, 0], boxes[a, m, 1]
            before = (x - x_ahead[0]) * towards_x + (y - y_ahead[0]) * towards_y > 0.5 * length
            # With a margin around predictions, vehicles would brake that can pass just in time.
            room = 2.0 * MARGIN if before and m == 0 else 0.0
            for j in range(len(x_ahead)):
                dx, dy = x - x_ahead[j], y - y_ahead[j]
                # Circles first, then boxes.
                if not ahead.valid[v, j] or dx * dx + dy * dy >= close * close:
                    continue
                ours, theirs = headings[j], boxes[a, m, 2]
                width = widths[j] + room
                mine = Box(math.cos(ours), math.sin(ours), length, width)
                if not overlap(dx, dy, mine, Box(math.cos(theirs), math.sin(theirs), their_length, their_width)):
                    continue
                if j == 0 and not before:
                    enter[p, m], leave[p, m] = np.inf, -np.inf
                    break
                enter[p, m] = min(enter[p, m], j * SPACING)
                leave[p, m] = j * SPACING
    return enter, leave


def speed_along(
    ahead: Sweep, vehicle: NDArray[np.intp], enter: Floats, boxes: Floats, agent: NDArray[np.intp], speed: Floats
) -> Floats:
    """Speed of the road users in the direction of the vehicles at the touch, at least 0, (p, q) in m/s."""
    place = np.where(np.isfinite(enter), enter / SPACING, 0.0).astype(np.intp)
    turn = boxes[agent, :, 2] - ahead.heading[vehicle[:, None], place]
    return np.maximum(speed[agent, None] * cos_sin(turn)[0], 0.0)
