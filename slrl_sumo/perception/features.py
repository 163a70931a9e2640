"""The feature vector: own motion, and road users nearby.

The preset `paper` is the vector of the paper, section 3.1. The preset `history` adds the motion of the last 2 s and the
nearest road users.
"""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.past_motion import PAST, steady_past
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CAR = int(RoadUserType.CAR)
RADII = (5.0, 10.0, 20.0)
"""Distances (m) within which other road users are counted, from centre to centre, inclusive."""

FEATURES: tuple[str, ...] = (
    "speed",
    "acceleration",
    "car",
    "bicycle",
    "pedestrian",
    "heading",
    "vru_5",
    "vru_10",
    "vru_20",
    "other_5",
    "other_10",
    "other_20",
)
"""Columns of `features`: m/s, m/s², one-hot type, rad, then counts of VRUs and of other road users in each radius."""
COUNTS = FEATURES.index("vru_5")
"""First of the columns that count neighbours; these columns are the last ones."""
WITHIN_20 = [FEATURES.index("vru_20"), FEATURES.index("other_20")]
"""Columns whose sum is the number of road users within the largest of RADII, a measure of traffic density."""
COMPANY = ("vru_", "other_", "near_")
"""Prefixes of the names of columns about other road users."""

NEAREST = 3
"""Number of nearest road users with columns of their own in the preset `history`."""
NEAR = 15.0
"""Distance (m) beyond which a road user has no columns of its own."""
CLOSENESS = 5.0
"""Length scale (m): the columns of a road user at distance d have the weight exp(-d / CLOSENESS). A road user that
comes into reach thus changes them gradually, and a missing road user has zeros."""

YAW_RATE = len(FEATURES)
"""First column of the preset `history` that the preset `paper` lacks."""
PAST_SPEED, PAST_YAW_RATE = YAW_RATE + 1, YAW_RATE + 1 + PAST
NEAR_FIRST = YAW_RATE + 1 + 2 * PAST
NEAR_COLUMNS = ("ahead", "left", "ahead_mps", "left_mps")

STATES: dict[str, tuple[str, ...]] = {
    "paper": FEATURES,
    "history": (
        *FEATURES,
        "yaw_rate",
        *(f"speed_{k}" for k in range(1, PAST + 1)),
        *(f"yaw_rate_{k}" for k in range(1, PAST + 1)),
        *(f"near_{k}_{column}" for k in range(1, NEAREST + 1) for column in NEAR_COLUMNS),
    ),
}
"""Columns of the vector by preset. `history`: yaw rate, rad/s; speeds and yaw rates 1 to 4 intervals ago; direction and
velocity relative to the own one of the nearest road users in the ego frame, times their closeness."""


def state(
    world: WorldState, rows: NDArray[np.intp], scene: NDArray[np.int64] | None, past: Floats | None, preset: str
) -> NDArray[np.float32]:
    """The vector of the road users `rows`, (len(rows), columns), columns as in STATES[preset], not normalised.

    `past` (n, PAST, 2): past motion of the first n road users, which include `rows`; see
    slrl_sumo.perception.past_motion. None: they moved straight ahead at their speed. Other arguments: see `features`.
    """
    paper = features(world, rows, scene)
    if preset == "paper":
        return paper
    speed, yaw_rate = world.speed[rows], world.yaw_rate[rows]
    mine = steady_past(speed) if past is None else past[rows]
    near = _nearest(*_in_order(world, rows, scene), world.heading, world.speed)
    return np.column_stack([paper, yaw_rate, mine[..., 0], mine[..., 1], near]).astype(np.float32)


def features(world: WorldState, rows: NDArray[np.intp], scene: NDArray[np.int64] | None = None) -> NDArray[np.float32]:
    """The vector of the road users `rows` of `world`, (len(rows), 12), columns as in FEATURES, not normalised.

    All other road users of the world count, learned or background. If `world` contains several separate scenes,
    `scene` (n,) is the scene of each road user.
    """
    x, y, group, rows, order = _in_order(world, rows, scene)
    own = np.column_stack([world.speed[rows], world.acceleration[rows], world.heading[rows]])
    return _table(own, x, y, world.type, group, rows, order)


