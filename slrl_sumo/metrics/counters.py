"""Counts over decisions: the sums behind `run --summary`, `evaluate` and `compare`, and the summary of a run."""

from collections import Counter
from collections.abc import Iterable
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.encounters import ALL, EncounterCounts, per_road_user
from slrl_sumo.metrics.traffic.density import Density
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.excluded import unseen_notices

MOST_REFUSALS = 100
"""Greatest number of refused road users in a summary: each has a message of SUMO."""

SUMS = ("steps", "speed", "moving_speed", "standing", "off_surface", "left_surface", "collisions", "survived")
"""Sums of each road user over its counted decisions; speeds in m/s. `moving_speed`: without decisions at a stand.
`left_surface`: more than 1 m off its own surfaces. `survived`: decisions before its first collision."""


class UserSums:
    """SUMS of each road user. All counters of the package use this class for motion and contacts."""

    def __init__(self) -> None:
        self._column: dict[str, int] = {}
        """Column of `_sums` by road user."""
        self._type = np.zeros(64, np.int8)
        self._sums = np.zeros((len(SUMS), 64))
        self._ids: tuple[str, ...] = ()
        self._columns = np.zeros(0, np.intp)

    def columns(self, ids: tuple[str, ...], types: NDArray[np.int8]) -> NDArray[np.intp]:
        """The column of each of n road users of these types, (n,); new road users get a new column."""
        if ids == self._ids:
            return self._columns
        for name, kind in zip(ids, types.tolist(), strict=True):
            if name not in self._column:
                column = self._column[name] = len(self._column)
                if column == len(self._type):
                    self._type = np.concatenate([self._type, np.zeros_like(self._type)])
                    self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)], axis=1)
                self._type[column] = kind
        self._ids, self._columns = ids, np.array([self._column[name] for name in ids], np.intp)
        return self._columns

    def add(
        self,
        users: WorldState,
        *,
        off_surface: NDArray[np.bool_],
        left_surface: NDArray[np.bool_],
        collisions: NDArray[np.int64],
    ) -> None:
        """Count one decision of n road users.

        Arrays (n,): off its own surfaces at the end, more than 1 m off them, and number of collisions that began.
        """
        columns = self.columns(users.ids, users.type)
        standing = users.speed < STANDING_SPEED
        no_collision = self._sums[SUMS.index("collisions"), columns] + collisions == 0
        moving_speed = np.where(standing, 0.0, users.speed)
        motion = np.ones(len(users)), users.speed, moving_speed, standing
        self._sums[:, columns] += np.array([*motion, off_surface, left_surface, collisions, no_collision], np.float64)

    def ids_of_type(self, kind: int) -> list[str]:
        """The road users of a type, (m,), in the order of their first decision."""
        return [user for user, column in self._column.items() if self._type[column] == kind]

    def of_type(self, kind: int) -> dict[str, Floats]:
        """SUMS of the m road users of a type by name, (m,) each, in the order of their first decision."""
        count = len(self._column)
        return dict(zip(SUMS, self._sums[:, :count][:, self._type[:count] == kind], strict=True))


