"""Counts over decisions: the sums behind `run --summary`, `evaluate` and `compare`, and the summary of a run."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.scene.contacts import Pairs, contact_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.simulation.events import Decision

STANDING_SPEED = 0.1
"""m/s; slower counts as standing."""

SUMS = ("steps", "speed", "moving_speed", "standing", "off_surface", "collisions", "overlaps", "survived")
"""Sums of each road user over the decisions in which it is counted; speeds in m/s. `moving_speed`: without the
decisions in which it stands. `survived`: decisions before its first collision."""


class UserSums:
    """SUMS of each road user. All counters of the package add up motion and contacts here."""

    def __init__(self) -> None:
        self._column: dict[str, int] = {}
        """Column of `_sums` by road user."""
        self._type = np.zeros(64, np.int8)
        self._sums = np.zeros((len(SUMS), 64))
        self._ids: tuple[str, ...] = ()
        self._columns = np.zeros(0, np.intp)

    def columns(self, ids: tuple[str, ...], types: NDArray[np.int8]) -> NDArray[np.intp]:
        """The column of each of n road users of these types, (n,); new road users get a new one."""
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
        collisions: NDArray[np.int64],
        overlaps: NDArray[np.int64],
    ) -> None:
        """Count one decision of n road users; the arrays, (n,): off its own surface at the end, contacts that began."""
        columns = self.columns(users.ids, users.type)
        standing = users.speed < STANDING_SPEED
        no_collision = self._sums[SUMS.index("collisions"), columns] + collisions == 0
        moving_speed = np.where(standing, 0.0, users.speed)
        motion = np.ones(len(users)), users.speed, moving_speed, standing, off_surface
        self._sums[:, columns] += np.array([*motion, collisions, overlaps, no_collision], np.float64)

    def of_type(self, kind: int) -> dict[str, Floats]:
        """SUMS of the m road users of a type by name, (m,) each, in the order in which they came."""
        count = len(self._column)
        return dict(zip(SUMS, self._sums[:, :count][:, self._type[:count] == kind], strict=True))


class NewContacts:
    """Finds contacts that begin: pairs in contact after a decision that were not in contact before it.

    `start`: the state before the first decision; None: whatever is in contact after the first decision has begun.
    """

    def __init__(self, start: WorldState | None = None) -> None:
        self._before: list[set[tuple[str, str]]] = [set(), set()]
        self._present: frozenset[str] = frozenset()
        if start is not None:
            self.begun(start)

    def begun(self, world: WorldState, *, newcomers: bool = True) -> tuple[Pairs, Pairs]:
        """Rows of the pairs whose collision began, and of those whose overlap began, (p, 2) each; see
        `contact_pairs`. `newcomers`: also pairs of which one was not there before the decision."""
        result = []
        for kind, pairs in enumerate(contact_pairs(world)):
            ids = [id_pair(world, i, j) for i, j in pairs.tolist()]
            began = [pair not in self._before[kind] and (newcomers or self._present.issuperset(pair)) for pair in ids]
            self._before[kind] = set(ids)
            result.append(pairs[np.array(began, np.bool_)])
        self._present = frozenset(world.ids)
        return result[0], result[1]


def id_pair(world: WorldState, i: int, j: int) -> tuple[str, str]:
    """The ids of two rows, sorted."""
    a, b = world.ids[i], world.ids[j]
    return (a, b) if a < b else (b, a)


def per_road_user(pairs: Pairs, n: int) -> NDArray[np.int64]:
    """How many of the pairs (p, 2) each of the first n rows is in, (n,)."""
    return np.bincount(pairs[pairs < n], minlength=n)


class RunCounters:
    """Counts what happens to learned road users, decision by decision.

    A collision (centres closer than 0.5 m) or an overlap (boxes intersect) with any road user, learned or background,
    counts once when it begins, for each learned road user in it. Survival is the number of decisions before the first
    collision, up to the end of the run or of the takeover.
    """

    def __init__(self, start: WorldState) -> None:
        self.decisions = 0
        self.constraints: Counter[str] = Counter()
        self.wraparounds: list[tuple[str, float]] = []
        self.lost: list[tuple[str, float]] = []
        self.taken_over = self.handed_back = self.returned_to_route = self.arrived = self.interventions = 0
        self._sums = UserSums()
        learned = start.take(np.flatnonzero(start.learned))
        self._sums.columns(learned.ids, learned.type)
        # Road users that start in contact with each other have not collided by driving.
        self._contacts = NewContacts(start)

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
        self.taken_over += len(decision.taken_over)
        self.handed_back += len(decision.handed_back)
        self.returned_to_route += len(decision.returned_to_route)
        self.arrived += len(decision.arrived)
        self.interventions += decision.interventions
        self.constraints.update(decision.constraints)
        collisions, overlaps = self._contacts.begun(world)
        users = world.take(np.arange(n))
        self._sums.add(
            users,
            off_surface=~OWN_SURFACE[users.type, decision.surface],
            collisions=per_road_user(collisions, n),
            overlaps=per_road_user(overlaps, n),
        )

    def per_type(self) -> dict[str, dict[str, float | int | None]]:
        """The keys of `run --summary` for each type; means are None for a type without road users."""
        result = {}
        for kind, name in enumerate(TYPE_NAMES):
            sums = self._sums.of_type(kind)
            count, total = len(sums["steps"]), {key: float(values.sum()) for key, values in sums.items()}
            steps = int(total["steps"])
            result[name] = {
                "count": count,
                "mean_speed_mps": ratio(total["speed"], steps),
                "standing_share": ratio(total["standing"], steps),
                "collisions": int(total["collisions"]),
                "overlaps": int(total["overlaps"]),
                "survival_steps": ratio(total["survived"], count),
                "success_rate": ratio(int((sums["collisions"] == 0).sum()), count),
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
            "wrapped_around": len(self.wraparounds),
            "taken_over": self.taken_over,
            "handed_back": self.handed_back,
            "returned_to_route": self.returned_to_route,
            "arrived": self.arrived,
            "yield_interventions": self.interventions,
            "constraints": dict(self.constraints),
            "per_type": self.per_type(),
            "wraparounds": _timed(self.wraparounds),
            "losses": _timed(self.lost),
        }


def ratio(value: float, count: float, digits: int = 4) -> float | None:
    """`value / count`, rounded; None where nothing was counted."""
    return round(float(value) / count, digits) if count else None


def _timed(events: list[tuple[str, float]]) -> list[dict[str, Any]]:
    return [{"id": road_user, "time_s": round(time, 3)} for road_user, time in events]
