"""The summary of a run: counts and means over all decisions of all learned road users."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.scene.contacts import Pairs, contact_pairs, ids_of
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.simulation.events import Decision

STANDING_SPEED = 0.1
"""m/s; slower counts as standing."""

SUMS = ("steps", "speed", "standing", "off_surface", "collisions", "overlaps", "survived")
"""What is added up of each road user over the decisions in which it was learned; speed in m/s."""


class RunCounters:
    """Counts what happens to learned road users, decision by decision.

    A collision (centres closer than 0.5 m) or an overlap (boxes intersect) with any road user, learned or background,
    counts once when it begins, for each learned road user in it. Survival is the number of decisions before the first
    collision, up to the end of the run or of the loan.
    """

    def __init__(self, start: WorldState) -> None:
        self.decisions = 0
        self.loops: list[tuple[str, float]] = []
        self.lost: list[tuple[str, float]] = []
        self.taken_over = self.handed_back = self.strayed = self.arrived = self.interventions = 0
        self._rows: dict[str, int] = {}
        """Which column of `_sums` is whose."""
        self._kind = np.zeros(64, np.int8)
        self._sums = np.zeros((len(SUMS), 64))
        self._of: tuple[str, ...] = ()
        self._columns = np.zeros(0, np.intp)
        rows = np.flatnonzero(start.learned)
        self._found(tuple(start.ids[row] for row in rows), start.type[rows])
        # Road users that start in contact with each other have not collided by driving.
        self._colliding, self._overlapping = (ids_of(pairs, start) for pairs in contact_pairs(start))

    def add(self, decision: Decision) -> None:
        """Count one decision interval."""
        step = decision.steps[-1]
        world = step.world
        n = len(decision.surface)
        self.decisions += 1
        self.loops += [(world.ids[row], decision.steps[0].time) for row in np.flatnonzero(decision.looped)]
        self.lost += [(world.ids[row], step.time) for row in np.flatnonzero(decision.lost)]
        self.taken_over += len(decision.taken_over)
        self.handed_back += len(decision.handed_back)
        self.strayed += len(decision.strayed)
        self.arrived += len(decision.arrived)
        self.interventions += decision.interventions
        colliding, overlapping = contact_pairs(world)
        collisions = _begun(colliding, world, self._colliding, n)
        overlaps = _begun(overlapping, world, self._overlapping, n)
        self._colliding, self._overlapping = ids_of(colliding, world), ids_of(overlapping, world)
        speed, kinds = world.speed[:n], world.type[:n]
        columns = self._found(world.ids[:n], kinds)
        collided = self._sums[SUMS.index("collisions"), columns] + collisions
        off_surface = ~OWN_SURFACE[kinds, decision.surface]
        now = np.ones(n), speed, speed < STANDING_SPEED, off_surface, collisions, overlaps, collided == 0
        self._sums[:, columns] += np.array(now, np.float64)

    def _found(self, ids: tuple[str, ...], kinds: NDArray[np.int8]) -> NDArray[np.intp]:
        """The column of each of n learned road users of these types, (n,); new ones get one."""
        if ids == self._of:
            return self._columns
        for name, kind in zip(ids, kinds.tolist(), strict=True):
            if name not in self._rows:
                column = self._rows[name] = len(self._rows)
                if column == len(self._kind):
                    self._kind = np.concatenate([self._kind, np.zeros_like(self._kind)])
                    self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)], axis=1)
                self._kind[column] = kind
        self._of, self._columns = ids, np.array([self._rows[name] for name in ids], np.intp)
        return self._columns

    def per_type(self) -> dict[str, dict[str, float | int | None]]:
        """The keys of `run --summary` for each type; means are None for a type that nobody had."""
        result = {}
        count = len(self._rows)
        for kind, name in enumerate(TYPE_NAMES):
            of_type = self._sums[:, :count][:, self._kind[:count] == kind]
            total = dict(zip(SUMS, of_type.sum(axis=1).tolist(), strict=True))
            unhurt = int((of_type[SUMS.index("collisions")] == 0).sum())
            lives, steps = of_type.shape[1], int(total["steps"])
            result[name] = {
                "count": lives,
                "mean_speed_mps": _ratio(total["speed"], steps),
                "standing_share": _ratio(total["standing"], steps),
                "collisions": int(total["collisions"]),
                "overlaps": int(total["overlaps"]),
                "survival_steps": _ratio(total["survived"], lives),
                "success_rate": _ratio(unhurt, lives),
                "off_surface_share": _ratio(total["off_surface"], steps),
            }
        return result

    def summary(self, wall_s: float, interval_s: float) -> dict[str, Any]:
        """Everything that was counted, with units in the key names, ready for JSON."""
        agent_steps = int(self._sums[SUMS.index("steps")].sum())
        return {
            "decisions": self.decisions,
            "decision_interval_s": interval_s,
            "wall_s": round(wall_s, 3),
            "real_time_factor": _ratio(self.decisions * interval_s, wall_s),
            "agent_steps": agent_steps,
            "agent_steps_per_s": _ratio(agent_steps, wall_s),
            "lost": len(self.lost),
            "looped": len(self.loops),
            "taken_over": self.taken_over,
            "handed_back": self.handed_back,
            "strayed": self.strayed,
            "arrived": self.arrived,
            "yield_interventions": self.interventions,
            "per_type": self.per_type(),
            "loops": [{"id": road_user, "time_s": round(time, 3)} for road_user, time in self.loops],
            "losses": [{"id": road_user, "time_s": round(time, 3)} for road_user, time in self.lost],
        }


def _ratio(value: float, count: float) -> float | None:
    return round(float(value) / count, 4) if count else None


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
