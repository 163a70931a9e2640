"""Outcomes of the trips of road users that are taken over, or that a takeover would have taken."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

REACH_VEHICLE, REACH_PERSON = 15.0, 8.0
"""m from the end of the route's last edge, or of the walk, within which an arrival is at the own destination."""
REACH_LEFT_NETWORK = 30.0
"""m from there within which a road user has left the network at its own destination: it is 10 to 20 m outside."""

Fate = Literal["inside", "finishing", "left", "arrived", "elsewhere", "returned_to_route", "off_route", "lost"]
"""`inside`: learned now; `finishing`: given back within the region, about to arrive; `left`: given back outside the
region, on its own route; `arrived`, `elsewhere`: arrived at its own destination, or at another one;
`returned_to_route`: left the scene and was put back onto its route; `off_route`: given back with another route than it
came with; `lost`: gone from SUMO without arriving."""


@dataclass
class TakenTrip:
    """The trip of one road user; times in s."""

    type: RoadUserType
    taken: float
    """Time of the last takeover."""
    fate: Fate
    inside_s: float
    """Time learned in its finished stays, each until it left the region or arrived."""
    after: Fate
    """Its fate after the end of the takeover; until then the same as `fate`."""
    ends: Floats
    """Possible ends of its route or walk, (k, 2), m."""
    edges: tuple[str, ...]
    """Edges of its route, or the last edge of its walk."""
    left_network_at_end: bool = False
    """Returned to its route, but had left the network at its own destination."""


class TakenTrips:
    """Follows road users through `api` (libsumo or a TraCI connection) until they are gone; see Fate.

    At `close` the takeover ends: fates stay as they are then, except those of road users about to arrive; later fates
    are in `TakenTrip.after`.
    """

    def __init__(self, api: Any, step_length: float) -> None:
        self.all: dict[str, TakenTrip] = {}
        self._api, self._step = api, step_length
        self._closed: frozenset[str] | None = None
        self._last: dict[str, tuple[float, float, float]] = {}
        self._gone: set[str] = set()

    @property
    def under_way(self) -> tuple[str, ...]:
        """Road users that have been taken, and have neither arrived nor got lost."""
        return tuple(road_user for road_user in self.all if road_user not in self._gone)

    def take(self, road_user: str, kind: RoadUserType, now: float) -> None:
        """A road user of the scenario becomes learned, possibly again."""
        trip = self.all.get(road_user)
        if trip is None:
            edges, ends = self._goal(road_user, kind)
            self.all[road_user] = TakenTrip(kind, now, "inside", 0.0, "inside", ends, edges)
        elif trip.fate in ("left", "finishing"):
            trip.taken, trip.fate, trip.after = now, "inside", "inside"

    def give_back(self, road_user: str, now: float, *, returned_to_route: bool, inside: bool) -> None:
        """A road user becomes SUMO's again. `inside`: still in the region, so about to arrive."""
        trip = self.all[road_user]
        if trip.fate != "inside" or self._closed is not None:
            return
        if returned_to_route:
            trip.left_network_at_end = self._apart(road_user) < REACH_LEFT_NETWORK
            self._end(trip, "returned_to_route", now)
        elif not self._on_route(road_user, trip):
            self._end(trip, "off_route", now)
        elif inside:
            trip.fate = trip.after = "finishing"
        else:
            self._end(trip, "left", now)

    def close(self) -> None:
        """The takeover ends: all road users are handed back from now on."""
        self._closed = frozenset(road_user for road_user, trip in self.all.items() if trip.fate == "inside")

    def update(self, world: WorldState, now: float) -> None:
        """Find the road users that have arrived or got lost; `world`: the state after a SUMO step."""
        api = self._api
        arrived = {*api.simulation.getArrivedIDList(), *api.simulation.getArrivedPersonIDList()}
        known = {*api.vehicle.getIDList(), *api.person.getIDList()}
        for road_user in self.under_way:
            if road_user in known:
                continue
            self._gone.add(road_user)
            trip = self.all[road_user]
            fate: Fate = "lost"
            if road_user in arrived:
                reach = REACH_PERSON if trip.type == RoadUserType.PEDESTRIAN else REACH_VEHICLE
                last_step = self._last[road_user][2] * self._step if road_user in self._last else 0.0
                fate = "arrived" if self._apart(road_user) < reach + last_step else "elsewhere"
            trip.after = fate
            if trip.fate in ("inside", "finishing") and not (self._closed and road_user in self._closed):
                self._end(trip, fate, now)
        self._last = {
            road_user: (x, y, speed)
            for road_user, x, y, speed in zip(
                world.ids, world.x.tolist(), world.y.tolist(), world.speed.tolist(), strict=True
            )
            if road_user in self.all
        }

    def _end(self, trip: TakenTrip, fate: Fate, now: float) -> None:
        trip.fate = trip.after = fate
        trip.inside_s += now - trip.taken

    def _apart(self, road_user: str) -> float:
        """m from the last position of a road user to its own destination."""
        if road_user not in self._last:
            return float("inf")
        x, y, _ = self._last[road_user]
        return float(np.hypot(*(self.all[road_user].ends - (x, y)).T).min(initial=np.inf))

    def _goal(self, road_user: str, kind: RoadUserType) -> tuple[tuple[str, ...], Floats]:
        api = self._api
        if kind == RoadUserType.PEDESTRIAN:
            edges, arrival = api.person.getEdges(road_user, 0), api.person.getStage(road_user, 0).arrivalPos
            length = api.lane.getLength(edges[-1] + "_0")
            place = api.simulation.convert2D(edges[-1], min(max(arrival, 0.0), length), 0)
            return (edges[-1],), np.array([place])
        route = tuple(api.vehicle.getRoute(road_user))
        lanes = range(api.edge.getLaneNumber(route[-1]))
        return route, np.array([api.lane.getShape(f"{route[-1]}_{i}")[-1] for i in lanes])

    def _on_route(self, road_user: str, trip: TakenTrip) -> bool:
        """Whether SUMO will take it to the destination that it had when it was first taken."""
        if trip.type == RoadUserType.PEDESTRIAN:
            edges = self._api.person.getEdges(road_user, 0)
            return bool(edges) and edges[-1] == trip.edges[-1]
        route, road = tuple(self._api.vehicle.getRoute(road_user)), self._api.vehicle.getRoadID(road_user)
        return route == trip.edges and (road in route or road.startswith(":"))


