"""Crossing pedestrians as occupants of junctions: a vehicle that would meet a crossing pedestrian does not enter."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas, Way
from slrl_sumo.routing.junctions.occupants import UNUSED, Occupant, size_of
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.nearest import PointIndex
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import is_walking_area
from slrl_sumo.sumo.network.links import ShownLinks

BEFORE = 1.0
"""Distance (m) before a crossing within which a pedestrian walking towards it is about to step on it."""
BESIDE = 0.5
"""Distance (m) beside a crossing up to which a pedestrian counts as crossing there."""
TOWARDS = 0.5
"""Least cosine between the heading of a pedestrian and the direction of the crossing that it is about to step on."""
WALKING = 0.3
"""Speed (m/s) below which a pedestrian stands."""
AT_KERB = 0.6
"""Distance (m) from an end of a crossing within which a standing pedestrian is at the kerb. In a waiting crowd, some
pedestrians stand 0.2 to 0.5 m past the kerb, and vehicles pass them there."""
STRIP = 1.0
"""Width (m) of a strip of a crossing; pedestrians in the same strip cross on the same line."""
SPACING = 1.0
"""Spacing (m) of the points of crossings in the search tree."""
STEADY = 0.01
"""Acceleration (m/s²) of crossing pedestrians: practically constant speed."""


@dataclass(frozen=True)
class _Crossing:
    lane: str
    begin: tuple[float, float]
    """x and y of the begin of the crossing's lane, m."""
    along: tuple[float, float]
    """Direction of the crossing, a unit vector."""
    length: float
    half_width: float
    entered_from: str
    """Walking area with the link to the crossing."""

    def line(self, strip: int, *, forward: bool) -> Floats:
        """The line of a strip in the direction of walking, two points (2, 2) in m."""
        begin, along = np.array(self.begin), np.array(self.along)
        aside = strip * STRIP * np.array([-self.along[1], self.along[0]])
        ends = np.stack([begin + aside, begin + self.length * along + aside])
        return ends if forward else ends[::-1]


class _Walker(NamedTuple):
    crossing: _Crossing
    way: Way
    """The line of the walker's strip."""
    passed: float
    """Distance (m) walked along the line."""


class CrossingOccupants:
    """The learned and background pedestrians on crossings. Call `renew` once per decision."""

    def __init__(self, api: SumoApi, graph: LaneGraph, areas: ConflictAreas) -> None:
        """`areas`: the conflict areas to which the lines of crossing pedestrians are added."""
        self._links, self._areas = ShownLinks(api), areas
        entered_from = {
            target: lane
            for lane in graph.lanes
            if is_walking_area(lane)
            for target, _ in graph.links(lane)
            if graph.lanes[target].surface == Surface.CROSSING
        }
        self._crossings: list[_Crossing] = []
        points: list[Floats] = []
        for lane in graph.lanes.values():
            if lane.surface != Surface.CROSSING or lane.id not in entered_from:
                continue
            begin, chord = lane.shape[0], lane.shape[-1] - lane.shape[0]
            length = float(np.hypot(*chord))
            if length < SPACING:
                continue
            self._crossings.append(
                _Crossing(
                    lane.id,
                    (begin.item(0), begin.item(1)),
                    (chord.item(0) / length, chord.item(1) / length),
                    length,
                    0.5 * lane.width,
                    entered_from[lane.id],
                )
            )
            share = np.linspace(0.0, 1.0, 1 + math.ceil(length / SPACING))
            points.append(begin + share[:, None] * chord)
        self._crossing_of_point = np.repeat(np.arange(len(points)), [len(p) for p in points])
        self._points = PointIndex(*np.concatenate(points or [np.zeros((0, 2))]).T)
        self._reach = max((c.half_width for c in self._crossings), default=0.0) + BESIDE + BEFORE
        self._standing_since: dict[str, float] = {}
        self._found: dict[str, dict[str, Occupant]] = {}
        self._ways: dict[tuple[str, int, bool], Way] = {}
        """The line of each strip that has been walked on, by crossing, strip and direction."""

    def renew(self, world: WorldState) -> None:
        """Find the pedestrians on crossings; `world`: all road users now."""
        self._found = {}
        self._links.renew()
        walking = np.flatnonzero(world.type == PEDESTRIAN)
        if not len(self._points) or not len(walking):
            self._standing_since = {}
            return
        nearest, distance = self._points.nearest(world.x[walking], world.y[walking], within=self._reach)
        standing: dict[str, float] = {}
        for k in np.flatnonzero(distance[:, 0] < self._reach).tolist():
            row = int(walking[k])
            walker = self._walker(self._crossings[self._crossing_of_point[nearest[k, 0]]], world, row)
            if walker is None:
                continue
            name, speed, crossing = world.ids[row], world.speed.item(row), walker.crossing
            if speed < WALKING:
                standing[name] = self._standing_since.get(name, world.time)
            if self._waits(walker, speed):
                continue
            occupant = Occupant(
                walker.way,
                (-walker.passed,),
                speed,
                size_of(world.length.item(row), world.width.item(row)),
                math.inf,
                world.time,
                yields=False,
                idle=world.time - standing.get(name, world.time) > UNUSED,
                acceleration=STEADY,
                is_pedestrian=True,
            )
            self._found.setdefault(junction_of(crossing.lane), {})[name] = occupant
        self._standing_since = standing

    def of(self, junction: str) -> dict[str, Occupant]:
        """The pedestrians that are on the crossings of a junction or about to step on one, by id."""
        return self._found.get(junction, {})

    def _walker(self, crossing: _Crossing, world: WorldState, row: int) -> _Walker | None:
        """The pedestrian of a row as a walker on the crossing; None unless it is on it or about to step on it."""
        (begin_x, begin_y), (c, s) = crossing.begin, crossing.along
        dx, dy = world.x.item(row) - begin_x, world.y.item(row) - begin_y
        along, aside = c * dx + s * dy, c * dy - s * dx
        if abs(aside) > crossing.half_width + BESIDE or not -BEFORE < along < crossing.length + BEFORE:
            return None
        heading = world.heading.item(row)
        towards = math.cos(heading) * c + math.sin(heading) * s
        forward = towards >= 0.0
        passed = along if forward else crossing.length - along
        if passed >= crossing.length or (passed < 0.0 and (abs(towards) < TOWARDS or world.speed[row] < WALKING)):
            return None
        return _Walker(crossing, self._way(crossing, round(aside / STRIP), forward), passed)

    def _way(self, crossing: _Crossing, strip: int, forward: bool) -> Way:
        """The line of a strip of a crossing in the direction of walking, as a way."""
        key = (crossing.lane, strip, forward)
        way = self._ways.get(key)
        if way is None:
            name = f"{crossing.lane}/{strip}/{'forward' if forward else 'backward'}"
            self._areas.add_line(name, crossing.line(strip, forward=forward))
            way = self._ways[key] = self._areas.way((name,))
        return way

    def _waits(self, walker: _Walker, speed: float) -> bool:
        """Whether a pedestrian at this speed (m/s) waits at an end of the crossing, because it must give way there."""
        at_kerb = speed < WALKING and not AT_KERB <= walker.passed <= walker.crossing.length - AT_KERB
        return (walker.passed < 0.0 or at_kerb) and self._state(walker.crossing) in "rum"

    def _state(self, crossing: _Crossing) -> str:
        """SUMO's letter for the link to a crossing."""
        links = self._links(crossing.entered_from).values()
        return next((link.state for link in links if link.target == crossing.lane), "m")
