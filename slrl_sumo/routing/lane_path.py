"""One line along lanes, with the places at which it enters junctions."""

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

from slrl_sumo.routing.polyline import Polyline

STOP_LINE = 1.0
"""m before a line at which vehicles stop."""


@dataclass(frozen=True)
class JunctionEntry:
    """Where a path enters a junction, or reaches a waiting position inside of one."""

    stop_line: float
    """m along the path at which vehicles stop."""
    lane: str
    """The lane before it."""
    via: str
    """The internal lane after it."""
    target: str
    """The lane after the junction."""
    exit: float
    """m along the path at which the junction ends."""
    waits: float = math.inf
    """m along the path of the next line in the junction before which vehicles wait; inf where there is none."""

    @cached_property
    def junction(self) -> str:
        """See `junction_of`."""
        return junction_of(self.via)


@dataclass(frozen=True)
class LanePath:
    """One line along lanes, from the begin of the first lane or shortly before it."""

    lanes: tuple[str, ...]
    ends: tuple[float, ...]
    """m along the path at which each lane ends."""
    entries: tuple[JunctionEntry, ...]
    line: Polyline
    route: tuple[str, ...] = ()
    """The route from the edge of the first lane on, where that has other lanes to change to."""
    next_lane: str | None = None
    """The lane beside the first one that brings a vehicle nearer to its route (see LaneGraph.lane_to_change_to)."""

    @cached_property
    def begins(self) -> tuple[float, ...]:
        """m along the path at which each lane begins."""
        return (0.0, *self.ends[:-1])

    @property
    def end(self) -> float:
        """m along the path where it ends."""
        return self.ends[-1]

    def lane_at(self, s: float) -> int:
        """Index of the lane at `s` m along the path."""
        if s < self.ends[0]:
            return 0
        return min(bisect_right(self.ends, s), len(self.lanes) - 1)


def junction_of(lane: str) -> str:
    """What the ids of all internal lanes of a junction begin with."""
    return lane.rsplit("_", 2)[0]
