"""Background persons that stop before learned road users, instead of walking through them as in plain SUMO.

SUMO's persons avoid each other, but not persons that are moved from outside. A walk cannot be led around these, but a
person stops and starts at once: before each SUMO step, each person whose next step would lead into contact is held.
See docs/explanation/yielding.md.
"""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.forecast import FORECAST_STANDING_SPEED
from slrl_sumo.scene.contacts import COLLISION_DISTANCE, listed_ranges
from slrl_sumo.scene.geometry import Floats, to_ego
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.sumo.reader import Snapshot

PERSON_ROOM = 0.05
"""Least gap (m) of persons to learned road users: persons in the next stripe of a sidewalk are 0.1 m away."""
FASTEST_WALK = 1.8
"""Greatest speed (m/s) of a person in the next step: SUMO's persons walk at 1.39 m/s with a deviation of 0.14, and
dawdle."""
LONGEST_PERSON_WAIT = 10.0
"""Time (s) after which a held person walks on: SUMO's persons pass through each other on crossings after the same time
(`pedestrian.striping.jamtime.crossing`)."""


class YieldingPersons:
    """Determines the background persons that must stop for learned road users; `step_length`: SUMO's step, s."""

    def __init__(self, step_length: float) -> None:
        self._dt = step_length
        self._waited: dict[str, float] = {}
        """Time (s) for which each person has been blocked."""

    def stopping(self, snapshot: Snapshot, learned: WorldState) -> frozenset[str]:
        """Ids of the persons of `snapshot` (SUMO's last step) to hold, given the state of `learned` after the next."""
        own = frozenset(learned.ids)
        rows = np.array([i for i in np.flatnonzero(snapshot.person).tolist() if snapshot.ids[i] not in own], np.intp)
        blocked = [snapshot.ids[i] for i in rows[self._blocked(snapshot, rows, learned)].tolist()]
        self._waited = {person: self._waited.get(person, 0.0) + self._dt for person in blocked}
        return frozenset(person for person, waited in self._waited.items() if waited <= LONGEST_PERSON_WAIT)

    def _blocked(self, snapshot: Snapshot, rows: NDArray[np.intp], learned: WorldState) -> NDArray[np.bool_]:
        """Which of the persons `rows` would walk into a road user of `learned`, (n,)."""
        blocked = np.zeros(len(rows), np.bool_)
        walking = learned.type == PEDESTRIAN
        # A standing vehicle may be waiting for the person: the person walks past it.
        others = np.flatnonzero(walking | (learned.speed > FORECAST_STANDING_SPEED))
        if not len(rows) or not len(others):
            return blocked
        others = others[np.argsort(learned.x[others], kind="stable")]
        length, width = (np.where(walking, 0.0, size)[others] for size in (learned.length, learned.width))
        room = np.where(walking[others], COLLISION_DISTANCE, 0.5 * COLLISION_DISTANCE) + PERSON_ROOM
        step = np.maximum(snapshot.speed[rows], FASTEST_WALK) * self._dt
        reach = float((0.5 * np.hypot(length, width) + room).max()) + step
        x, y, heading = snapshot.x[rows], snapshot.y[rows], snapshot.heading[rows]
        person, other = listed_ranges(
            np.searchsorted(learned.x[others], x - reach), np.searchsorted(learned.x[others], x + reach)
        ).T
        near = np.abs(learned.y[others[other]] - y[person]) < reach[person]
        person, other = person[near], other[near]

        def gap(walked: Floats) -> Floats:
            at_x, at_y = (x + walked * np.cos(heading))[person], (y + walked * np.sin(heading))[person]
            there = others[other]
            ahead, left = to_ego(at_x - learned.x[there], at_y - learned.y[there], learned.heading[there])
            beyond = (np.maximum(np.abs(v) - 0.5 * size[other], 0.0) for v, size in ((ahead, length), (left, width)))
            return np.asarray(np.hypot(*beyond))

        after = gap(step)
        blocked[person[(after < room[other]) & (after < gap(np.zeros(len(rows))))]] = True
        return blocked
