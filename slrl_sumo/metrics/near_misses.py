"""Collisions and near misses in a trace: pairs of road users, times and places."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.metrics.conflicts import new_encounters
from slrl_sumo.metrics.encounters import ENCOUNTER_PAUSE, TTC_LIMIT, Moments, moments
from slrl_sumo.metrics.neighbours import row_pairs
from slrl_sumo.scene.geometry import Floats


@dataclass(frozen=True)
class Conflict:
    """A collision or near miss of two road users."""

    kind: str
    """A key of encounters.DEFINITIONS."""
    a: int
    """Index of the first road user among all road users of the trace; a < b."""
    b: int
    time: float
    """Time (s) of the begin of a collision, or of the smallest time to collision of a near miss."""
    end: float
    """Time (s) of the end."""
    x: float
    """Midpoint of the two road users at `time`, m."""
    y: float
    value: float
    """Near miss: the smallest time to collision, s. Collision: the closing speed, m/s."""


def find_conflicts(
    *, box: Floats, speed: Floats, kind: NDArray[np.int8], user: Integers, frame: Integers, times: Floats
) -> list[Conflict]:
    """All collisions and near misses of a trace, in the order of time; the definitions are those of `encounters`.

    `box`: x, y (m), heading (rad), length, width (m) of each row, (R, 5); `speed`: m/s, (R,); `kind`: RoadUserType,
    (R,); `user`: index of the road user, (R,); `frame`: index of the time step, (R,); `times`: s, by time step.
    """
    reach = 0.5 * np.hypot(box[:, 3], box[:, 4]) + TTC_LIMIT * speed
    parts = [
        moments(box=box, speed=speed, kind=kind, i=i, j=j)
        for i, j in row_pairs(x=box[:, 0], y=box[:, 1], frame=frame, reach=reach)
    ]
    if not parts:
        return []
    at = Moments(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Moments)))
    table = np.column_stack(
        [
            np.minimum(user[at.i], user[at.j]),
            np.maximum(user[at.i], user[at.j]),
            times[frame[at.i]],
            0.5 * (box[at.i, :2] + box[at.j, :2]),
            at.ttc,
            at.closing,
            at.moving,
        ]
    )
    first = np.full(int(user.max(initial=-1)) + 1, np.inf)
    np.minimum.at(first, user, times[frame])
    found: list[Conflict] = []
    of_pair: dict[tuple[int, int], list[Conflict]] = {}
    for part in _encounters(table[at.overlap]):
        a, b, begin = int(part[0, 0]), int(part[0, 1]), part[0, 2]
        moving = np.flatnonzero(part[:, 7])
        # An overlap from the first common time on is not caused by driving.
        if len(moving) and begin > max(first[a], first[b]) + 1e-9:
            _, _, time, x, y, _, closing, _ = part[moving[0]].tolist()
            collision = Conflict("collision", a, b, time, float(part[-1, 2]), x, y, closing)
            found.append(collision)
            of_pair.setdefault((a, b), []).append(collision)
    for part in _encounters(table[at.near]):
        a, b, begin, end = int(part[0, 0]), int(part[0, 1]), part[0, 2], part[-1, 2]
        if any(
            c.time <= end + ENCOUNTER_PAUSE + 1e-9 and begin <= c.end + ENCOUNTER_PAUSE + 1e-9
            for c in of_pair.get((a, b), ())
        ):
            continue
        _, _, time, x, y, ttc, _, _ = part[part[:, 5].argmin()].tolist()
        found.append(Conflict("near miss", a, b, time, float(end), x, y, ttc))
    return sorted(found, key=lambda c: (c.time, c.a, c.b))


def _encounters(table: Floats) -> list[Floats]:
    """The rows of each encounter, in the order of time; columns 0 to 2 are the two road users and the time."""
    rows = table[np.lexsort((table[:, 2], table[:, 1], table[:, 0]))]
    if not len(rows):
        return []
    a, b = rows[:, :2].astype(np.int64).T
    return np.split(rows, np.flatnonzero(new_encounters(a, b, rows[:, 2]))[1:])
