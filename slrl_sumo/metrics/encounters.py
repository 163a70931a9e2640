"""Collisions and near misses: their common definition, and their counts during a simulation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.surrogate_safety import time_to_collision
from slrl_sumo.scene.contacts import Pairs, pairs_in_reach
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.levels import FLAT, Levels, together
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES, RoadUserType

TTC_LIMIT = 1.5
"""Time to collision (s) of a near miss: SSAM's default (FHWA-HRT-08-051), after Hydén (1987) and van der Horst
(1990)."""
CLOSING_LIMIT = 1.0
"""Closing speed (m/s) below which pairs, such as side by side or in a queue, are no near misses."""
ENCOUNTER_PAUSE = 2.0
"""Time (s) apart after which a pair has a new encounter."""
ALL = len(TYPE_NAMES)
"""Row of EncounterCounts for all types together."""

DEFINITIONS = {
    "collision": (
        f"The boxes of two road users overlap while at least one of them goes faster than {STANDING_SPEED:g} m/s. It "
        f"counts once, when it begins; after {ENCOUNTER_PAUSE:g} s apart the same two may have another. Boxes that "
        "overlap from the first moment of one of the two on do not count."
    ),
    "near miss": (
        f"Time to collision below {TTC_LIMIT:g} s: so soon would the two boxes touch if both kept velocity and heading "
        f"(the smallest value and its moment are given), and they close in by {CLOSING_LIMIT:g} m/s at least. Two "
        f"pedestrians have no near miss, nor have two road users that collide within {ENCOUNTER_PAUSE:g} s."
    ),
}
"""Definitions for the readers of tables and pages."""


@dataclass(frozen=True)
class Moments:
    """Pairs of rows, each at one time, with a time to collision below TTC_LIMIT, (k,) each."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    ttc: Floats
    """Time to collision, s; 0 if the boxes overlap."""
    closing: Floats
    """Closing speed (m/s) of the centres; negative if they separate."""
    moving: NDArray[np.bool_]
    """Whether at least one of the two road users moves."""
    near: NDArray[np.bool_]
    """Whether the pair is in a near miss at this time."""

    @property
    def overlap(self) -> NDArray[np.bool_]:
        """Whether the boxes overlap, (k,)."""
        return np.asarray(self.ttc == 0.0)


