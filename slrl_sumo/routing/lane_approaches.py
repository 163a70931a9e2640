"""Lines on which vehicles approach the begin of a lane."""

from typing import NamedTuple

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.next_lane import FAR_SIGHT
from slrl_sumo.routing.polyline import Polyline, line_through


class _WayInto(NamedTuple):
    """A way through a junction into a lane."""

    origin: str
    """Lane before the junction."""
    inside: tuple[str, ...]
    """Internal lanes."""


class LaneApproaches:
    """The approaches of the lanes of a `graph`, each computed on first use."""

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._before: dict[str, list[str]] = {}
        self._known: dict[str, tuple[Polyline, ...]] = {}

    def __call__(self, lane: str) -> tuple[Polyline, ...]:
        """Lines that end at the begin of a lane: each way through the junction before it.

        The line of the straightest way begins FAR_SIGHT m before the lane. Vehicles before a junction that come from
        elsewhere may wait there, and do not count.
        """
        lines = self._known.get(lane)
        if lines is None:
            lines = self._known[lane] = tuple(self._lines(lane))
        return lines

    def _lines(self, lane: str) -> list[Polyline]:
        straight = self._straight_before(lane)
        others = ((way.origin, *way.inside) for way in self._ways_into(lane))
        each = [straight, *(lanes for lanes in others if straight[-len(lanes) :] != lanes)]
        shapes = [[point for name in lanes for point in self._graph.lanes[name].points] for lanes in each if lanes]
        return [line_through(points)[0] for points in shapes]

    def _straight_before(self, lane: str) -> tuple[str, ...]:
        """The lanes straight before a lane, together FAR_SIGHT m long if there are so many."""
        lanes, length = tuple[str, ...](), 0.0
        while length < FAR_SIGHT and (ways := self._ways_into(lane)):
            way = min(ways, key=lambda one: abs(self._graph.turn(one.origin, lane)))
            lanes, lane = (way.origin, *way.inside, *lanes), way.origin
            length += sum(self._graph.lanes[name].length for name in (way.origin, *way.inside))
        return lanes

    def _ways_into(self, lane: str) -> list[_WayInto]:
        ways = []
        for name in self._lanes_before(lane):
            inside = tuple[str, ...]()
            while name.startswith(":") and name not in inside:
                inside, name = (name, *inside), next(iter(self._lanes_before(name)), "")
            if name and not name.startswith(":"):
                ways.append(_WayInto(name, inside))
        return ways

    def _lanes_before(self, lane: str) -> list[str]:
        """The lanes, internal or not, whose vehicles next reach a lane."""
        if not self._before:
            for begin in self._graph.lanes:
                for target, via in self._graph.links(begin):
                    self._before.setdefault(via or target, []).append(begin)
        return self._before.get(lane, [])
