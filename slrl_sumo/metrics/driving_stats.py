"""Driving behaviour of road users over a whole run: speeds, braking, surfaces and contacts."""

from dataclasses import replace
from typing import Any

import numpy as np

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.counters import NewContacts, UserSums, id_pair, ratio
from slrl_sumo.scene.contacts import Pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES

HARD_BRAKING = -4.5
"""m/s²."""
SHRUNK = 0.1
"""m all round by which boxes are smaller in the second count of overlaps, so that mere touches do not count."""
SMALLEST = 0.01
"""m; no box is made smaller than this."""
CONTACTS = ("collisions", "overlaps", "overlaps_background", "overlaps_shrunk")
ALL = len(TYPE_NAMES)
"""Row of `DrivingStats._contacts` for all types together."""


class DrivingStats:
    """Counts some road users of a scene; call `add` after every decision interval.

    Contacts are pairs whose centres come closer than 0.5 m (collisions) or whose boxes intersect (overlaps) and did not
    in the interval before, with at least one counted road user: each pair counts once in a run. A pair of two types
    counts for both, and once for all. A contact that exists when a road user is taken over does not count.
    """

    def __init__(self, roadmap: RoadMap) -> None:
        self._roadmap = roadmap
        self._sums = UserSums()
        self._speed: dict[str, float] = {}
        self._speed_changes = np.zeros(ALL, np.int64)
        self._hard_braking = np.zeros(ALL, np.int64)
        self._new, self._new_shrunk = NewContacts(), NewContacts()
        self._seen: set[tuple[str, str, str]] = set()
        """Contacts that have been counted: the kind and both ids."""
        self._contacts = np.zeros((ALL + 1, len(CONTACTS)), np.int64)

    def add(self, world: WorldState, counted: frozenset[str]) -> None:
        """Count the road users `counted` of `world`, the state of all road users at the end of the interval."""
        users = world.take(np.array([i for i, road_user in enumerate(world.ids) if road_user in counted], np.intp))
        before, self._speed = self._speed, dict(zip(users.ids, users.speed.tolist(), strict=True))
        last = np.array([before.get(road_user, np.nan) for road_user in users.ids])
        known, braking = np.isfinite(last), (users.speed - last) / DECISION_INTERVAL < HARD_BRAKING
        self._speed_changes += np.bincount(users.type[known], minlength=ALL)
        self._hard_braking += np.bincount(users.type[known & braking], minlength=ALL)
        off_surface = ~OWN_SURFACE[users.type, self._roadmap.surface_at(users.x, users.y)]
        none = np.zeros(len(users), np.int64)  # contacts are counted by pair
        self._sums.add(users, off_surface=off_surface, collisions=none, overlaps=none)
        collisions, overlaps = self._new.begun(world)
        smaller = replace(world, length=_shrunk(world.length), width=_shrunk(world.width))
        self._count(world, counted, "collisions", collisions)
        self._count(world, counted, "overlaps", overlaps)
        self._count(world, counted, "overlaps_shrunk", self._new_shrunk.begun(smaller)[1])

    def record(self) -> dict[str, dict[str, Any]]:
        """Counts, shares and means (None without steps) by type name and for "all", ready for JSON."""
        result = {}
        sums = [self._sums.of_type(kind) for kind in range(ALL)]
        for row, name in enumerate((*TYPE_NAMES, "all")):
            kinds = range(ALL) if row == ALL else [row]
            total = {key: sum(float(sums[kind][key].sum()) for kind in kinds) for key in sums[0]}
            steps, kinds = int(total["steps"]), list(kinds)
            result[name] = {
                "steps": steps,
                "mean_speed_mps": ratio(total["speed"], steps, 5),
                "standing_share": ratio(total["standing"], steps, 5),
                "off_surface_share": ratio(total["off_surface"], steps, 5),
                "hard_braking_share": ratio(self._hard_braking[kinds].sum(), int(self._speed_changes[kinds].sum()), 5),
                **dict(zip(CONTACTS, self._contacts[row].tolist(), strict=True)),
            }
        return result

    def _count(self, world: WorldState, counted: frozenset[str], contact: str, pairs: Pairs) -> None:
        for i, j in pairs.tolist():
            ours = [row for row in (i, j) if world.ids[row] in counted]
            key = (contact, *id_pair(world, i, j))
            if not ours or key in self._seen:
                continue
            self._seen.add(key)
            rows = [ALL, *{int(world.type[row]) for row in ours}]
            self._contacts[rows, CONTACTS.index(contact)] += 1
            if contact == "overlaps" and len(ours) == 1:
                self._contacts[rows, CONTACTS.index("overlaps_background")] += 1


def _shrunk(side: Floats) -> Floats:
    return np.maximum(side - 2.0 * SHRUNK, SMALLEST)
