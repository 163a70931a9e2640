"""Outcomes of one episode: success, speed, standing, collisions and surfaces of its road users.

In addition to the collisions of the package (metrics.encounters), it counts paper collisions (section 4.1): centres
closer than 0.5 m. These appear in tables beside the paper's figures.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.counters import UserSums
from slrl_sumo.metrics.encounters import EncounterCounts, id_pair, per_road_user
from slrl_sumo.scene.contacts import Pairs, colliding_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TypeOutcome:
    """Outcome of the road users of one type in one episode: per road user, and sums over all their decisions."""

    type: str
    present: tuple[int, ...]
    """Number of decisions in which each road user was present."""
    paper_survived: tuple[int, ...]
    """Number of decisions of each road user before its first paper collision; equal to `present` without one."""
    succeeded: int
    """Number of road users without a collision that did not leave their own surfaces by more than 1 m."""
    speed_sum: float
    """Sum of the speeds (m/s) over all decisions of all road users."""
    moving_speed_sum: float
    """The same without decisions at a stand."""
    standing: int
    """Number of decisions with a final speed below 0.1 m/s."""
    collisions: int
    """Number of colliding pairs with at least one of the road users."""
    near_misses: int
    paper_collisions: int
    """Number of paper collisions, counted once for each of the road users in it."""
    off_surface: int | None
    """Number of decisions at whose end a road user was off its own surfaces; None if the surfaces are unknown."""

    @property
    def steps(self) -> int:
        """Total number of decisions of all road users."""
        return sum(self.present)


class Outcomes:
    """Counts of some road users by the definitions of `run --summary`, updated at each decision.

    Paper collisions count as in the paper's tables: once at their begin, for each counted road user. A paper collision
    that exists when a road user appears does not count: SUMO inserts pedestrians into each other, and recorded groups
    enter the picture side by side.

    `start`: all road users before the first decision. `counted`: whether to count each of them, (n,).
    """

    def __init__(self, start: WorldState, counted: Mask) -> None:
        self._sums, self._paper = UserSums(), UserSums()
        self._encounters = EncounterCounts(start, counted)
        self._close = {id_pair(start, i, j) for i, j in colliding_pairs(start).tolist()}
        self._present = frozenset(start.ids)
        self._surfaces_known = True

    def add(self, world: WorldState, counted: Mask, off_surface: Mask | None, left_surface: Mask | None) -> None:
        """Count one decision.

        `world`: all n road users at its end. `counted`: whether to count each of them, (n,). `off_surface`,
        `left_surface`: whether each is off its own surfaces, and more than 1 m off, (n,); None if these are unknown.
        """
        n, rows = len(world), np.flatnonzero(counted)
        users, none = world.take(rows), np.zeros(len(rows), np.bool_)
        off = none if off_surface is None else off_surface[rows]
        left = none if left_surface is None else left_surface[rows]
        collisions = per_road_user(self._encounters.add(world, counted), n)[rows]
        self._sums.add(users, off_surface=off, left_surface=left, collisions=collisions)
        close = per_road_user(self._paper_collisions(world), n)[rows]
        self._paper.add(users, off_surface=none, left_surface=none, collisions=close)
        self._surfaces_known &= off_surface is not None

    def _paper_collisions(self, world: WorldState) -> Pairs:
        """Rows of the pairs whose paper collision began, (p, 2)."""
        pairs = colliding_pairs(world)
        ids = [id_pair(world, i, j) for i, j in pairs.tolist()]
        began = [pair not in self._close and self._present.issuperset(pair) for pair in ids]
        self._close, self._present = set(ids), frozenset(world.ids)
        return pairs[np.array(began, np.bool_)]

    def per_type(self) -> tuple[TypeOutcome, ...]:
        """The counts of each type that has road users."""
        result = []
        for kind, name in enumerate(TYPE_NAMES):
            sums, paper = self._sums.of_type(kind), self._paper.of_type(kind)
            if not len(sums["steps"]):
                continue
            total = {key: values.sum() for key, values in sums.items()}
            outcome = TypeOutcome(
                type=name,
                present=tuple(sums["steps"].astype(int).tolist()),
                paper_survived=tuple(paper["survived"].astype(int).tolist()),
                succeeded=int(((sums["collisions"] == 0) & (sums["left_surface"] == 0)).sum()),
                speed_sum=float(total["speed"]),
                moving_speed_sum=float(total["moving_speed"]),
                standing=int(total["standing"]),
                collisions=int(self._encounters.collisions[kind]),
                near_misses=int(self._encounters.near_misses[kind]),
                paper_collisions=int(paper["collisions"].sum()),
                off_surface=int(total["off_surface"]) if self._surfaces_known else None,
            )
            result.append(outcome)
        return tuple(result)


def survival_counts(present: Floats, survived: Floats, steps: int) -> NDArray[np.int64]:
    """For each decision up to `steps`: number of road users present without an earlier collision, and number of these
    that collided in it, (2, steps).

    `present`, `survived`: of m road users, (m,). Counts of several episodes can be added.
    """
    step = np.arange(1, steps + 1)[:, None]
    there = present >= step
    return np.stack([(there & (survived >= step - 1)).sum(1), (there & (survived == step - 1)).sum(1)])


def mean_survival(counts: NDArray[np.int64]) -> float:
    """Mean number of decisions before the first collision, from `survival_counts` of at least one road user.

    If all road users are present in all decisions, it is the mean of `survived`. A road user that leaves earlier
    without a collision, as background and recorded road users do, counts while it is present: the result is the area
    under the Kaplan-Meier estimate (Kaplan and Meier 1958, doi:10.1080/01621459.1958.10501452) of the share without a
    collision.
    """
    alive, area = 1.0, 0.0
    for at_risk, hit in counts.T.tolist():
        if at_risk:
            alive *= 1.0 - hit / at_risk
        area += alive
    return area
