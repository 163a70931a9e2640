"""The ways of single vehicles along their route: which lane they need, and one line to drive on."""

import math
import random
from bisect import bisect_right
from collections import OrderedDict
from dataclasses import dataclass

from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.lanes import Lane
from slrl_sumo.sumo.links import LaneLinks
from slrl_sumo.sumo.network import Network

MOST_EDGES = 12
"""Edges of a route that are looked at when a lane is chosen."""
MOST_LANES = 30
MOST_TABLES = 5_000
REACH = 150.0
"""m that a way goes on beyond the lane that it begins on, if the route does."""

VIEW = 4.0
"""m beyond its end that a line goes on, so that vehicles see who walks across there."""


@dataclass(frozen=True)
class JunctionEntry:
    """Where a way enters a junction, or its middle where vehicles wait for others to pass first."""

    line: float
    """m along the way at which vehicles stop."""
    lane: str
    """Lane before it."""
    via: str
    """Lane inside the junction after it."""
    target: str
    """Lane after the junction."""
    out: float
    """m along the way where the junction ends."""


@dataclass(frozen=True)
class LanePath:
    """One line along lanes, from the begin of the first one or a bit before it."""

    lanes: tuple[str, ...]
    ends: tuple[float, ...]
    """m along the way at which each lane ends."""
    limits: tuple[float, ...]
    """Speed limit of each lane in m/s."""
    entries: tuple[JunctionEntry, ...]
    line: Polyline

    @property
    def end(self) -> float:
        """m along the way where it ends."""
        return self.ends[-1]

    def lane_at(self, s: float) -> int:
        """Index of the lane at `s`."""
        if s < self.ends[0]:
            return 0
        return min(bisect_right(self.ends, s), len(self.lanes) - 1)


