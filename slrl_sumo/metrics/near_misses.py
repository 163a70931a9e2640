"""Collisions and near misses in a trace: pairs of road users, times and places."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.metrics.conflicts import PAUSE, TTC_LIMIT, new_encounters, pairs_about_to_touch
from slrl_sumo.metrics.counters import STANDING_SPEED
from slrl_sumo.metrics.neighbours import Rows
from slrl_sumo.scene.geometry import Floats, boxes_overlap
from slrl_sumo.scene.types import RoadUserType

CLOSING_LIMIT = 1.0
"""m/s; pairs that approach more slowly, side by side or in a queue, are no near misses."""

DEFINITIONS = {
    "collision": f"Boxes of two road users overlap and at least one of them goes faster than {STANDING_SPEED:g} m/s.",
    "near miss": (
        f"Time to collision below {TTC_LIMIT:g} s: so soon would the two boxes touch if both kept velocity and heading "
        f"(the smallest value and its moment are given), and they close in by {CLOSING_LIMIT:g} m/s at least. Two "
        "pedestrians make no near miss, nor does a pair that collides within 2 s."
    ),
}
"""Definitions of the kinds of conflict, for readers of a replay."""


@dataclass(frozen=True)
class Conflict:
    """A collision or near miss of two road users."""

    kind: str
    """One of DEFINITIONS."""
    a: int
    """Index of one of the two among all road users of the trace; a < b."""
    b: int
    time: float
    """s: when a collision begins, when the time to collision of a near miss is smallest."""
    end: float
    """s: its last moment."""
    x: float
    """m: half way between the two at `time`."""
    y: float
    value: float
    """Near miss: the smallest time to collision, s. Collision: the speed at which the two come closer, m/s."""


def find_conflicts(
    *, box: Floats, speed: Floats, kind: NDArray[np.int8], user: Integers, frame: Integers, times: Floats
) -> list[Conflict]:
    """All collisions and near misses of a trace, in the order of time.

    `box`: x, y (m), heading (rad), length, width (m) of each row, (R, 5); `speed`: m/s, (R,); `kind`: RoadUserType,
    (R,); `user`: index of the road user, (R,); `frame`: index of the time step, (R,); `times`: s, by time step.
    """
    velocity = speed[:, None] * np.stack([np.cos(box[:, 2]), np.sin(box[:, 2])], axis=1)
    i, j, ttc = pairs_about_to_touch(box=box, velocity=velocity, frame=frame)
    i, j = np.where(user[i] < user[j], i, j), np.where(user[i] < user[j], j, i)
    closing = _closing_speed(box, velocity, i, j)
    hit = boxes_overlap(box[i], box[j]) & (np.maximum(speed[i], speed[j]) > STANDING_SPEED)
    pedestrians = (kind[i] == RoadUserType.PEDESTRIAN) & (kind[j] == RoadUserType.PEDESTRIAN)
    near = (ttc > 0.0) & (closing >= CLOSING_LIMIT) & ~pedestrians

    def events(name: str, chosen: NDArray[np.bool_], value: Floats) -> list[Conflict]:
        rows = i[chosen], j[chosen]
        middle = (0.5 * (box[rows[0], column] + box[rows[1], column]) for column in (0, 1))
        moments = np.column_stack([user[rows[0]], user[rows[1]], times[frame[rows[0]]], *middle, value[chosen]])
        return _events(name, moments)

    collisions = events("collision", hit, closing)
    of_pair: dict[tuple[int, int], list[Conflict]] = {}
    for event in collisions:
        of_pair.setdefault((event.a, event.b), []).append(event)
    misses = [
        miss
        for miss in events("near miss", near, ttc)
        if not any(c.time - PAUSE <= miss.end and miss.time <= c.end + PAUSE for c in of_pair.get((miss.a, miss.b), ()))
    ]
    return sorted(collisions + misses, key=lambda c: (c.time, c.a, c.b))


def _closing_speed(box: Floats, velocity: Floats, i: Rows, j: Rows) -> Floats:
    """m/s at which the centres of pairs of rows approach each other; negative where they separate."""
    offset, speed = box[j, :2] - box[i, :2], velocity[j] - velocity[i]
    closing: Floats = -(offset * speed).sum(axis=1) / np.maximum(np.hypot(*offset.T), 1e-9)
    return closing


def _events(kind: str, rows: Floats) -> list[Conflict]:
    """One event for each encounter; `rows`: its moments as a, b, time, x, y, value."""
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    a, b = rows[:, :2].astype(np.int64).T
    new = new_encounters(a, b, rows[:, 2])
    events = []
    for part in np.split(rows, np.flatnonzero(new)[1:]) if len(rows) else ():
        at = part[0] if kind == "collision" else part[part[:, 5].argmin()]
        _, _, t, x, y, value = at.tolist()
        events.append(Conflict(kind, int(part[0, 0]), int(part[0, 1]), t, float(part[-1, 2]), x, y, value))
    return events
