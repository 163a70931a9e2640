"""What lies ahead of road users on their own routes: the path, lines to stop at, signals, limits, the end.

Vehicles' routes are SUMO's, walks those of persons' walking stages. Road users that we added have neither: they go on
at random at junctions, the same in every run.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.drives import Drive, Drives
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.pace import Pace
from slrl_sumo.sumo.stroll import Stroll, Strolls
from slrl_sumo.sumo.ways import LaneGraph
from slrl_sumo.world.geometry import Floats
from slrl_sumo.world.route import AHEAD, BEHIND, POINTS, RouteAhead
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
_GRID = np.linspace(-BEHIND, AHEAD, POINTS)


class Routes:
    """Keeps track of road users on their routes, through `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: Any, network: Network) -> None:
        graph = LaneGraph(api, network)
        self._graph = graph
        self._drives = Drives(api, network, graph)
        self._pace = Pace(api, graph, self._drives)
        self._strolls = Strolls(api, network)

    def ahead(self, world: WorldState, n: int) -> RouteAhead:
        """The routes of the first `n` road users of `world`, as they are now; call it once per decision."""
        self._pace.renew()
        route = RouteAhead.unknown(n)
        for i in range(n):
            if world.type[i] == RoadUserType.PEDESTRIAN:
                self._walk(route, world, i)
            else:
                self._drive(route, world, i)
        return route

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n road users has so little way left that SUMO should finish the trip, (n,)."""
        left = [min(self._drives.left(road_user), self._strolls.left(road_user)) for road_user in ids]
        return np.array(left, np.float64) < NEAR_END

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of road users that are no longer learned."""
        self._drives.forget(ids)
        self._strolls.forget(ids)

    def _drive(self, route: RouteAhead, world: WorldState, i: int) -> None:
        drive = self._drives.followed(world, i, DECISION_INTERVAL)
        self._drives.choose_lane(world.ids[i], drive, world, i)
        line = drive.way.line
        centre = drive.s - 0.5 * float(world.length[i])
        _sample(route, i, line.x, line.y, line.s, centre)
        slow = replace(drive, accel=HESITANT * drive.accel)
        stop, look = self._pace.stop(slow, REACTION, SOFT)
        calm = replace(drive, decel=SOFT * drive.decel)
        route.desired[i] = min(self._pace.limit(calm, REACTION), look)
        route.stop[i] = stop
        gate = next((gate for gate in drive.way.gates if gate.line > drive.s - 0.5), None)
        if gate is not None:
            route.line[i], route.out[i] = gate.line - drive.s, gate.out - drive.s
            route.signal[i] = self._pace.signal(gate)
            route.closed[i] = route.signal[i] >= 2 and stop <= route.line[i]
        route.left[i] = self._left(world.ids[i], drive)
        route.known[i] = True

    def _left(self, road_user: str, drive: Drive) -> float:
        drive.held = False
        return self._drives.left(road_user)

    def _walk(self, route: RouteAhead, world: WorldState, i: int) -> None:
        road_user = world.ids[i]
        stroll = self._strolls.followed(road_user, float(world.x[i]), float(world.y[i]), float(world.heading[i]))
        route.desired[i] = stroll.pace
        if stroll.walk is None:
            return
        line = stroll.walk.line
        _sample(route, i, line.x, line.y, line.s, stroll.s)
        _shift(route, i, stroll)
        stop, crossing, red = self._strolls.stop(stroll)
        route.stop[i], route.line[i] = stop, crossing
        if math.isfinite(crossing):
            route.signal[i], route.closed[i] = 3 if red else 1, red
        route.left[i] = self._strolls.left(road_user)
        route.known[i] = True


def _sample(route: RouteAhead, i: int, x: list[float], y: list[float], s: list[float], place: float) -> None:
    """Write the points of a line round `place` (m along it) into row `i`; beyond its ends it goes straight on."""
    along = place + _GRID
    route.x[i], route.y[i] = np.interp(along, s, x), np.interp(along, s, y)
    for beyond, a, b in ((s[0] - along, 0, 1), (along - s[-1], -1, -2)):
        rows = beyond > 0.0
        if rows.any():
            step = math.hypot(x[a] - x[b], y[a] - y[b])
            route.x[i, rows] = x[a] + beyond[rows] * (x[a] - x[b]) / step
            route.y[i, rows] = y[a] + beyond[rows] * (y[a] - y[b]) / step


def _shift(route: RouteAhead, i: int, stroll: Stroll) -> None:
    """Persons keep their place across the way that they walk on."""
    dx, dy = np.gradient(route.x[i]), np.gradient(route.y[i])
    step: Floats = np.maximum(np.hypot(dx, dy), 1e-6)
    route.x[i] -= stroll.beside * dy / step
    route.y[i] += stroll.beside * dx / step
