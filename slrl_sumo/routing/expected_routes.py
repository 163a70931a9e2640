"""Expected routes of the vehicles of a recording: along the lane under the vehicle, straight on at forks.

The destinations are unknown. The present motion predicts the next seconds: a vehicle stays on its lane and keeps the
highest speed of its last 2 s; a vehicle that has stood for 2 s stays where it is.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.perception.past_motion import PAST
from slrl_sumo.routing.lane_graph import MOST_LANES, REACH
from slrl_sumo.routing.path_line import path_line
from slrl_sumo.routing.polyline import Polyline
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import BEHIND, SPACING, RouteAhead, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.sumo.network.lanes import ALONG, Lane, LanePoints

CLASSES = {RoadUserType.CAR: "passenger", RoadUserType.BICYCLE: "bicycle"}
"""SUMO's vehicle class of each type with expected routes; pedestrians have none."""
ASIDE = 1.0
"""Distance (m) beside a lane up to which a vehicle counts as on the lane: the error of recorded positions and maps."""
AGAIN = 4.0
"""Tolerance (m) ahead and behind, beyond the distance driven, of the search for a vehicle on its path."""


@dataclass(slots=True)
class ExpectedRoute:
    """The route that a road user is expected to take, and its position on this route."""

    line: Polyline
    s: float
    """Position (m along the line) of the centre; `routes_ahead` updates it."""
    desired: float
    """Desired speed, m/s."""


class ExpectedRoutes:
    """Expected routes on the lanes of a network.

    `following`: ids of the lanes that follow each of the `lanes`, including internal lanes.
    """

    def __init__(self, lanes: Sequence[Lane], following: Mapping[str, Sequence[str]]) -> None:
        self._lanes = {lane.id: lane for lane in lanes}
        self._following = following
        self._points = {
            kind: LanePoints([lane for lane in lanes if lane.admits(name)], spacing=2.0)
            for kind, name in CLASSES.items()
        }
        self._lines: dict[tuple[str, str], tuple[Polyline, float]] = {}

    def of(self, recording: Trajectories, rows: Integers) -> list[ExpectedRoute | None]:
        """The expected routes of the road users in `rows` (n,) of a recording, from each row and the 2 s before it.

        None for pedestrians, and for vehicles without a lane of about the same direction under them.
        """
        found: list[ExpectedRoute | None] = [None] * len(rows)
        kinds = recording.type[recording.track[rows]]
        for kind, points in self._points.items():
            places = np.flatnonzero(kinds == kind)
            if not len(places) or not len(points):
                continue
            here = rows[places]
            x, y, heading = recording.x[here], recording.y[here], recording.heading[here]
            near = points.along(x, y, heading)
            best = near.own(near.rows)
            lanes = points.lane[best]
            off = np.hypot(near.own(near.aside), near.own(near.beyond))
            reach = ASIDE + 0.5 * np.array([points.lanes[lane].width for lane in lanes])
            on = (off <= reach) & (np.abs(wrap_angle(heading - points.heading[best])) < ALONG)
            desired = _recent_speed(recording, here)
            for k in np.flatnonzero(on).tolist():
                line, end = self._straight_on(points.lanes[lanes[k]], CLASSES[kind])
                s, _ = line.nearest(x.item(k), y.item(k), end=end)
                found[places[k]] = ExpectedRoute(line, s, desired.item(k))
        return found

    def _straight_on(self, lane: Lane, vehicle_class: str) -> tuple[Polyline, float]:
        """The line along a lane and the following lanes that turn least, and the position (m) on it where the lane
        ends.

        The line begins shortly before the lane.
        """
        if (known := self._lines.get((lane.id, vehicle_class))) is not None:
            return known
        chain, length = [lane], 0.0
        while length < REACH and len(chain) < MOST_LANES:
            names = (name for name in self._following.get(chain[-1].id, ()) if name in self._lanes)
            after = [other for name in names if (other := self._lanes[name]).admits(vehicle_class)]
            if not after:
                break
            ahead = _direction(chain[-1], -1)
            chain.append(min(after, key=lambda other: abs(math.remainder(_direction(other, -1) - ahead, math.tau))))
            length += chain[-1].length
        (x, y), begin = lane.shape[0].tolist(), _direction(lane, 0)
        before = [(x - BEHIND * math.cos(begin), y - BEHIND * math.sin(begin))]
        line, ends = path_line(chain, before, self._lanes)
        self._lines[lane.id, vehicle_class] = line, ends[0]
        return line, ends[0]


def routes_ahead(expected: Sequence[ExpectedRoute | None], world: WorldState) -> RouteAhead:
    """The routes ahead of the first road users of `world`, one for each of `expected`, from their present positions.

    The routes contain no stops, signals or speed limits.
    """
    route = RouteAhead.unknown(len(expected))
    for i, one in enumerate(expected):
        if one is None:
            continue
        reach = AGAIN + world.speed.item(i) * DECISION_INTERVAL
        s, _, distance = one.line.place(world.x.item(i), world.y.item(i), one.s - AGAIN, one.s + reach)
        one.s = s if math.isfinite(distance) else one.s
        route.known[i], route.desired_speed[i] = True, one.desired
        route.spacing[i] = spacing = spacing_at(world.speed.item(i))
        one.line.draw(one.s - BEHIND * spacing / SPACING, spacing, route.x, route.y, i)
    return route


def _recent_speed(recording: Trajectories, rows: Integers) -> Floats:
    """Highest speed (m/s) of road users in the last 2 s up to `rows`, (n,)."""
    first = recording.starts[recording.track[rows]]
    past = np.maximum(rows[:, None] - np.arange(PAST + 1), first[:, None])
    return np.asarray(recording.speed[past].max(axis=1))


def _direction(lane: Lane, piece: int) -> float:
    """Direction (rad) of a segment of a lane's centre line."""
    dx, dy = np.diff(lane.shape, axis=0)[piece].tolist()
    return math.atan2(dy, dx)
