"""Outcomes of one episode: survival, speed, standing, contacts and surfaces of its road users."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.counters import NewContacts, UserSums, per_road_user
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TypeOutcome:
    """The road users of one type in one episode: per road user, and sums over all their decisions."""

    type: str
    present: tuple[int, ...]
    """Decisions in which each road user was present."""
    survived: tuple[int, ...]
    """Decisions of each before its first collision; equal to `present` without one."""
    speed_sum: float
    """m/s, added up over all decisions of all road users."""
    moving_speed_sum: float
    """The same without the decisions in which they stood."""
    standing: int
    """Decisions at whose end a road user was slower than 0.1 m/s."""
    collisions: int
    overlaps: int
    off_surface: int | None
    """Decisions at whose end a road user was off its own surface; None where the surfaces are unknown."""

    @property
    def steps(self) -> int:
        """Decisions of all road users together."""
        return sum(self.present)


class Outcomes:
    """Counts what happens to some road users, decision by decision, by the definitions of `run --summary`.

    A contact (a collision: centres closer than 0.5 m; an overlap: boxes intersect) with any road user counts once when
    it begins, for each counted road user in it. Contacts that exist when one of the two appears do not count: SUMO
    inserts pedestrians on top of each other, and recorded groups enter the picture side by side.

    `start`: all road users before the first decision.
    """

    def __init__(self, start: WorldState) -> None:
        self._sums = UserSums()
        self._contacts = NewContacts(start)
        self._surfaces_known = True

    def add(self, world: WorldState, counted: Mask, off_surface: Mask | None) -> None:
        """Count one decision.

        `world`: all n road users at its end; `counted`: which of them to count, (n,); `off_surface`: which are off
        their own surface, (n,), or None where the surfaces are unknown.
        """
        n, rows = len(world), np.flatnonzero(counted)
        contacts = self._contacts.begun(world, newcomers=False)
        collisions, overlaps = (per_road_user(pairs, n)[rows] for pairs in contacts)
        off = np.zeros(len(rows), np.bool_) if off_surface is None else off_surface[rows]
        self._sums.add(world.take(rows), off_surface=off, collisions=collisions, overlaps=overlaps)
        self._surfaces_known &= off_surface is not None

    def per_type(self) -> tuple[TypeOutcome, ...]:
        """The counts of each type that has road users."""
        result = []
        for kind, name in enumerate(TYPE_NAMES):
            sums = self._sums.of_type(kind)
            if not len(sums["steps"]):
                continue
            total = {key: values.sum() for key, values in sums.items()}
            outcome = TypeOutcome(
                type=name,
                present=tuple(sums["steps"].astype(int).tolist()),
                survived=tuple(sums["survived"].astype(int).tolist()),
                speed_sum=float(total["speed"]),
                moving_speed_sum=float(total["moving_speed"]),
                standing=int(total["standing"]),
                collisions=int(total["collisions"]),
                overlaps=int(total["overlaps"]),
                off_surface=int(total["off_surface"]) if self._surfaces_known else None,
            )
            result.append(outcome)
        return tuple(result)


def survival_counts(present: Floats, survived: Floats, steps: int) -> NDArray[np.int64]:
    """For each decision up to `steps`: how many of m road users, arrays (m,), were present without an earlier
    collision, and how many of these collided in it, (2, steps). Counts of several episodes add up."""
    step = np.arange(1, steps + 1)[:, None]
    there = present >= step
    return np.stack([(there & (survived >= step - 1)).sum(1), (there & (survived == step - 1)).sum(1)])


def mean_survival(counts: NDArray[np.int64]) -> float:
    """Mean number of decisions before the first collision, from `survival_counts` of at least one road user.

    Where all road users are present in all decisions, it is the plain mean of `survived`. A road user that leaves
    earlier without a collision (SUMO's and recorded ones do) counts while it is present: the result is the area under
    the Kaplan-Meier estimate (Kaplan and Meier 1958, doi:10.1080/01621459.1958.10501452) of the share without a
    collision.
    """
    alive, area = 1.0, 0.0
    for at_risk, hit in counts.T.tolist():
        if at_risk:
            alive *= 1.0 - hit / at_risk
        area += alive
    return area
