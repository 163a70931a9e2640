"""What lies ahead of road users on their own routes: the path, lines to stop at, signals, limits, the end.

Vehicles' routes are SUMO's, walks those of persons' walking stages. Road users that we added have neither: they go on
at random at junctions, the same in every run.
"""

import math
from bisect import bisect_right
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.drives import Drives
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.pace import Pace
from slrl_sumo.sumo.stroll import Strolls
from slrl_sumo.sumo.ways import LaneGraph, Line
from slrl_sumo.world.route import AHEAD, BEHIND, POINTS, RouteAhead, slopes
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

NEAR_END = 15.0
"""m before its destination at which SUMO should finish a trip."""
SOFT = 0.5
"""Share of a vehicle's deceleration with which it slows down for limits and junctions."""
REACTION = 2 * DECISION_INTERVAL
"""s before what it decides shows."""
HESITANT = 0.4
"""Share of its acceleration by which it is judged how soon a vehicle has crossed a junction: it turns there."""
STUCK = 20.0
"""s that a vehicle waits at the end of a lane that does not lead on, for a gap in the next one."""
_GRID = np.linspace(-BEHIND, AHEAD, POINTS)


class Routes:
    """Keeps track of road users on their routes, through `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: Any, network: Network) -> None:
        graph = LaneGraph(api, network)
        self._drives = Drives(api, network, graph)
        self._pace = Pace(api, graph, self._drives, trusting=False)
        self._strolls = Strolls(api, network)
        self._astray: set[str] = set()

    def ahead(self, world: WorldState, n: int) -> RouteAhead:
        """The routes of the first `n` road users of `world`, as they are now; call it once per decision."""
        self._pace.renew()
        route = RouteAhead.unknown(n)
        paths: list[tuple[Line, float, float]] = []
        walking = (world.type[:n] == RoadUserType.PEDESTRIAN).tolist()
        for i, walks in enumerate(walking):
            path = self._walk(route, world, i) if walks else self._drive(route, world, i)
            if path is not None:
                route.known[i] = True
                paths.append(path)
        _draw(route, paths)
        return route

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n road users has so little way left that SUMO should finish the trip, (n,)."""
        return near_end(self._drives, self._strolls, ids)

    def astray(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n road users stands where no lane leads on along its route, (n,): it has turned off the wrong way."""
        return np.array([road_user in self._astray for road_user in ids], np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of road users that are no longer learned."""
        self._astray.difference_update(ids)
        self._drives.forget(ids)
        self._strolls.forget(ids)

    def _drive(self, route: RouteAhead, world: WorldState, i: int) -> tuple[Line, float, float]:
        """Write row `i`, but its path: its line, m along it to the centre, and m beside it to stay."""
        drive = self._drives.followed(world, i, DECISION_INTERVAL)
        self._drives.choose_lane(world.ids[i], drive, world, i)
        stop, look = self._pace.stop(drive, REACTION, SOFT, HESITANT)
        route.desired[i] = min(self._pace.limit(drive, REACTION, SOFT), look)
        route.stop[i] = stop
        gate = next((gate for gate in drive.way.gates if gate.line > drive.s - 0.5), None)
        if gate is not None:
            line = gate.line - drive.s
            route.line[i], route.out[i] = line, gate.out - drive.s
            route.signal[i] = shown = self._pace.signal(gate)
            route.closed[i] = shown >= 2 and stop <= line
        route.left[i] = self._drives.left(world.ids[i])
        if drive.stood > STUCK and not self._pace.leads_on(drive):
            self._astray.add(world.ids[i])
        return drive.way.line, drive.s - 0.5 * float(world.length[i]), 0.0

    def _walk(self, route: RouteAhead, world: WorldState, i: int) -> tuple[Line, float, float] | None:
        """As `_drive`; None for who goes nowhere. Persons keep their place across the way that they walk on."""
        road_user = world.ids[i]
        stroll = self._strolls.followed(road_user, float(world.x[i]), float(world.y[i]), float(world.heading[i]))
        route.desired[i] = stroll.pace
        if stroll.walk is None:
            return None
        stop, crossing, red = self._strolls.stop(stroll)
        route.stop[i], route.line[i] = stop, crossing
        if math.isfinite(crossing):
            route.signal[i], route.closed[i] = 3 if red else 1, red
        route.left[i] = self._strolls.left(road_user)
        return stroll.walk.line, stroll.s, stroll.beside


def near_end(drives: Drives, strolls: Strolls, ids: tuple[str, ...]) -> NDArray[np.bool_]:
    """Who of n road users, on one of `drives` or `strolls`, has less than NEAR_END to go, (n,)."""
    return np.array([min(drives.left(road_user), strolls.left(road_user)) for road_user in ids], np.float64) < NEAR_END


def _draw(route: RouteAhead, paths: list[tuple[Line, float, float]]) -> None:
    """Write the points of all that are known: of each its line, the place on it (m), and m to its left to stay.

    Beyond its ends a line goes straight on. What is needed of all lines is laid in a row, and drawn in one go.
    """
    if not paths:
        return
    x: list[float] = []
    y: list[float] = []
    s: list[float] = []
    places = []
    room = 0.0
    for line, place, _ in paths:
        begin, end = place - BEHIND, place + AHEAD
        first = max(bisect_right(line.s, begin) - 1, 0)
        last = min(bisect_right(line.s, end) + 1, len(line.s))
        shift = room - min(begin, line.s[first])
        if begin < line.s[0]:
            _straight_on(line, 0, 1, line.s[0] - begin, x, y)
            s.append(room)
        x += line.x[first:last]
        y += line.y[first:last]
        s += [along + shift for along in line.s[first:last]]
        if end > line.s[-1]:
            _straight_on(line, -1, -2, end + 1.0 - line.s[-1], x, y)
            s.append(end + 1.0 + shift)
        places.append(place + shift)
        room = s[-1] + 1.0
    along, known = np.array(places)[:, None] + _GRID, np.array(s)
    px, py = np.interp(along, known, x), np.interp(along, known, y)
    beside = np.array([path[2] for path in paths])
    aside = np.flatnonzero(beside)
    if len(aside):
        dx, dy = slopes(px[aside]), slopes(py[aside])
        share = beside[aside, None] / np.maximum(np.hypot(dx, dy), 1e-6)
        px[aside] -= share * dy
        py[aside] += share * dx
    route.x[route.known], route.y[route.known] = px, py


def _straight_on(line: Line, end: int, inner: int, beyond: float, x: list[float], y: list[float]) -> None:
    """Add a point `beyond` m off an end of a line."""
    share = beyond / math.hypot(line.x[end] - line.x[inner], line.y[end] - line.y[inner])
    x.append(line.x[end] + share * (line.x[end] - line.x[inner]))
    y.append(line.y[end] + share * (line.y[end] - line.y[inner]))
