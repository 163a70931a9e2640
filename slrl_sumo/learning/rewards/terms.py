"""Terms of the reward as pure functions on arrays, and their weights (paper, section 3.3).

Each function returns one number per road user, of order 1; positive is good.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.contacts import close_pairs
from slrl_sumo.scene.geometry import Box, Floats, wrap_angle
from slrl_sumo.scene.kernels import moved, overlap
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

CLOSE_DISTANCE = 1.0
"""Distance of centres (m) in the paper's r1."""
REWARDED_SPEED = 0.5
"""Speed (m/s) in the paper's r3."""
SURFACE_PENALTY = np.zeros((len(RoadUserType), len(Surface)))
"""Penalty of a Surface for a RoadUserType: 1 off its own surfaces; cyclists and pedestrians may use roads at a small
penalty (paper, r2)."""
SURFACE_PENALTY[:, Surface.NONE] = 1.0
SURFACE_PENALTY[RoadUserType.CAR, [Surface.SIDEWALK, Surface.CYCLEWAY]] = 1.0
SURFACE_PENALTY[[RoadUserType.BICYCLE, RoadUserType.PEDESTRIAN], Surface.ROAD] = 0.1
HARD_ACCELERATION = 3.0
"""Uncomfortable acceleration (m/s²), longitudinal or lateral."""
DANGER_HORIZON = 2.4
"""Time (s) of the prediction in `danger`: a car stops comfortably from 25 km/h within it."""
DANGER_MARGIN = 0.5
"""Gap between boxes (m) below which `danger` counts: centres of pedestrians collide before their small boxes do."""
DANGER_REACH = 40.0
"""Distance of centres (m) beyond which `danger` ignores road users."""
STANDING_DISTANCE = 0.2
"""Desired distance (m) in a decision interval below which the road user should stand."""
LEAST_OVERSHOOT = 1.0
"""Least reference distance (m) of `excess`."""
PATH_TOLERANCE = 0.25
"""Lateral offset (m) without a penalty."""
RAREST_MODE = -8.0
"""Log probability of modes that count as never seen."""


@dataclass(frozen=True)
class RewardWeights:
    """Weight of each term; 0 switches a term off.

    `close`, `off_surface` and `moving` are the three terms of the paper; the last six are for road users with a route
    (preset `extended`).
    """

    close: float = 1.0
    off_surface: float = 1.0
    moving: float = 0.25
    alive: float = 1.0
    contact: float = 10.0
    lost: float = 10.0
    danger: float = 2.0
    speed: float = 0.5
    wrong_way: float = 0.5
    comfort: float = 0.1
    realism: float = 0.05
    progress: float = 0.5
    excess: float = 0.0
    off_path: float = 1.0
    red: float = 10.0
    priority: float = 5.0
    arrival: float = 50.0
    """Weight of the arrival: the return of perfect driving, `progress` of 1 for ever at a discount of 0.98. With less,
    the value of a trip would fall towards its end, and road users would crawl."""


TERMS: tuple[str, ...] = tuple(field.name for field in fields(RewardWeights))


def weighted_terms(weights: RewardWeights) -> tuple[str, ...]:
    """The terms with a weight other than 0."""
    return tuple(name for name in TERMS if getattr(weights, name))


def weighted(terms: dict[str, Floats], weights: RewardWeights) -> Floats:
    """The reward of each road user, (n,): the weighted sum of the terms, each (n,)."""
    return np.asarray(sum(getattr(weights, name) * values for name, values in terms.items()), np.float64)


def close(world: WorldState, n: int) -> Floats:
    """r1: minus the number of road users whose centres are closer than CLOSE_DISTANCE, for the first `n` of
    `world`, (n,)."""
    pairs = close_pairs(world, CLOSE_DISTANCE)
    return -np.bincount(pairs.ravel(), minlength=len(world))[:n].astype(np.float64)


def off_surface(kind: NDArray[np.int8], surface: NDArray[np.uint8]) -> Floats:
    """r2: minus the penalty of the `surface` under each road user for its type `kind`; both (n,)."""
    return -SURFACE_PENALTY[kind, surface]


def moving(speed: Floats) -> Floats:
    """r3: 1 for road users faster than REWARDED_SPEED; `speed` (n,) in m/s."""
    return (speed > REWARDED_SPEED).astype(np.float64)


def alive(n: int) -> Floats:
    """1 for each road user, (n,).

    Without this term, most decisions have a cost, and a contact, which ends the episode, would avoid further costs: the
    avoided costs compensated two thirds of the penalty.
    """
    return np.ones(n)


def contact(hit: NDArray[np.bool_]) -> Floats:
    """Minus 1 for road users in a new contact by own fault, (n,)."""
    return -hit.astype(np.float64)


def lost(gone: NDArray[np.bool_]) -> Floats:
    """Minus 1 for road users that have left the ground and the scene, (n,): otherwise leaving would avoid penalties."""
    return -gone.astype(np.float64)


def danger(world: WorldState, n: int) -> Floats:
    """From 0 (no danger) down to -1 (immediate) for each of the first `n` road users of `world`, (n,).

    Danger is a predicted gap below DANGER_MARGIN between two boxes. All road users are predicted at constant speed and
    yaw rate, in steps of 0.4 s up to DANGER_HORIZON. Only road users ahead count, because a road user cannot avoid
    being hit from behind.
    """
    seconds = np.arange(DANGER_HORIZON, 0.0, -DECISION_INTERVAL)
    columns = (world.x, world.y, world.heading, world.speed, world.yaw_rate, world.length, world.width)
    first = _first_conflict(np.column_stack(columns), seconds, n)
    after = np.append(seconds, DANGER_HORIZON + DECISION_INTERVAL)[first]
    return np.asarray(-(1.0 - (after - DECISION_INTERVAL) / DANGER_HORIZON))


