"""Driving behaviour of road users over a whole run: speeds, braking, surfaces and collisions."""

from typing import Any

import numpy as np

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.counters import UserSums, ratio
from slrl_sumo.metrics.encounters import ALL, EncounterCounts, per_road_user
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES

HARD_BRAKING = -4.5
"""Acceleration (m/s²) of hard braking."""


class DrivingStats:
    """Counts of some road users of a scene; call `add` after each decision interval.

    Collisions and near misses: see metrics.encounters. A pair of two types counts for both, and once for all.
    """

    def __init__(self, roadmap: RoadMap) -> None:
        self._roadmap = roadmap
        self._sums = UserSums()
        self._speed: dict[str, float] = {}
        self._speed_changes = np.zeros(ALL, np.int64)
        self._hard_braking = np.zeros(ALL, np.int64)
        self._encounters = EncounterCounts(levels=roadmap.shapes.levels)

    def add(self, world: WorldState, counted: frozenset[str]) -> None:
        """Count the road users `counted` of `world`, the state of all road users at the end of the interval."""
        mask = np.array([road_user in counted for road_user in world.ids], np.bool_)
        users = world.take(np.flatnonzero(mask))
        before, self._speed = self._speed, dict(zip(users.ids, users.speed.tolist(), strict=True))
        last = np.array([before.get(road_user, np.nan) for road_user in users.ids])
        known, braking = np.isfinite(last), (users.speed - last) / DECISION_INTERVAL < HARD_BRAKING
        self._speed_changes += np.bincount(users.type[known], minlength=ALL)
        self._hard_braking += np.bincount(users.type[known & braking], minlength=ALL)
        off_surface = ~OWN_SURFACE[users.type, self._roadmap.surface_at(users.x, users.y)]
        collisions = per_road_user(self._encounters.add(world, mask), len(world))[mask]
        none = np.zeros(len(users), np.bool_)
        self._sums.add(users, off_surface=off_surface, left_surface=none, collisions=collisions)

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
                "collisions": int(self._encounters.collisions[row]),
                "collisions_with_background": int(self._encounters.with_background[row]),
                "near_misses": int(self._encounters.near_misses[row]),
            }
        return result
