"""Lane changes that a route needs from each lane of its first edge.

A lane change needs time. A lane that leaves the route soon is left before its last edges, and a lane that continues
along the route for long is as good as the lane that the route needs at its end. This holds for the inner lanes of
roundabouts: vehicles leave them one or two edges before their exit.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from slrl_sumo.sumo.network.lanes import Lane, lane_index
from slrl_sumo.sumo.network.links import internal_lanes

MOST_EDGES = 12
"""Number of edges of a route that the choice of a lane considers."""
CHANGE = 4.3
"""Time (s) at the speed limit that a lane change needs: 60 m at 13.9 m/s, 36 m on a ring at 8.3 m/s."""
MOST_ROUTES = 5_000


@dataclass(frozen=True)
class LaneChanges:
    """Numbers of lane changes that a route needs from the lanes of its first edge.

    A change counts as more than one if the lane that it leaves continues along the route for less than CHANGE.
    """

    lanes: Sequence[str]
    """Lanes of the edge, from the kerb on."""
    after: Mapping[str, float]
    """Lane changes after the edge, by lane; lanes that do not continue along the route are left out."""
    total: Mapping[str, float]
    """Lane changes on the edge and after it, by lane; lanes closed to the vehicle class are left out."""
    _towards: dict[str, str | None] = field(default_factory=dict)

    def towards(self, lane: str) -> str | None:
        """The neighbouring lane that brings a vehicle nearer to its route.

        None where the vehicle may stay, or where no lane of the edge continues along the route.
        """
        if lane not in self._towards:
            self._towards[lane] = self._find(lane)
        return self._towards[lane]

    def _find(self, lane: str) -> str | None:
        here = self.lanes.index(lane)
        costs = [abs(here - i) + self.after.get(other, math.inf) for i, other in enumerate(self.lanes)]
        best = min(range(len(costs)), key=lambda i: (costs[i], abs(here - i)))
        if best == here or not math.isfinite(costs[best]):
            return None
        step = self.lanes[here + (1 if best > here else -1)]
        return step if step in self.total else None


class _Along(NamedTuple):
    """A vehicle that stays on its lane as long as the lane continues along the route, and then changes lanes."""

    changes: int
    """Lane changes where the lane leaves the route; 0 if it never does."""
    time: float
    """Time (s), at the speed limit, until the lane leaves the route; inf if it never does."""
    rest: float
    """Lane changes after these."""

    @property
    def total(self) -> float:
        """Lane changes, see `LaneChanges`."""
        return self.changes * max(CHANGE / max(self.time, 0.1), 1.0) + self.rest


class RouteLaneChanges:
    """The lane changes that routes need in a network, each route computed on first use.

    `of_edge`: ids of the lanes of each edge, from the kerb on; `links`: target and internal lane of each link of a
    lane. `lanes` may change, see `clear`.
    """

    def __init__(
        self,
        lanes: Mapping[str, Lane],
        of_edge: Mapping[str, list[str]],
        links: Callable[[str], list[tuple[str, str]]],
    ) -> None:
        self._lanes, self._of_edge, self._links = lanes, of_edge, links
        self._known: OrderedDict[tuple[tuple[str, ...], str], LaneChanges] = OrderedDict()

    def clear(self) -> None:
        """Forget all routes, because permissions have changed."""
        self._known.clear()

    def __call__(self, edges: tuple[str, ...], vehicle_class: str) -> LaneChanges:
        """The lane changes of a vehicle class along a route `edges`, of which the first MOST_EDGES count."""
        key = (edges[:MOST_EDGES], vehicle_class)
        changes = self._known.get(key)
        if changes is None:
            if len(self._known) >= MOST_ROUTES:
                self._known.popitem(last=False)
            changes = self._known[key] = self._along(*key)
        return changes

    def _along(self, edges: tuple[str, ...], vehicle_class: str) -> LaneChanges:
        along: dict[str, _Along] = {}
        stays: dict[str, _Along] = {}
        for following, edge in enumerate(reversed(edges)):
            admitted = [lane for lane in self._of_edge.get(edge, ()) if self._lanes[lane].admits(vehicle_class)]
            if following:
                stays = {lane: one for lane in admitted if (one := self._after(lane, along)) is not None}
            else:
                stays = {lane: _Along(0, math.inf, 0.0) for lane in admitted}
            along = {lane: self._from(lane, stays) for lane in admitted if stays}
        return LaneChanges(
            self._of_edge.get(edges[0], []),
            {lane: one.total for lane, one in stays.items()},
            {lane: one.total for lane, one in along.items()},
        )

    def _from(self, lane: str, stays: Mapping[str, _Along]) -> _Along:
        """The best way from the begin of a lane: to stay on it, or to change on its edge. `stays`: after the edge."""
        time, here = self._time(lane), lane_index(lane)
        found = [
            one._replace(time=time + one.time)
            if other == lane
            else _Along(abs(lane_index(other) - here), time, one.total)
            for other, one in stays.items()
        ]
        return min(found, key=lambda one: one.total)

    def _after(self, lane: str, along: Mapping[str, _Along]) -> _Along | None:
        """The best way from the end of a lane on; None if it does not continue. `along`: from the next edge on."""
        reached = [
            along[target]._replace(time=along[target].time + self._time_through(via))
            for target, via in self._links(lane)
            if target in along
        ]
        return min(reached, key=lambda one: one.total, default=None)

    def _time(self, lane: str) -> float:
        """Time (s) on a lane at the speed limit."""
        return self._lanes[lane].length / self._lanes[lane].max_speed

    def _time_through(self, via: str) -> float:
        """Time (s) through a junction on the way that begins with the internal lane `via`; 0 without one."""
        return sum((self._time(lane) for lane in internal_lanes(via, self._links)), 0.0)
