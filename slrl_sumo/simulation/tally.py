"""The summary of a run: counts and means over all decisions of all learned road users."""

from dataclasses import dataclass
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


@dataclass
class _Life:
    """What happened to one road user while it was learned; sums over its decisions."""

    kind: int
    steps: int = 0
    speed: float = 0.0
    standing: int = 0
    off_surface: int = 0
    collisions: int = 0
    overlaps: int = 0
    survived: int = 0


class Tally:
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
        self._lives = {start.ids[i]: _Life(int(start.type[i])) for i in np.flatnonzero(start.learned)}
        # Road users that start in contact with each other have not collided by driving.
        self._colliding = _keys(colliding_pairs(start), start)
        self._overlapping = _keys(overlapping_pairs(start), start)

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
        colliding, overlapping = colliding_pairs(world), overlapping_pairs(world)
        collisions = _begun(colliding, world, self._colliding, n)
        overlaps = _begun(overlapping, world, self._overlapping, n)
        self._colliding, self._overlapping = _keys(colliding, world), _keys(overlapping, world)
        off_surface = ~OWN_SURFACE[world.type[:n], decision.surface]
        for row in range(n):
            life = self._lives.setdefault(world.ids[row], _Life(int(world.type[row])))
            life.steps += 1
            life.speed += float(world.speed[row])
            life.standing += bool(world.speed[row] < STANDING_SPEED)
            life.off_surface += bool(off_surface[row])
            life.collisions += int(collisions[row])
            life.overlaps += int(overlaps[row])
            life.survived += life.collisions == 0

    def per_type(self) -> dict[str, dict[str, float | int | None]]:
        """The keys of `run --summary` for each type; means are None for a type that nobody had."""
        result = {}
        for kind, name in enumerate(TYPE_NAMES):
            lives = [life for life in self._lives.values() if life.kind == kind]
            steps = sum(life.steps for life in lives)
            result[name] = {
                "count": len(lives),
                "mean_speed_mps": _ratio(sum(life.speed for life in lives), steps),
                "standing_share": _ratio(sum(life.standing for life in lives), steps),
                "collisions": sum(life.collisions for life in lives),
                "overlaps": sum(life.overlaps for life in lives),
                "survival_steps": _ratio(sum(life.survived for life in lives), len(lives)),
                "success_rate": _ratio(sum(life.collisions == 0 for life in lives), len(lives)),
                "off_surface_share": _ratio(sum(life.off_surface for life in lives), steps),
            }
        return result

    def summary(self, wall_s: float, interval_s: float) -> dict[str, Any]:
        """Everything that was counted, with units in the key names, ready for JSON."""
        agent_steps = sum(life.steps for life in self._lives.values())
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
