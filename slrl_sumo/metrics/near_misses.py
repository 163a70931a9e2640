"""Collisions and near misses in a trace: pairs of road users, when and where."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.surrogate_safety import time_to_collision
from slrl_sumo.scene.contacts import close_pairs, overlapping_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

TTC_LIMIT = 1.5
"""s: below this time to collision a meeting is a near miss (the threshold of FHWA's SSAM; Gettman and Head 2003,
"Surrogate Safety Measures from Traffic Simulation Models", FHWA-RD-03-050)."""
CLOSING_LIMIT = 1.0
"""m/s that a pair must come closer at least: who walks or queues side by side is no near miss."""
STANDING = 0.1
"""m/s: boxes that overlap while both stand were put there by the scenario (parked, waiting at a stop)."""
SAME_EVENT = 2.0
"""s: moments of one pair that are no further apart are one event."""

DEFINITIONS = {
    "collision": f"Boxes of two road users overlap and at least one of them goes faster than {STANDING:g} m/s.",
    "near miss": (
        f"Time to collision below {TTC_LIMIT:g} s: so soon would the two boxes touch if both kept velocity and heading "
        f"(the smallest value and its moment are given), and they close in by {CLOSING_LIMIT:g} m/s at least. Two "
        "pedestrians make no near miss, nor does a pair that collides within 2 s."
    ),
}
"""What the words mean, for people."""


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


@dataclass
class ConflictFinder:
    """Looks at one time step after the other."""

    _rows: dict[str, list[Floats]] = field(default_factory=lambda: {kind: [] for kind in DEFINITIONS})

    def look(self, world: WorldState, keys: NDArray[np.integer]) -> None:
        """One step: `keys` are the indices, among all road users, of those in `world`, (n,), ascending."""
        if len(world) < 2:
            return
        velocity = world.speed[:, None] * np.stack([np.cos(world.heading), np.sin(world.heading)], axis=1)
        boxes = np.column_stack([world.x, world.y, world.heading, world.length, world.width])

        hits = overlapping_pairs(world)
        hits = hits[world.speed[hits].max(axis=1, initial=0.0) > STANDING]
        self._note("collision", world, keys, hits, _closing_speed(boxes, velocity, hits))

        radius = 0.5 * np.hypot(world.length, world.width)
        # Two that are further apart than this cannot touch in time, whoever they are.
        pairs = close_pairs(world, 2.0 * float(world.speed.max()) * TTC_LIMIT + 2.0 * float(radius.max()))
        walking = world.type == RoadUserType.PEDESTRIAN
        pairs = pairs[~walking[pairs].all(axis=1)]
        pairs = pairs[_may_touch(boxes, velocity, radius, pairs)]
        closing = _closing_speed(boxes, velocity, pairs)
        pairs = pairs[closing >= CLOSING_LIMIT]
        i, j = pairs.T
        ttc = time_to_collision(a=boxes[i], b=boxes[j], velocity_a=velocity[i], velocity_b=velocity[j])
        near = (ttc < TTC_LIMIT) & (ttc > 0.0)
        self._note("near miss", world, keys, pairs[near], ttc[near])

    def _note(
        self, kind: str, world: WorldState, keys: NDArray[np.integer], pairs: NDArray[np.intp], value: Floats
    ) -> None:
        i, j = pairs.T
        middle = (0.5 * (world.x[i] + world.x[j]), 0.5 * (world.y[i] + world.y[j]))
        time = np.full(len(pairs), world.time)
        self._rows[kind].append(np.stack([keys[i], keys[j], time, *middle, value], axis=1).astype(np.float64))

    def conflicts(self) -> list[Conflict]:
        """All that were seen, in the order of time."""
        collisions = _events("collision", self._rows["collision"])
        hit: dict[tuple[int, int], list[Conflict]] = {}
        for event in collisions:
            hit.setdefault((event.a, event.b), []).append(event)
        near = [
            miss
            for miss in _events("near miss", self._rows["near miss"])
            if not any(
                c.time - SAME_EVENT <= miss.end and miss.time <= c.end + SAME_EVENT
                for c in hit.get((miss.a, miss.b), ())
            )
        ]
        return sorted(collisions + near, key=lambda c: (c.time, c.a, c.b))


def _may_touch(boxes: Floats, velocity: Floats, radius: Floats, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether circles round the boxes come to touch within TTC_LIMIT: cheap, and few pairs are left."""
    i, j = pairs.T
    offset, speed = boxes[j, :2] - boxes[i, :2], velocity[j] - velocity[i]
    squared = np.maximum((speed**2).sum(axis=1), 1e-12)
    nearest = np.clip(-(offset * speed).sum(axis=1) / squared, 0.0, TTC_LIMIT)
    apart: Floats = np.hypot(*(offset + nearest[:, None] * speed).T)
    close: NDArray[np.bool_] = apart <= radius[i] + radius[j]
    return close


def _closing_speed(boxes: Floats, velocity: Floats, pairs: NDArray[np.intp]) -> Floats:
    """m/s at which the centres of each pair come closer; negative where they part."""
    i, j = pairs.T
    offset, speed = boxes[j, :2] - boxes[i, :2], velocity[j] - velocity[i]
    closing: Floats = -(offset * speed).sum(axis=1) / np.maximum(np.hypot(*offset.T), 1e-9)
    return closing


def _events(kind: str, moments: list[Floats]) -> list[Conflict]:
    """Moments of the same pair, rows (a, b, time, x, y, value), put together where they follow each other."""
    rows = np.concatenate([*moments, np.zeros((0, 6))])
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    a, b, time = rows[:, 0], rows[:, 1], rows[:, 2]
    new = np.ones(len(rows), np.bool_)
    new[1:] = (np.diff(a) != 0) | (np.diff(b) != 0) | (np.diff(time) > SAME_EVENT)
    events = []
    for part in np.split(rows, np.flatnonzero(new)[1:]) if len(rows) else ():
        at = part[0] if kind == "collision" else part[part[:, 5].argmin()]
        _, _, t, x, y, value = at.tolist()
        events.append(Conflict(kind, int(part[0, 0]), int(part[0, 1]), t, float(part[-1, 2]), x, y, value))
    return events
