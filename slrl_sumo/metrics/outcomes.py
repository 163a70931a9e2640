"""What happened to road users in one episode: survival, speed, standing, contacts, surfaces."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.counters import STANDING_SPEED
from slrl_sumo.scene.contacts import Pairs, contact_pairs, ids_of
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TypeOutcome:
    """The road users of one type in one episode: per road user, and sums over all their decisions."""

    type: str
    present: tuple[int, ...]
    """Decisions for which each road user was there."""
    survived: tuple[int, ...]
    """Decisions of each before its first collision; as many as `present` where there was none."""
    speed_sum: float
    """m/s, added up over all decisions of all road users."""
    moving_speed_sum: float
    """The same over those decisions in which they did not stand."""
    standing: int
    """Decisions at whose end a road user was slower than 0.1 m/s."""
    collisions: int
    overlaps: int
    off_surface: int | None
    """Decisions at whose end a road user was off its own surface; None where nobody knows the surfaces."""

    @property
    def steps(self) -> int:
        """Decisions of all road users together."""
        return sum(self.present)


@dataclass
class _Life:
    kind: int
    present: int = 0
    survived: int = 0
    hit: bool = False


@dataclass
class _Sums:
    speed: float = 0.0
    moving_speed: float = 0.0
    standing: int = 0
    collisions: int = 0
    overlaps: int = 0
    off_surface: int = 0


@dataclass
class Outcomes:
    """Counts what happens to some road users, decision by decision, by the definitions of `run --summary`.

    A contact (a collision: centres closer than 0.5 m; an overlap: boxes intersect) with anybody counts once when it
    begins, for each counted road user in it. Contacts that are there when either of the two appears do not count:
    SUMO sets its pedestrians down on each other, and recorded groups walk into the picture side by side.
    """

    start: WorldState
    """Everybody before the first decision."""
    _lives: dict[str, _Life] = field(default_factory=dict)
    _sums: list[_Sums] = field(default_factory=lambda: [_Sums() for _ in TYPE_NAMES])
    _surfaces_known: bool = True

    def __post_init__(self) -> None:
        self._there = frozenset(self.start.ids)
        self._colliding, self._overlapping = (ids_of(pairs, self.start) for pairs in contact_pairs(self.start))

    def add(self, world: WorldState, counted: Mask, off_surface: Mask | None) -> None:
        """Count one decision: everybody at its end, n road users, whom to count (n,), and who of all of them is off
        its own surface (n,), None where nobody knows."""
        colliding, overlapping = contact_pairs(world)
        collisions = self._begun(colliding, world, self._colliding)
        overlaps = self._begun(overlapping, world, self._overlapping)
        self._colliding, self._overlapping = ids_of(colliding, world), ids_of(overlapping, world)
        self._there = frozenset(world.ids)
        for row in np.flatnonzero(counted).tolist():
            life = self._lives.setdefault(world.ids[row], _Life(int(world.type[row])))
            life.present += 1
            life.hit |= bool(collisions[row])
            life.survived += not life.hit
        standing = world.speed < STANDING_SPEED
        for kind, sums in enumerate(self._sums):
            mine = counted & (world.type == kind)
            sums.speed += float(world.speed[mine].sum())
            sums.moving_speed += float(world.speed[mine & ~standing].sum())
            sums.standing += int((mine & standing).sum())
            sums.collisions += int(collisions[mine].sum())
            sums.overlaps += int(overlaps[mine].sum())
            if off_surface is not None:
                sums.off_surface += int((mine & off_surface).sum())
        self._surfaces_known &= off_surface is not None

    def per_type(self) -> tuple[TypeOutcome, ...]:
        """What was counted, for each type that somebody had."""
        result = []
        for kind, sums in enumerate(self._sums):
            lives = [life for life in self._lives.values() if life.kind == kind]
            if lives:
                outcome = TypeOutcome(
                    type=TYPE_NAMES[kind],
                    present=tuple(life.present for life in lives),
                    survived=tuple(life.survived for life in lives),
                    speed_sum=sums.speed,
                    moving_speed_sum=sums.moving_speed,
                    standing=sums.standing,
                    collisions=sums.collisions,
                    overlaps=sums.overlaps,
                    off_surface=sums.off_surface if self._surfaces_known else None,
                )
                result.append(outcome)
        return tuple(result)

    def _begun(self, pairs: Pairs, world: WorldState, before: set[tuple[str, str]]) -> NDArray[np.int64]:
        """New contacts of each road user, (n,)."""
        count = np.zeros(len(world), np.int64)
        for i, j in pairs.tolist():
            a, b = world.ids[i], world.ids[j]
            known = a in self._there and b in self._there
            if known and (a, b) not in before and (b, a) not in before:
                count[[i, j]] += 1
        return count


def survival_counts(present: Floats, survived: Floats, steps: int) -> NDArray[np.int64]:
    """For each decision up to `steps`, how many of m road users, arrays (m,), were there without a collision before,
    and how many of these collided in it: (2, steps). Counts of several episodes add up."""
    step = np.arange(1, steps + 1)[:, None]
    there = present >= step
    return np.stack([(there & (survived >= step - 1)).sum(1), (there & (survived == step - 1)).sum(1)])


def mean_survival(counts: NDArray[np.int64]) -> float:
    """Mean number of decisions before the first collision, from `survival_counts` of at least one road user.

    Where everybody is there for all decisions, that is the plain mean of `survived`. Who leaves earlier without a
    collision (SUMO's and recorded road users do) counts for as long as it was there: the area under the Kaplan-Meier
    estimate (Kaplan and Meier 1958, doi:10.1080/01621459.1958.10501452) of the share that has not collided.
    """
    alive, area = 1.0, 0.0
    for at_risk, hit in counts.T.tolist():
        if at_risk:
            alive *= 1.0 - hit / at_risk
        area += alive
    return area