def _in_order(
    world: WorldState, rows: NDArray[np.intp], scene: NDArray[np.int64] | None
) -> tuple[Floats, Floats, NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]]:
    """Positions, scenes, `rows`, and the order of all road users by scene, then from west to east.

    Road users near each other are close in this order.
    """
    scene = np.zeros(len(world), np.int64) if scene is None else scene
    return world.x, world.y, scene, rows, np.lexsort((world.x, scene))


@compiled
def _table(
    own: Floats,
    x: Floats,
    y: Floats,
    kinds: NDArray[np.int8],
    scene: NDArray[np.int64],
    rows: NDArray[np.intp],
    order: NDArray[np.intp],
) -> NDArray[np.float32]:
    """The table of `features`.

    `own`: speed, acceleration and heading of `rows`, (len(rows), 3). `order`: all road users by scene, then by x.
    """
    table = np.zeros((len(rows), 2 + 3 + 1 + 2 * len(RADII)), np.float32)
    place = np.empty(len(order), np.intp)
    for k in range(len(order)):  # not place[order]: see scene.compiled
        place[order[k]] = k
    for i in range(len(rows)):
        ego = rows[i]
        table[i, 0], table[i, 1], table[i, 5] = own[i, 0], own[i, 1], own[i, 2]
        table[i, 2 + kinds[ego]] = 1.0
        for step in (-1, 1):
            k = place[ego] + step
            while 0 <= k < len(order):
                other = order[k]
                dx, dy = x[other] - x[ego], y[other] - y[ego]
                if abs(dx) > RADII[-1] or scene[other] != scene[ego]:
                    break
                k += step
                if abs(dy) > RADII[-1]:
                    continue
                distance = math.sqrt(dx * dx + dy * dy)
                first = 6 + len(RADII) * (kinds[other] == CAR)
                for ring in range(len(RADII)):
                    table[i, first + ring] += distance <= RADII[ring]
    return table


@compiled
def _nearest(
    x: Floats,
    y: Floats,
    scene: NDArray[np.int64],
    rows: NDArray[np.intp],
    order: NDArray[np.intp],
    heading: Floats,
    speed: Floats,
) -> Floats:
    """Columns of the NEAREST road users within NEAR of each of `rows`, (len(rows), 4 * NEAREST); `order`: see
    `_table`."""
    table = np.zeros((len(rows), 4 * NEAREST))
    place = np.empty(len(order), np.intp)
    for k in range(len(order)):
        place[order[k]] = k
    for i in range(len(rows)):
        ego = rows[i]
        at = np.full(NEAREST, NEAR)
        who = np.full(NEAREST, -1)
        for step in (-1, 1):
            k = place[ego] + step
            while 0 <= k < len(order):
                other = order[k]
                dx, dy = x[other] - x[ego], y[other] - y[ego]
                if abs(dx) > at[-1] or scene[other] != scene[ego]:
                    break
                distance = math.sqrt(dx * dx + dy * dy)
                if distance < at[-1]:
                    slot = NEAREST - 1
                    while slot > 0 and distance < at[slot - 1]:
                        at[slot], who[slot] = at[slot - 1], who[slot - 1]
                        slot -= 1
                    at[slot], who[slot] = distance, other
                k += step
        c, s = math.cos(heading[ego]), math.sin(heading[ego])
        for slot in range(NEAREST):
            other = who[slot]
            if other < 0:
                break
            weight = math.exp(-at[slot] / CLOSENESS)
            far = max(at[slot], 0.1)
            dx, dy = (x[other] - x[ego]) / far, (y[other] - y[ego]) / far
            vx = speed[other] * math.cos(heading[other]) - speed[ego] * c
            vy = speed[other] * math.sin(heading[other]) - speed[ego] * s
            table[i, 4 * slot] = weight * (c * dx + s * dy)
            table[i, 4 * slot + 1] = weight * (c * dy - s * dx)
            table[i, 4 * slot + 2] = weight * (c * vx + s * vy)
            table[i, 4 * slot + 3] = weight * (c * vy - s * vx)
    return table
