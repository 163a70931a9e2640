"""How road users drive and walk: speeds, braking, surfaces and overlaps, summed over decision intervals."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.counters import STANDING_SPEED
from slrl_sumo.metrics.lane_keeping import LaneKeeping
from slrl_sumo.scene.contacts import overlapping_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.network import Network

HARD_BRAKING = -4.5
"""m/s²."""
SHRUNK = 0.1
"""m all round by which boxes are smaller in the second count of overlaps: a touch is not one."""
SMALLEST = 0.01
"""m; no box is made smaller than this."""


@dataclass
class Sums:
    """Of one road user type, or of all."""

    steps: int = 0
    speed: float = 0.0
    """m/s, added up."""
    standing: int = 0
    off_surface: int = 0
    changes: int = 0
    """Steps that followed one of the same road user: those whose acceleration is known."""
    hard_braking: int = 0
    overlaps: int = 0
    overlaps_background: int = 0
    overlaps_shrunk: int = 0

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def record(self) -> dict[str, Any]:
        """Shares and means (None without steps) and counts, ready for JSON."""
        return {
            "steps": self.steps,
            "mean_speed_mps": _ratio(self.speed, self.steps),
            "standing_share": _ratio(self.standing, self.steps),
            "off_surface_share": _ratio(self.off_surface, self.steps),
            "hard_braking_share": _ratio(self.hard_braking, self.changes),
            "overlaps": self.overlaps,
            "overlaps_background": self.overlaps_background,
            "overlaps_shrunk": self.overlaps_shrunk,
        }


class DrivingStats:
    """Watches some road users of a scene; call `add` after every decision interval.

    Overlaps are pairs of boxes that intersect and did not in the interval before, with at least one of those watched:
    each pair counts once in a run. A pair of two types counts for both, and once for all. Who is taken over while it
    overlaps already has not driven into that.
    """

    def __init__(self, roadmap: RoadMap, network: Network) -> None:
        self.lanes = LaneKeeping(network)
        self.paths: dict[str, list[tuple[float, float, float]]] = {}
        """x, y (m) and speed (m/s) of each car that was watched, one for each interval."""
        self._roadmap = roadmap
        self._sums = [Sums() for _ in TYPE_NAMES]
        self._speed: dict[str, float] = {}
        self._touching: tuple[set[tuple[str, str]], ...] = (set(), set())
        self._counted: tuple[set[tuple[str, str]], ...] = (set(), set())
        self._pairs = Sums()

    def add(self, world: WorldState, who: frozenset[str]) -> None:
        """Count the road users `who` of `world`, the state of everybody at the end of the interval."""
        rows = np.array([i for i, road_user in enumerate(world.ids) if road_user in who], np.intp)
        users = world.take(rows)
        off = ~OWN_SURFACE[users.type, self._roadmap.surface_at(users.x, users.y)]
        before, self._speed = self._speed, dict(zip(users.ids, users.speed.tolist(), strict=True))
        for i, road_user in enumerate(users.ids):
            sums, speed = self._sums[users.type[i]], float(users.speed[i])
            sums.steps += 1
            sums.speed += speed
            sums.standing += speed < STANDING_SPEED
            sums.off_surface += bool(off[i])
            if road_user in before:
                sums.changes += 1
                sums.hard_braking += (speed - before[road_user]) / DECISION_INTERVAL < HARD_BRAKING
            if users.type[i] == RoadUserType.CAR:
                self.paths.setdefault(road_user, []).append((float(users.x[i]), float(users.y[i]), speed))
        self.lanes.add(users.take(np.flatnonzero(users.type == RoadUserType.CAR)))
        self._overlaps(world, who, 0)
        self._overlaps(replace(world, length=_shrunk(world.length), width=_shrunk(world.width)), who, 1)

    def record(self) -> dict[str, dict[str, Any]]:
        """What was counted by type name and for "all", ready for JSON; cars also have how they keep to their lane."""
        whole = sum(self._sums, Sums())
        pairs = self._pairs
        whole = replace(
            whole,
            overlaps=pairs.overlaps,
            overlaps_background=pairs.overlaps_background,
            overlaps_shrunk=pairs.overlaps_shrunk,
        )
        result = {name: sums.record() for name, sums in zip(TYPE_NAMES, self._sums, strict=True)}
        result["all"] = whole.record()
        lanes, distances = self.lanes, np.array(self.lanes.distances)
        result["car"] |= {
            "lane_distance_mean_m": round(float(distances.mean()), 4) if len(distances) else None,
            "lane_distance_p95_m": round(float(np.percentile(distances, 95)), 4) if len(distances) else None,
            "sways_per_100_m": _ratio(100.0 * lanes.sways, lanes.metres),
            "against_share": _ratio(lanes.against, len(distances)),
        }
        return result

    def _overlaps(self, world: WorldState, who: frozenset[str], which: int) -> None:
        now = set()
        for i, j in overlapping_pairs(world).tolist():
            pair = (min(world.ids[i], world.ids[j]), max(world.ids[i], world.ids[j]))
            now.add(pair)
            ours = [row for row in (i, j) if world.ids[row] in who]
            if not ours or pair in self._touching[which] or pair in self._counted[which]:
                continue
            self._counted[which].add(pair)
            for sums in [self._pairs, *(self._sums[kind] for kind in {int(world.type[row]) for row in ours})]:
                if which:
                    sums.overlaps_shrunk += 1
                else:
                    sums.overlaps += 1
                    sums.overlaps_background += len(ours) == 1
        self._touching[which].clear()
        self._touching[which].update(now)


def _shrunk(side: Floats) -> Floats:
    return np.maximum(side - 2.0 * SHRUNK, SMALLEST)


def _ratio(value: float, count: float) -> float | None:
    return round(float(value) / count, 5) if count else None
