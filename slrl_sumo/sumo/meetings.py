"""Where vehicles would meet other road users on their ways: swept boxes against boxes, now and in the near future."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.paths import SPACING, Sweep
from slrl_sumo.world.geometry import Floats, boxes_overlap, cos_sin
from slrl_sumo.world.state import WorldState

MARGIN = 0.3
"""m kept free on either side of a vehicle."""
SHARPEST_TURN = 1.0
"""rad/s; faster turns are not expected to go on."""


def predicted(learned: WorldState, moments: Floats) -> Floats:
    """Boxes of n road users that keep speed and yaw rate: (n, q, 5) rows as in `boxes_overlap`, at `moments` (q,) in s.

    Constant turn rate and velocity, the yaw rate limited to `SHARPEST_TURN`.
    """
    turn = np.clip(learned.yaw_rate, -SHARPEST_TURN, SHARPEST_TURN)[:, None] * moments
    chord = learned.speed[:, None] * moments * np.sinc(turn / (2.0 * np.pi))
    towards_x, towards_y = cos_sin(learned.heading[:, None] + 0.5 * turn)
    boxes = np.empty((*turn.shape, 5))
    boxes[..., 0] = learned.x[:, None] + chord * towards_x
    boxes[..., 1] = learned.y[:, None] + chord * towards_y
    boxes[..., 2] = learned.heading[:, None] + turn
    boxes[..., 3] = learned.length[:, None]
    boxes[..., 4] = learned.width[:, None]
    return boxes


def approaching(
    path_x: Floats, path_y: Floats, size: Floats, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Whether the path comes near the road user at all, by circles round all its moments, for each of p pairs."""
    stride = 4
    middle = 0.5 * (boxes[:, 0, :2] + boxes[:, -1, :2])
    radius = np.hypot(boxes[..., 0] - middle[:, :1], boxes[..., 1] - middle[:, 1:]).max(axis=1)
    radius += 0.5 * np.hypot(boxes[:, 0, 3], boxes[:, 0, 4])
    # From the path to the farthest corner: behind, or ahead on the other side of the lane.
    reach = size[:, 0] + size[:, 1] + stride * SPACING + MARGIN
    dx = path_x[:, ::stride][vehicle] - middle[agent, :1]
    dy = path_y[:, ::stride][vehicle] - middle[agent, 1:]
    near: NDArray[np.bool_] = (dx * dx + dy * dy < (reach[vehicle] + radius[agent])[:, None] ** 2).any(axis=1)
    return near


def meetings(
    ahead: Sweep, vehicle: NDArray[np.intp], boxes: Floats, agent: NDArray[np.intp], moving: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Where vehicles would touch road users: m driven at first and at last touch, (p, q); inf and -inf: never.

    For p pairs of `vehicle` (index into `ahead`) and `agent` (index into `boxes`, (n, q, 5), at q moments). Those not
    `moving` (n,) get only their first moment. Vehicles keep `MARGIN` to either side of them from what lies ahead of
    their front now; whom they pass already is no reason to stop, unless they would cut into it.
    """
    p, q = len(vehicle), boxes.shape[1]
    enter, leave = np.full(p * q, np.inf), np.full(p * q, -np.inf)
    half_vehicle = 0.5 * np.hypot(ahead.length, ahead.width.max(axis=1) + 2.0 * MARGIN)
    close = (half_vehicle[vehicle] + 0.5 * np.hypot(boxes[agent, 0, 3], boxes[agent, 0, 4])) ** 2
    pair, moment = np.nonzero(moving[agent][:, None] | (np.arange(q) == 0))
    dx = ahead.x[vehicle[pair]] - boxes[agent[pair], moment, 0][:, None]
    dy = ahead.y[vehicle[pair]] - boxes[agent[pair], moment, 1][:, None]
    # Circles first, then boxes.
    row, place = np.nonzero((dx * dx + dy * dy < close[pair][:, None]) & ahead.valid[vehicle[pair]])
    pair, moment = pair[row], moment[row]
    v, theirs = vehicle[pair], boxes[agent[pair], moment]
    nose_x = theirs[:, 0] - ahead.x[v, 0]
    nose_y = theirs[:, 1] - ahead.y[v, 0]
    c, s = cos_sin(ahead.heading[v, 0])
    before = nose_x * c + nose_y * s > 0.5 * ahead.length[v]
    # A margin round predictions would make vehicles brake that are about to pass just in time.
    width = ahead.width[v, place] + np.where(before & (moment == 0), 2.0 * MARGIN, 0.0)
    ours = np.column_stack([ahead.x[v, place], ahead.y[v, place], ahead.heading[v, place], ahead.length[v], width])
    hit = boxes_overlap(ours, theirs)
    key = pair * q + moment
    np.minimum.at(enter, key[hit], place[hit] * SPACING)
    np.maximum.at(leave, key[hit], place[hit] * SPACING)
    passing = key[hit & ~before & (place == 0)]
    enter[passing], leave[passing] = np.inf, -np.inf
    return enter.reshape(p, q), leave.reshape(p, q)


def speed_along(
    ahead: Sweep, vehicle: NDArray[np.intp], enter: Floats, boxes: Floats, agent: NDArray[np.intp], speed: Floats
) -> Floats:
    """Speed of the road users in the direction in which the vehicles would touch them, at least 0, (p, q) in m/s."""
    place = np.where(np.isfinite(enter), enter / SPACING, 0.0).astype(np.intp)
    turn = boxes[agent, :, 2] - ahead.heading[vehicle[:, None], place]
    return np.maximum(speed[agent, None] * cos_sin(turn)[0], 0.0)