@dataclass(frozen=True)
class OutcomeCounts:
    """Numbers of road users of some type by the fate of their trips."""

    taken: int
    on_route: int
    """Left the region on their own route, or arrived at their own destination, before the end of the takeover."""
    counted: int
    """Those for which that was to be expected; see `count_outcomes`."""
    returned_to_route: int
    left_network_at_end: int
    """Of those, how many had left the network at their own destination."""
    off_route: int
    """Given back with another route, or arrived elsewhere."""
    lost: int
    unfinished: int
    """Still learned at the end of the takeover."""
    arrived_later: int
    """Of those, how many arrived at their destination in the tail, driven by SUMO."""
    under_way: int
    """Still in SUMO at the end of the tail."""


def count_outcomes(trips: Iterable[TakenTrip], end: float, time_to_leave: float, under_way: int) -> OutcomeCounts:
    """Count the trips of a takeover that ended at `end` (s).

    `counted` are road users that were taken over at least `time_to_leave` s before the end, and road users that have
    left by then in any way, including lost road users. A road user that blocks the road for ever thus counts as not
    left, and a road user that came shortly before the end does not count.
    """
    trips = list(trips)
    good: NDArray[np.bool_] = np.array([trip.fate in ("left", "arrived") for trip in trips], np.bool_)
    gone = np.array([trip.fate not in ("inside", "finishing") for trip in trips], np.bool_)
    early = np.array([trip.taken <= end - time_to_leave for trip in trips], np.bool_)
    inside = [trip for trip in trips if trip.fate in ("inside", "finishing")]
    return OutcomeCounts(
        taken=len(trips),
        on_route=int(good.sum()),
        counted=int((gone | early).sum()),
        returned_to_route=sum(trip.fate == "returned_to_route" for trip in trips),
        left_network_at_end=sum(trip.left_network_at_end for trip in trips),
        off_route=sum(trip.fate in ("off_route", "elsewhere") for trip in trips),
        lost=sum(trip.fate == "lost" or trip.after == "lost" for trip in trips),
        unfinished=len(inside),
        arrived_later=sum(trip.after == "arrived" for trip in inside),
        under_way=under_way,
    )
