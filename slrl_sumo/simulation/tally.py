"""The summary of a run: counts and means over all decisions of all learned road users."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.simulation.events import Decision
from slrl_sumo.world.contacts import Pairs, colliding_pairs, overlapping_pairs
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.surfaces import Surface
from slrl_sumo.world.types import TYPE_NAMES, RoadUserType

STANDING_SPEED = 0.1
"""m/s; slower counts as standing."""

OWN_SURFACE = np.zeros((len(RoadUserType), len(Surface)), np.bool_)
"""Which Surface belongs to which RoadUserType (paper, section 3.3): cars keep to roads, the others may use both."""
OWN_SURFACE[RoadUserType.CAR, [Surface.ROAD, Surface.CROSSING]] = True
OWN_SURFACE[RoadUserType.BICYCLE, [Surface.ROAD, Surface.CROSSING, Surface.CYCLEWAY, Surface.SIDEWALK]] = True
OWN_SURFACE[RoadUserType.PEDESTRIAN, [Surface.ROAD, Surface.CROSSING, Surface.CYCLEWAY, Surface.SIDEWALK]] = True


class Tally:
    """Counts what happens to n learned road users, decision by decision.

    A collision (centres closer than 0.5 m) or an overlap (boxes intersect) with any road user, learned or background,
    counts once when it begins, for each learned road user in it.
    """

    def __init__(self, start: WorldState) -> None:
        learned = start.take(np.flatnonzero(start.learned))
        self._type = learned.type
        n = len(learned)
        self.decisions = 0
        self._speed, self._standing, self._off_surface = np.zeros(n), np.zeros(n), np.zeros(n)
        self._collisions, self._overlaps = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self._survived = np.zeros(n, np.int64)
        self._unhurt = np.ones(n, np.bool_)
        self.loops: list[tuple[str, float]] = []
        self.lost = 0
        # Road users that spawn in contact with each other have not collided by driving.
        self._colliding = _keys(colliding_pairs(start), start)
        self._overlapping = _keys(overlapping_pairs(start), start)

    def add(self, decision: Decision) -> None:
        """Count one decision interval."""
        step = decision.steps[-1]
        world, n = step.world, len(self._type)
        self.decisions += 1
        self._speed += world.speed[:n]
        self._standing += world.speed[:n] < STANDING_SPEED
        self._off_surface += ~OWN_SURFACE[self._type, decision.surface]
        self.loops += [(world.ids[row], decision.steps[0].time) for row in np.flatnonzero(decision.looped)]
        self.lost += int(decision.lost.sum())
        colliding, overlapping = colliding_pairs(world), overlapping_pairs(world)
        self._collisions += _begun(colliding, world, self._colliding, n)
        self._overlaps += _begun(overlapping, world, self._overlapping, n)
        self._colliding, self._overlapping = _keys(colliding, world), _keys(overlapping, world)
        self._unhurt[self._collisions > 0] = False
        self._survived += self._unhurt

    def per_type(self) -> dict[str, dict[str, float | int | None]]:
        """The keys of `run --summary` for each type; means are None for a type that nobody had."""
        result = {}
        for kind, name in enumerate(TYPE_NAMES):
            rows = np.flatnonzero(self._type == kind)
            steps = len(rows) * self.decisions
            result[name] = {
                "count": len(rows),
                "mean_speed_mps": _ratio(self._speed[rows].sum(), steps),
                "standing_share": _ratio(self._standing[rows].sum(), steps),
                "collisions": int(self._collisions[rows].sum()),
                "overlaps": int(self._overlaps[rows].sum()),
                "survival_steps": _ratio(self._survived[rows].sum(), len(rows)),
                "success_rate": _ratio(self._unhurt[rows].sum(), len(rows)),
                "off_surface_share": _ratio(self._off_surface[rows].sum(), steps),
            }
        return result

    def summary(self, wall_s: float, interval_s: float) -> dict[str, Any]:
        """Everything that was counted, with units in the key names, ready for JSON."""
        agent_steps = len(self._type) * self.decisions
        return {
            "decisions": self.decisions,
            "decision_interval_s": interval_s,
            "wall_s": round(wall_s, 3),
            "real_time_factor": _ratio(self.decisions * interval_s, wall_s),
            "agent_steps": agent_steps,
            "agent_steps_per_s": _ratio(agent_steps, wall_s),
            "lost": self.lost,
            "looped": len(self.loops),
            "taken_over": 0,
            "handed_back": 0,
            "per_type": self.per_type(),
            "loops": [{"id": road_user, "time_s": round(time, 3)} for road_user, time in self.loops],
        }


def _ratio(value: float, count: float) -> float | None:
    return round(float(value) / count, 4) if count else None


def _keys(pairs: Pairs, world: WorldState) -> set[tuple[str, str]]:
    return {(world.ids[i], world.ids[j]) for i, j in pairs.tolist()}


def _begun(pairs: Pairs, world: WorldState, before: set[tuple[str, str]], n: int) -> NDArray[np.int64]:
    """Contacts of each of the first n road users that were not there before, (n,)."""
    count = np.zeros(n, np.int64)
    for i, j in pairs.tolist():
        a, b = world.ids[i], world.ids[j]
        if (a, b) not in before and (b, a) not in before:
            for row in (i, j):
                if row < n:
                    count[row] += 1
    return count
