"""What lies ahead of road users on their own routes: the path, lines to stop at, signals, limits, the end.

Vehicles' routes are SUMO's, walks those of persons' walking stages. Road users that we added have neither: they go on
at random at junctions, the same in every run.
"""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.pedestrian_tracker import PedestrianTracker
from slrl_sumo.routing.speed_limits import SpeedLimits
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.scene.route import BEHIND, SPACING, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network

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


class Routes:
    """Keeps track of road users on their routes, through `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        graph = LaneGraph(api, network)
        self._vehicles = VehicleTracker(api, network, graph)
        self._speed_limits = SpeedLimits(api, graph, self._vehicles, trusting=False)
        self._pedestrians = PedestrianTracker(api, network)
        self._astray: set[str] = set()

    def ahead(self, world: WorldState, n: int) -> RouteAhead:
        """The routes of the first `n` road users of `world`, as they are now; call it once per decision."""
        self._speed_limits.renew()
        self._pedestrians.renew()
        route = RouteAhead.unknown(n)
        for i, walks in enumerate((world.type[:n] == RoadUserType.PEDESTRIAN).tolist()):
            if walks:
                self._walk(route, world, i)
            else:
                self._drive(route, world, i)
        return route

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n road users has so little way left that SUMO should finish the trip, (n,)."""
        return near_end(self._vehicles, self._pedestrians, ids)

    def astray(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Who of n road users stands where no lane leads on along its route, (n,): it has turned off the wrong way."""
        return np.array([road_user in self._astray for road_user in ids], np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of road users that are no longer learned."""
        self._astray.difference_update(ids)
        self._vehicles.forget(ids)
        self._pedestrians.forget(ids)

    def _drive(self, route: RouteAhead, world: WorldState, i: int) -> None:
        """Write row `i`, that of a vehicle."""
        road_user = world.ids[i]
        drive = self._vehicles.followed(world, i, DECISION_INTERVAL)
        self._vehicles.choose_lane(road_user, drive, world, i)
        way, s = drive.way, drive.s
        stop, look = self._speed_limits.stop(drive, REACTION, SOFT, HESITANT)
        route.known[i] = True
        route.desired[i] = min(self._speed_limits.limit(drive, REACTION, SOFT), look)
        route.stop[i] = stop
        for entry in way.entries:
            line = entry.line - s
            if line > -0.5:
                route.line[i], route.out[i] = line, entry.out - s
                route.signal[i] = shown = self._speed_limits.signal(entry)
                route.closed[i] = shown >= 2 and stop <= line
                break
        route.left[i] = self._vehicles.left(road_user)
        if drive.stood > STUCK and not self._speed_limits.leads_on(drive):
            self._astray.add(road_user)
        way.line.draw(s - 0.5 * world.length.item(i) - BEHIND, SPACING, 0.0, route.x, route.y, i)

    def _walk(self, route: RouteAhead, world: WorldState, i: int) -> None:
        """As `_drive`, of a person; who goes nowhere is not known. Persons keep their place across the way that they
        walk on."""
        road_user = world.ids[i]
        stroll = self._pedestrians.followed(road_user, world.x.item(i), world.y.item(i), world.heading.item(i))
        route.desired[i] = stroll.pace
        if stroll.walk is None:
            return
        stop, crossing, red = self._pedestrians.stop(stroll)
        route.known[i] = True
        route.stop[i], route.line[i] = stop, crossing
        if math.isfinite(crossing):
            route.signal[i], route.closed[i] = 3 if red else 1, red
        route.left[i] = self._pedestrians.left(road_user)
        stroll.walk.line.draw(stroll.s - BEHIND, SPACING, stroll.beside, route.x, route.y, i)


def near_end(vehicles: VehicleTracker, pedestrians: PedestrianTracker, ids: tuple[str, ...]) -> NDArray[np.bool_]:
    """Who of n road users, tracked in `vehicles` or `pedestrians`, has less than NEAR_END to go, (n,)."""
    return (
        np.array([min(vehicles.left(road_user), pedestrians.left(road_user)) for road_user in ids], np.float64)
        < NEAR_END
    )
