"""Paths along lanes, with the positions at which they enter junctions."""

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cache, cached_property

from slrl_sumo.routing.polyline import Polyline

STOP_LINE = 1.0
"""Distance (m) before a line at which vehicles stop."""


@dataclass(frozen=True)
class JunctionEntry:
    """The place where a path enters a junction, or reaches a waiting position inside a junction."""

    stop_line: float
    """Position (m along the path) of the line before which vehicles stop."""
    lane: str
    """Lane before the line."""
    via: str
    """Internal lane after the line."""
    target: str
    """Lane after the junction."""
    exit: float
    """Position (m along the path) at which the junction ends."""
    waits: float = math.inf
    """Position (m along the path) of the next line inside the junction before which vehicles wait; inf without one."""

    @cached_property
    def junction(self) -> str:
        """See `junction_of`."""
        return junction_of(self.via)

    @cached_property
    def link(self) -> tuple[str, str, str]:
        """Lane before the line, lane after the junction, and internal lane after the line."""
        return self.lane, self.target, self.via


@dataclass(frozen=True)
class LanePath:
    """One line along lanes, from the begin of the first lane or shortly before it."""

    lanes: tuple[str, ...]
    ends: tuple[float, ...]
    """Position (m along the path) at which each lane ends."""
    entries: tuple[JunctionEntry, ...]
    line: Polyline
    route: tuple[str, ...] = ()
    """Route from the edge of the first lane on, if that edge has other lanes; else ()."""
    next_lane: str | None = None
    """Lane beside the first lane that brings a vehicle nearer to its route, see LaneGraph.lane_to_change_to."""

    @cached_property
    def begins(self) -> tuple[float, ...]:
        """Position (m along the path) at which each lane begins."""
        return (0.0, *self.ends[:-1])

    @property
    def end(self) -> float:
        """Position (m along the path) of the end."""
        return self.ends[-1]

    def lane_at(self, s: float) -> int:
        """Index of the lane at `s` m along the path."""
        if s < self.ends[0]:
            return 0
        return min(bisect_right(self.ends, s), len(self.lanes) - 1)


@cache
def junction_of(lane: str) -> str:
    """Common prefix of the ids of all internal lanes of a junction."""
    return lane.rsplit("_", 2)[0]