def touching_soon(
    *,
    box: Floats,
    velocity: Floats,
    i: NDArray[np.intp],
    j: NDArray[np.intp],
    below: float = TTC_LIMIT,
    levels: Levels = FLAT,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """The pairs of rows (i, j), (p,) each, with a time to collision below `below` s, and this time, (k,) each.

    `box`: x, y (m), heading (rad), length, width (m), (R, 5); `velocity`: m/s, (R, 2). 0 s is an overlap. Pairs that
    will be on different `levels` then do not count.
    """
    # Only few pairs have bounding circles that touch in time.
    radius = 0.5 * np.hypot(box[:, 3], box[:, 4])
    offset, speed = box[j, :2] - box[i, :2], velocity[j] - velocity[i]
    squared = np.maximum((speed**2).sum(axis=1), 1e-12)
    nearest = np.clip(-(offset * speed).sum(axis=1) / squared, 0.0, below)
    distance = np.hypot(*(offset + nearest[:, None] * speed).T)
    touching = distance <= radius[i] + radius[j] + 1e-6
    i, j = i[touching], j[touching]
    ttc = time_to_collision(a=box[i], b=box[j], velocity_a=velocity[i], velocity_b=velocity[j])
    soon = ttc < below
    i, j, ttc = i[soon], j[soon], ttc[soon]
    if not len(levels.x):
        return i, j, ttc
    mine, theirs = (np.column_stack([box[k, :2] + ttc[:, None] * velocity[k], box[k, 2]]) for k in (i, j))
    same = together(levels, mine, theirs)
    return i[same], j[same], ttc[same]


def moments(
    *,
    box: Floats,
    speed: Floats,
    kind: NDArray[np.int8],
    i: NDArray[np.intp],
    j: NDArray[np.intp],
    levels: Levels = FLAT,
) -> Moments:
    """The Moments among pairs of rows (i, j), (p,) each.

    `box` (R, 5), `levels`: see `touching_soon`; `speed`: m/s along the heading, (R,); `kind`: RoadUserType, (R,).
    """
    velocity = speed[:, None] * np.stack([np.cos(box[:, 2]), np.sin(box[:, 2])], axis=1)
    i, j, ttc = touching_soon(box=box, velocity=velocity, i=i, j=j, levels=levels)
    offset, relative = box[j, :2] - box[i, :2], velocity[j] - velocity[i]
    closing: Floats = -(offset * relative).sum(axis=1) / np.maximum(np.hypot(*offset.T), 1e-9)
    pedestrians = (kind[i] == RoadUserType.PEDESTRIAN) & (kind[j] == RoadUserType.PEDESTRIAN)
    return Moments(
        i=i,
        j=j,
        ttc=ttc,
        closing=closing,
        moving=np.maximum(speed[i], speed[j]) > STANDING_SPEED,
        near=(ttc > 0.0) & (closing >= CLOSING_LIMIT) & ~pedestrians,
    )


@dataclass
class _Overlap:
    """An encounter of two road users with overlapping boxes."""

    last: float
    """Time of the last overlap, s."""
    collision: bool
    """Whether the encounter is, or may still become, a collision, because the overlap began during the simulation."""
    begun: bool = False
    """Whether the encounter is a counted collision."""


@dataclass
class _Approach:
    """An encounter of two road users with a short time to collision."""

    last: float
    """Time of the last such moment, s."""
    rows: list[int]
    """Rows of the counts in which the encounter is a near miss."""


class EncounterCounts:
    """Counts of collisions and near misses of some road users by DEFINITIONS, updated at each decision.

    A pair counts once in total, and once for each type of its counted road users. An overlap that exists when a road
    user appears, or when the first of the two becomes counted, is not caused by driving and does not count. Nor do
    overlaps of boxes on different `levels`.

    `collisions`, `near_misses`: by RoadUserType, and ALL, (4,). `with_background`: collisions with only one counted
    road user. `start`, `counted`: all road users before the first decision, and whether each of them is counted.
    """

    def __init__(
        self,
        start: WorldState | None = None,
        counted: NDArray[np.bool_] | None = None,
        levels: Levels = FLAT,
    ) -> None:
        self._levels = levels
        self.collisions, self.near_misses, self.with_background = (np.zeros(ALL + 1, np.int64) for _ in range(3))
        self._overlaps: dict[tuple[str, str], _Overlap] = {}
        self._approaches: dict[tuple[str, str], _Approach] = {}
        self._present: frozenset[str] = frozenset()
        self._counted: frozenset[str] = frozenset()
        self._pruned = -np.inf
        if start is not None:
            self.add(start, start.learned if counted is None else counted)

    def add(self, world: WorldState, counted: NDArray[np.bool_]) -> Pairs:
        """Count one decision. `world`: all n road users at its end. `counted`: whether to count each of them, (n,).

        Returns the rows of the pairs whose collision began, (p, 2).
        """
        now = world.time
        found = self._moments(world, counted)
        began: list[tuple[int, int]] = []
        for i, j, moving in zip(*(a[found.overlap].tolist() for a in (found.i, found.j, found.moving)), strict=True):
            pair = id_pair(world, i, j)
            overlap = self._overlaps.get(pair)
            if overlap is None or now - overlap.last > ENCOUNTER_PAUSE + 1e-9:
                ours = [world.ids[row] for row in (i, j) if counted[row]]
                by_driving = self._present.issuperset(pair) and not self._counted.isdisjoint(ours)
                overlap = self._overlaps[pair] = _Overlap(now, by_driving)
            overlap.last = now
            if moving and overlap.collision and not overlap.begun:
                overlap.begun = True
                began.append((i, j))
                rows, both = _rows(world, counted, i, j)
                self.collisions[rows] += 1
                self.with_background[rows] += not both
                approach = self._approaches.get(pair)
                if approach is not None and now - approach.last <= ENCOUNTER_PAUSE + 1e-9:
                    self.near_misses[approach.rows] -= 1
                    approach.rows = []
        for i, j in zip(found.i[found.near].tolist(), found.j[found.near].tolist(), strict=True):
            pair = id_pair(world, i, j)
            approach = self._approaches.get(pair)
            if approach is None or now - approach.last > ENCOUNTER_PAUSE + 1e-9:
                overlap = self._overlaps.get(pair)
                collided = overlap is not None and overlap.begun and now - overlap.last <= ENCOUNTER_PAUSE + 1e-9
                approach = self._approaches[pair] = _Approach(now, [] if collided else _rows(world, counted, i, j)[0])
                self.near_misses[approach.rows] += 1
            approach.last = now
        self._present, self._counted = frozenset(world.ids), frozenset(_ids(world, counted))
        self._forget(now)
        return np.array(began, np.intp).reshape(-1, 2)

    def _moments(self, world: WorldState, counted: NDArray[np.bool_]) -> Moments:
        box = np.column_stack([world.x, world.y, world.heading, world.length, world.width])
        # Search slightly farther than road users can move; the bounding circles decide.
        reach = 0.5 * np.hypot(world.length, world.width) + TTC_LIMIT * world.speed + 0.01
        pairs = pairs_in_reach(world, reach) if counted.any() else np.zeros((0, 2), np.intp)
        i, j = pairs[counted[pairs].any(axis=1)].T
        return moments(box=box, speed=world.speed, kind=world.type, i=i, j=j, levels=self._levels)

    def _forget(self, now: float) -> None:
        """Drop ended encounters from time to time, so that memory does not grow with the run."""
        if now - self._pruned < 5.0 * ENCOUNTER_PAUSE:
            return
        self._pruned = now
        self._overlaps = {pair: one for pair, one in self._overlaps.items() if now - one.last <= 2.0 * ENCOUNTER_PAUSE}
        self._approaches = {
            pair: one for pair, one in self._approaches.items() if now - one.last <= 2.0 * ENCOUNTER_PAUSE
        }


def id_pair(world: WorldState, i: int, j: int) -> tuple[str, str]:
    """The ids of two rows, sorted."""
    a, b = world.ids[i], world.ids[j]
    return (a, b) if a < b else (b, a)


def per_road_user(pairs: Pairs, n: int) -> NDArray[np.int64]:
    """Number of the pairs (p, 2) of each of the first n rows, (n,)."""
    return np.bincount(pairs[pairs < n], minlength=n)


def _rows(world: WorldState, counted: NDArray[np.bool_], i: int, j: int) -> tuple[list[int], bool]:
    """Rows of the counts for a pair, and whether both road users are counted."""
    kinds = [int(world.type[row]) for row in (i, j) if counted[row]]
    return [ALL, *sorted(set(kinds))], len(kinds) == 2


def _ids(world: WorldState, counted: NDArray[np.bool_]) -> list[str]:
    return [world.ids[row] for row in np.flatnonzero(counted)]