class RunCounters:
    """Counts of learned road users, updated at each decision.

    Collisions and near misses count with any road user, learned or background: see metrics.encounters. Survival is the
    number of decisions before the first collision, up to the end of the run or of the takeover. A success is a learned
    road user that reached the end of its trip, of its takeover or of the run without a collision, without leaving its
    own surfaces by more than 1 m, and without being lost.
    """

    def __init__(self, start: WorldState, levels: Levels = FLAT, exclude: Iterable[str] = ()) -> None:
        """`start`: all road users before the first decision. `exclude`: ids of excluded road users."""
        self.decisions = 0
        self.constraints: Counter[str] = Counter()
        self.wraparounds: list[tuple[str, float]] = []
        self.lost: list[tuple[str, float]] = []
        self.refused: dict[str, tuple[float, str]] = {}
        self.left_to_sumo: dict[str, str] = {}
        """Road users that could not be taken over, with the reason."""
        self.taken_over = self.handed_back = self.returned_to_route = self.arrived = self.interventions = 0
        self.under_way = 0
        self._sums = UserSums()
        learned = start.take(np.flatnonzero(start.learned))
        self._sums.columns(learned.ids, learned.type)
        self._encounters = EncounterCounts(start, levels=levels)
        self._density = Density(start)
        self._not_seen = set(exclude).difference(start.ids)

    def add(self, decision: Decision) -> None:
        """Count one decision interval."""
        step = decision.steps[-1]
        world = step.world
        n = len(decision.surface)
        self.decisions += 1
        self.wraparounds += [
            (world.ids[row], decision.steps[0].time) for row in np.flatnonzero(decision.wrapped_around)
        ]
        self.lost += [(world.ids[row], step.time) for row in np.flatnonzero(decision.lost)]
        for road_user, reason in decision.refused:
            self.refused.setdefault(road_user, (step.time, reason))
        self.left_to_sumo.update(decision.left_to_sumo)
        for road_user in decision.taken_over:
            self.left_to_sumo.pop(road_user, None)
        self.taken_over += len(decision.taken_over)
        self.handed_back += len(decision.handed_back)
        self.returned_to_route += len(decision.returned_to_route)
        self.arrived += len(decision.arrived)
        self.under_way = decision.under_way
        self.interventions += decision.interventions
        self.constraints.update(decision.constraints)
        self._density.add(world)
        if self._not_seen:
            self._not_seen.difference_update(world.ids)
        collisions = self._encounters.add(world, np.arange(len(world)) < n)
        users = world.take(np.arange(n))
        self._sums.add(
            users,
            off_surface=~OWN_SURFACE[users.type, decision.surface],
            left_surface=decision.left_surface,
            collisions=per_road_user(collisions, n),
        )

    def per_type(self) -> dict[str, dict[str, float | int | None]]:
        """The keys of `run --summary` for each type; means are None for a type without road users."""
        result = {}
        lost = {name for name, _ in self.lost}
        for kind, name in enumerate(TYPE_NAMES):
            sums, ids = self._sums.of_type(kind), self._sums.ids_of_type(kind)
            count, total = len(sums["steps"]), {key: float(values.sum()) for key, values in sums.items()}
            steps = int(total["steps"])
            kept = np.array([user not in lost for user in ids], np.bool_)
            success = (sums["collisions"] == 0) & (sums["left_surface"] == 0) & kept
            result[name] = {
                "count": count,
                "mean_speed_mps": ratio(total["speed"], steps),
                "standing_share": ratio(total["standing"], steps),
                "collisions": int(self._encounters.collisions[kind]),
                "near_misses": int(self._encounters.near_misses[kind]),
                "survival_steps": ratio(total["survived"], count),
                "success_rate": ratio(int(success.sum()), count),
                "off_surface_share": ratio(total["off_surface"], steps),
            }
        return result

    def summary(self, wall_s: float, interval_s: float) -> dict[str, Any]:
        """All counts, with units in the key names, ready for JSON."""
        agent_steps = sum(int(self._sums.of_type(kind)["steps"].sum()) for kind in range(len(TYPE_NAMES)))
        return {
            "decisions": self.decisions,
            "decision_interval_s": interval_s,
            "wall_s": round(wall_s, 3),
            "real_time_factor": ratio(self.decisions * interval_s, wall_s),
            "agent_steps": agent_steps,
            "agent_steps_per_s": ratio(agent_steps, wall_s),
            "lost": len(self.lost),
            "refused": len(self.refused),
            "wrapped_around": len(self.wraparounds),
            "taken_over": self.taken_over,
            "left_to_sumo": dict(Counter(self.left_to_sumo.values()).most_common()),
            "handed_back": self.handed_back,
            "returned_to_route": self.returned_to_route,
            "arrived": self.arrived,
            "under_way": self.under_way,
            "collisions": int(self._encounters.collisions[ALL]),
            "near_misses": int(self._encounters.near_misses[ALL]),
            "yield_interventions": self.interventions,
            "constraints": dict(self.constraints),
            "per_type": self.per_type(),
            "wraparounds": _timed(self.wraparounds),
            "losses": _timed(self.lost),
            "refusals": [
                {"id": road_user, "time_s": round(time, 3), "reason": reason}
                for road_user, (time, reason) in islice(self.refused.items(), MOST_REFUSALS)
            ],
        }

    def notices(self) -> list[str]:
        """Notices at the end of a run: excluded ids that never appeared, and a jam of the traffic (see `Density`)."""
        notices = unseen_notices(self._not_seen)
        if (jam := self._density.jam()) is not None:
            notices.append(jam)
        return notices


def ratio(value: float, count: float, digits: int = 4) -> float | None:
    """`value / count`, rounded; None if `count` is 0."""
    return round(float(value) / count, digits) if count else None


def _timed(events: list[tuple[str, float]]) -> list[dict[str, Any]]:
    return [{"id": road_user, "time_s": round(time, 3)} for road_user, time in events]
