"""The ways of persons along the edges of their walk: sidewalks, walking areas and crossings as one line."""

import math
import random
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.lanes import Lane
from slrl_sumo.sumo.links import LaneLinks, edge_junctions
from slrl_sumo.sumo.network import Network

WANDERING = 12
"""Edges that a walk without destination goes on for, until it is drawn anew."""
TOUCHED = 5.0
"""m of an edge that are too few to be given back on."""


@dataclass(frozen=True)
class CrossingEntry:
    """Where a walk enters a crossing."""

    s: float
    """m along the walk."""
    lane: str
    """The walking area whose link to the crossing has its signal; it may be at the other end."""
    crossing: str


@dataclass(frozen=True)
class WalkPath:
    """One line from a person's first edge to where it wants to go."""

    line: Polyline
    kerbs: tuple[CrossingEntry, ...]
    half_width: float
    """m to either side of the line that can be walked on everywhere: half of the narrowest lane."""
    first: float
    """m along the line at which the second edge ends: a person that begins the walk is before that."""
    leave: float
    """m along the line at which the last edge ends that is more than touched; the rest lies inside junctions."""


class Walkways:
    """What can be walked on in a loaded network, asked of `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._paths: dict[str, Lane] = {}
        """The lane of each edge that persons walk on."""
        self._inside: dict[str, Lane] = {}
        for lane in network.lanes:
            if "pedestrian" not in lane.allowed:
                continue
            if lane.internal:
                self._inside[lane.id] = lane
            elif lane.edge not in self._paths or (
                lane.surface == Surface.SIDEWALK and self._paths[lane.edge].surface != Surface.SIDEWALK
            ):
                self._paths[lane.edge] = lane
        walked = {**{lane.id: lane for lane in self._paths.values()}, **self._inside}
        self._beside: dict[str, list[str]] = {lane: [] for lane in walked}
        self._entry: dict[str, str] = {}
        links = LaneLinks(api, network)
        # SUMO's links have a direction; persons walk either way.
        for lane_id in walked:
            for target, _ in links(lane_id):
                if target in walked and _is_walked(lane_id, walked) and _is_walked(target, walked):
                    self._beside[lane_id].append(target)
                    self._beside[target].append(lane_id)
                    self._entry[target] = lane_id
        self._ends: dict[str, tuple[str, str]] = {}

    def walk(self, edges: tuple[str, ...], arrival: float) -> WalkPath | None:
        """The walk along `edges` to `arrival` (m from the begin of the last edge); None where one cannot be walked on.

        Which way round each edge is walked follows from the junction that it shares with the next one.
        """
        if not edges or any(edge not in self._paths for edge in edges):
            return None
        return self._drawn(self._directed(edges), arrival)

    def wandering(self, edge: str, forward: bool, dice: random.Random) -> WalkPath | None:
        """A walk that begins along `edge` and goes on at random; where nothing goes on, it turns round."""
        if edge not in self._paths:
            return None
        steps = [(edge, forward)]
        while len(steps) < WANDERING:
            here, onward = steps[-1]
            junction = self._ends_of(here)[1 if onward else 0]
            reached = self._reached(self._paths[here].id, junction)
            choices = sorted(e for e, lane in self._paths.items() if lane.id in reached and e != here)
            if not choices:
                steps.append((here, not onward))
                continue
            chosen = dice.choice(choices)
            steps.append((chosen, self._ends_of(chosen)[0] == junction))
        return self._drawn(steps, None)

    def _directed(self, edges: tuple[str, ...]) -> list[tuple[str, bool]]:
        """Each edge with whether it is walked from its begin to its end."""
        steps: list[tuple[str, bool]] = []
        entered = ""
        for edge, following in pairwise(edges):
            ends = self._ends_of(edge)
            shared = [j for j in ends if j in self._ends_of(following)] or [ends[1]]
            # Edges to and fro share both ends: go on, do not turn at the end that was come from.
            left = next((j for j in reversed(shared) if j != entered), shared[-1])
            steps.append((edge, left == ends[1]))
            entered = left
        steps.append((edges[-1], entered != self._ends_of(edges[-1])[1]))
        return steps

    def _drawn(self, steps: list[tuple[str, bool]], arrival: float | None) -> WalkPath:
        points: list[tuple[float, float]] = []
        kerbs: list[tuple[int, str, str]] = []
        first = leave = 0
        width = min(self._paths[edge].width for edge, _ in steps)
        for i, (edge, forward) in enumerate(steps):
            lane = self._paths[edge]
            shape = [(x, y) for x, y in lane.shape.tolist()]
            if i == len(steps) - 1 and arrival is not None:
                line, _ = line_through(shape)
                place = min(max(arrival, 0.0), lane.length) * line.end / max(lane.length, 0.1)
                shape = line.between(0.0, place) if forward or len(steps) == 1 else line.between(place, line.end)
            points += shape if forward else shape[::-1]
            touched = math.dist(shape[0], shape[-1]) < TOUCHED
            leave = len(points) - 1 if not touched or not leave else leave
            if i <= 1:
                first = len(points) - 1
            if i == len(steps) - 1:
                break
            junction = self._ends_of(edge)[1 if forward else 0]
            for before, inside in pairwise(self._through(lane.id, self._paths[steps[i + 1][0]].id, junction)):
                if inside in self._inside and self._inside[inside].surface == Surface.CROSSING:
                    crossing = [(x, y) for x, y in self._inside[inside].shape.tolist()]
                    here = points[-1]
                    if math.dist(crossing[-1], here) < math.dist(crossing[0], here):
                        crossing.reverse()
                    kerbs.append((len(points), self._entry.get(inside, before), inside))
                    points += crossing
                    width = min(width, self._inside[inside].width)
        line, along = line_through(points)
        return WalkPath(
            line, tuple(CrossingEntry(along[i], a, b) for i, a, b in kerbs), 0.5 * width, along[first], along[leave]
        )

    def _through(self, begin: str, end: str, junction: str) -> list[str]:
        """Lanes from `begin` to `end` over the walking areas and crossings of a junction; just these two if none do."""
        came = self._reached(begin, junction, end)
        if end not in came:
            return [begin, end]
        chain = [end]
        while chain[-1] != begin:
            chain.append(came[chain[-1]])
        return chain[::-1]

    def _reached(self, begin: str, junction: str, end: str = "") -> dict[str, str]:
        """Lanes that can be reached inside a junction and on its edges, each with the lane before it."""
        came = {begin: begin}
        todo = deque([begin])
        while todo and end not in came:
            here = todo.popleft()
            for lane in self._beside[here]:
                # Into the junction, and from inside out of it, but not over an edge.
                inside = lane.startswith(f":{junction}_")
                if lane not in came and (inside or here.startswith(":")):
                    came[lane] = here
                    if inside:
                        todo.append(lane)
        return came

    def _ends_of(self, edge: str) -> tuple[str, str]:
        ends = self._ends.get(edge)
        if ends is None:
            ends = self._ends[edge] = edge_junctions(self._api, edge)
        return ends


def _is_walked(lane: str, lanes: dict[str, Lane]) -> bool:
    """Not a lane that cars take through a junction, where those admit persons too."""
    return not lane.startswith(":") or lanes[lane].surface == Surface.CROSSING or _area(lane)


def _area(lane: str) -> bool:
    """A walking area, by its id: ":junction_w0_0"."""
    return lane.rsplit("_", 2)[1].startswith("w")