class LaneGraph:
    """Lanes of a loaded network and how they lead on, asked of `api` (libsumo or a TraCI connection) on demand."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.links = LaneLinks(api, network)
        self.lanes = {lane.id: lane for lane in network.lanes}
        self._of_edge: dict[str, list[str]] = {}
        for lane in network.lanes:
            self._of_edge.setdefault(lane.edge, []).append(lane.id)
        for lanes in self._of_edge.values():
            lanes.sort(key=lambda lane: int(lane.rsplit("_", 1)[1]))
        self._tables: OrderedDict[tuple[tuple[str, ...], str], list[dict[str, float]]] = OrderedDict()

    def admits(self, lane: str, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use a lane."""
        return self.lanes[lane].admits(vehicle_class)

    def beside(self, lane: str, vehicle_class: str, edges: tuple[str, ...]) -> str | None:
        """The neighbouring lane to change to, for a route `edges` that begins with the lane's edge; None: stay.

        None too where no lane of the edge leads on.
        """
        lanes = self._of_edge[self.lanes[lane].edge]
        here = lanes.index(lane)
        ahead = self._onward(edges, vehicle_class)
        costs = [abs(here - i) + ahead.get(other, math.inf) for i, other in enumerate(lanes)]
        best = min(range(len(lanes)), key=lambda i: (costs[i], abs(here - i)))
        if best == here or not math.isfinite(costs[best]):
            return None
        step = lanes[here + (1 if best > here else -1)]
        return step if self.admits(step, vehicle_class) else None

    def way(
        self, lane: str, edges: tuple[str, ...], vehicle_class: str, before: list[tuple[float, float]], dice: str = ""
    ) -> LanePath:
        """The way from the begin of `lane` along the route `edges`, which begin after the lane's edge.

        `before`: points that lead to the lane's begin, for the rear of a vehicle that has only just entered it.
        `dice`: without a route (no edges left), continue at random, the same for the same text; '': end there.
        """
        chain = [lane]
        entries: list[tuple[int, str, str, str]] = []
        onward, length = edges, 0.0
        luck = random.Random(dice) if dice else None
        while length < REACH and len(chain) < MOST_LANES:
            here = chain[-1]
            link = self._choose(here, onward, vehicle_class, luck)
            if link is None:
                break
            target, via = link
            if via:
                entries.append((len(chain) - 1, here, via, target))
            chain.append(via or target)
            length += self.lanes[chain[-1]].length
            if not via and onward and self.lanes[target].edge == onward[0]:
                onward = onward[1:]
        return _drawn([self.lanes[i] for i in chain], entries, before)

    def _choose(
        self, lane: str, onward: tuple[str, ...], vehicle_class: str, luck: random.Random | None
    ) -> tuple[str, str] | None:
        links = [link for link in self.links(lane) if self.admits(link[0], vehicle_class)]
        if self.lanes[lane].internal:
            # A lane inside a junction leads to one lane, perhaps over another one inside.
            return next((k for k in links if not onward or self.lanes[k[0]].edge == onward[0]), None)
        if not onward:
            walkable = [k for k in links if k[0] in self.lanes and not k[0].startswith(":")]
            return luck.choice(walkable) if luck and walkable else None
        links = [link for link in links if self.lanes[link[0]].edge == onward[0]]
        costs = self._lane_costs(onward, vehicle_class)
        return min(links, key=lambda k: costs.get(k[0], math.inf), default=None)

    def _onward(self, edges: tuple[str, ...], vehicle_class: str) -> dict[str, float]:
        """For each lane of edges[0]: how many lane changes follow after it; lanes that do not lead on are left out."""
        return self._table(edges, vehicle_class)[0]

    def _lane_costs(self, edges: tuple[str, ...], vehicle_class: str) -> dict[str, float]:
        """For each lane of edges[0]: how many lane changes are needed on it and after it."""
        return self._table(edges, vehicle_class)[1]

    def _table(self, edges: tuple[str, ...], vehicle_class: str) -> list[dict[str, float]]:
        key = (edges[:MOST_EDGES], vehicle_class)
        table = self._tables.get(key)
        if table is not None:
            return table
        following: dict[str, float] = {}
        onward: dict[str, float] = {}
        for i in range(len(key[0]) - 1, -1, -1):
            lanes = [lane for lane in self._of_edge.get(key[0][i], []) if self.admits(lane, vehicle_class)]
            onward = {}
            for lane in lanes:
                if i == len(key[0]) - 1:
                    onward[lane] = 0.0
                    continue
                reached = [following[t] for t, _ in self.links(lane) if t in following]
                if reached:
                    onward[lane] = min(reached)
            number = {lane: int(lane.rsplit("_", 1)[1]) for lane in lanes}
            following = {
                lane: min(abs(number[lane] - number[other]) + cost for other, cost in onward.items())
                for lane in lanes
                if onward
            }
        if len(self._tables) >= MOST_TABLES:
            self._tables.popitem(last=False)
        self._tables[key] = [onward, following]
        return self._tables[key]


def _drawn(lanes: list[Lane], entries: list[tuple[int, str, str, str]], before: list[tuple[float, float]]) -> LanePath:
    points, last = list(before), []
    for lane in lanes:
        points += [(px, py) for px, py in lane.shape.tolist()]
        last.append(len(points) - 1)
    points.append(_beyond(points))
    line, along = line_through(points)
    ends = tuple(along[i] for i in last)
    found = []
    for position, here, via, target in entries:
        out = next((ends[i - 1] for i in range(position + 1, len(lanes)) if not lanes[i].internal), ends[-1])
        found.append(JunctionEntry(ends[position], here, via, target, out))
    return LanePath(tuple(i.id for i in lanes), ends, tuple(i.max_speed for i in lanes), tuple(found), line)


def _beyond(points: list[tuple[float, float]]) -> tuple[float, float]:
    """A point `VIEW` m straight on after the last one."""
    x, y = points[-1]
    for px, py in reversed(points):
        step = math.hypot(x - px, y - py)
        if step > 0.1:
            return x + VIEW * (x - px) / step, y + VIEW * (y - py) / step
    return x + VIEW, y