@compiled
def _first_conflict(now: Floats, seconds: Floats, n: int) -> NDArray[np.intp]:
    """Index of the earliest conflict of each of the first `n` road users with a road user ahead, (n,); -1 for none.

    It is an index into `seconds` (s,), which decrease. `now` (m, 7): x, y, heading, speed, yaw rate, length and width.
    """
    boxes = np.empty((len(seconds), len(now), 4))
    for step in range(len(seconds)):
        for i in range(len(now)):
            s = seconds[step]
            x, y, heading = moved(now[i, 0], now[i, 1], now[i, 2], now[i, 3] * s, now[i, 4] * s)
            boxes[step, i, 0], boxes[step, i, 1] = x, y
            boxes[step, i, 2], boxes[step, i, 3] = math.cos(heading), math.sin(heading)
    first = np.full(n, -1)
    for i in range(n):
        if not now[i, 3] > REWARDED_SPEED:
            continue
        cos, sin, corner = math.cos(now[i, 2]), math.sin(now[i, 2]), math.hypot(now[i, 5], now[i, 6])
        for j in range(len(now)):
            dx, dy = now[j, 0] - now[i, 0], now[j, 1] - now[i, 1]
            apart = math.sqrt(dx * dx + dy * dy)
            if j == i or not apart < DANGER_REACH or not cos * dx + sin * dy > 0.0:
                continue
            # Skip pairs that cannot come near each other within the horizon.
            reach = 0.5 * (corner + math.hypot(now[j, 5], now[j, 6])) + 2.0 * DANGER_MARGIN
            if not apart - reach < (now[i, 3] + now[j, 3]) * DANGER_HORIZON:
                continue
            for step in range(len(boxes) - 1, first[i], -1):
                a, b = boxes[step, i], boxes[step, j]
                mine = Box(a[2], a[3], now[i, 5] + DANGER_MARGIN, now[i, 6] + DANGER_MARGIN)
                theirs = Box(b[2], b[3], now[j, 5] + DANGER_MARGIN, now[j, 6] + DANGER_MARGIN)
                if overlap(b[0] - a[0], b[1] - a[1], mine, theirs):
                    first[i] = step
                    break
    return first


def speed_kept(speed: Floats, desired: Floats) -> Floats:
    """From 0 at the desired speed down to -1 at standstill or twice that speed; both (n,) in m/s."""
    return -np.minimum(np.abs(speed - desired) / np.maximum(desired, 0.1), 1.0)


def wrong_way(heading: Floats, lane_heading: Floats, on_lane: NDArray[np.bool_]) -> Floats:
    """Minus 1 for road users `on_lane` that drive against its direction (more than 90 degrees off); rad, (n,)."""
    against = np.abs(wrap_angle(heading - lane_heading)) > 0.5 * np.pi
    return -(against & on_lane).astype(np.float64)


def comfort(speed: Floats, acceleration: Floats, yaw_rate: Floats) -> Floats:
    """From 0 down to -1 at HARD_ACCELERATION in any direction; m/s, m/s², rad/s, (n,)."""
    felt = np.hypot(acceleration, speed * yaw_rate) / HARD_ACCELERATION
    return -np.minimum(felt**2, 1.0)


def realism(log_probability: Floats) -> Floats:
    """From 0 for modes that recorded road users always chose down to -1 for modes that they never chose.

    `log_probability` (n,): log probability of the chosen mode under the bundle's prior, which is learned from
    recordings.
    """
    return np.maximum(log_probability, RAREST_MODE) / -RAREST_MODE


def progress(covered: Floats, wanted: Floats, known: NDArray[np.bool_]) -> Floats:
    """1 for road users that covered the desired distance, down to -1 for the opposite direction; 1 for required stops.

    `covered` and `wanted` (n,): distances along the path, m. `known` (n,): whether there is a route; 0 without a route.
    """
    share = np.clip(covered / np.maximum(wanted, STANDING_DISTANCE), -1.0, 1.0)
    return np.where(known, np.where(wanted < STANDING_DISTANCE, 1.0, share), 0.0)


def excess(covered: Floats, wanted: Floats, known: NDArray[np.bool_]) -> Floats:
    """From 0 for road users that covered at most the desired distance down to -1 for twice the distance.

    Arguments: see `progress`. For short desired distances, the excess counts relative to LEAST_OVERSHOOT.
    """
    more = np.maximum(covered - np.maximum(wanted, STANDING_DISTANCE), 0.0) / np.maximum(wanted, LEAST_OVERSHOOT)
    return -np.where(known, np.minimum(more, 1.0), 0.0)


def off_path(aside: Floats, known: NDArray[np.bool_]) -> Floats:
    """From 0 within PATH_TOLERANCE of the path down to -1 at three times PATH_TOLERANCE; lateral offset `aside` in m,
    (n,)."""
    return -np.where(known, np.clip((np.abs(aside) - PATH_TOLERANCE) / (2.0 * PATH_TOLERANCE), 0.0, 1.0), 0.0)


def passed(before: Floats, after: Floats, line: Floats, closed: NDArray[np.bool_]) -> Floats:
    """Minus 1 for road users that crossed a `closed` line, (n,).

    `before`, `after`: positions (m along the path) before and after the decision. `line`: position at which the front
    is on the line. All (n,).
    """
    return -(closed & (line > np.maximum(before, 0.0)) & (after > line)).astype(np.float64)


def arrival(reached: NDArray[np.bool_] | None, n: int) -> Floats:
    """1 for each of n road users at its destination, (n,); `reached` is None for road users without trips."""
    return np.zeros(n) if reached is None else reached.astype(np.float64)
