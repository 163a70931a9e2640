"""What becomes of road users that are taken over, or that a takeover would have taken: each one's journey."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import arrived_ids, loaded_ids, route_ends, vehicle_road, vehicle_route, walk_of

REACH_VEHICLE, REACH_PERSON = 15.0, 8.0
"""m from the end of the route's last edge, or of the walk, within which who arrives is at its own destination."""
REACH_STRAYED = 30.0
"""m from there within which somebody has strayed off the network at its own destination: it is 10 to 20 m outside."""

Fate = Literal["inside", "finishing", "left", "home", "elsewhere", "strayed", "off_route", "lost"]
"""`inside`: learned now; `finishing`: given back within the region, about to arrive; `left`: given back outside of the
region, on its own route; `home`, `elsewhere`: arrived at its own destination, or not; `strayed`: had left the scene,
and was put back onto its route; `off_route`: given back with another route than it came with."""


@dataclass
class Journey:
    """One road user: s where nothing else is said."""

    type: RoadUserType
    taken: float
    """When it was taken last."""
    fate: Fate
    inside_s: float
    """Time learned in the stays that are over, each until it left the region or arrived."""
    after: Fate
    """What became of it after the end of the takeover; until then the same as `fate`."""
    ends: Floats
    """Where its route or walk may end, (k, 2), m."""
    edges: tuple[str, ...]
    """Of its route, or the last one of its walk."""
    strayed_at_end: bool = False
    """Strayed, but at its own destination."""


class Journeys:
    """Follows road users through `api` (libsumo or a TraCI connection) until they are gone; see Fate.

    At `close` the takeover ends: fates stay as they are then, but for those that were about to arrive; what becomes of
    everybody afterwards is in `Journey.after`.
    """

    def __init__(self, api: SumoApi, step_length: float) -> None:
        self.all: dict[str, Journey] = {}
        self._api, self._step = api, step_length
        self._closed: frozenset[str] | None = None
        self._last: dict[str, tuple[float, float, float]] = {}
        self._gone: set[str] = set()

    @property
    def under_way(self) -> tuple[str, ...]:
        """Who has been taken and has not arrived yet, nor got lost."""
        return tuple(road_user for road_user in self.all if road_user not in self._gone)

    def take(self, road_user: str, kind: RoadUserType, now: float) -> None:
        """A road user of the scenario becomes learned, perhaps not for the first time."""
        journey = self.all.get(road_user)
        if journey is None:
            edges, ends = route_ends(self._api, road_user, kind == RoadUserType.PEDESTRIAN)
            self.all[road_user] = Journey(kind, now, "inside", 0.0, "inside", ends, edges)
        elif journey.fate in ("left", "finishing"):
            journey.taken, journey.fate, journey.after = now, "inside", "inside"

    def give_back(self, road_user: str, now: float, *, strayed: bool, inside: bool) -> None:
        """SUMO has a road user again; `inside`: still in the region, so about to arrive."""
        journey = self.all[road_user]
        if journey.fate != "inside" or self._closed is not None:
            return
        if strayed:
            journey.strayed_at_end = self._apart(road_user) < REACH_STRAYED
            self._end(journey, "strayed", now)
        elif not self._on_route(road_user, journey):
            self._end(journey, "off_route", now)
        elif inside:
            journey.fate = journey.after = "finishing"
        else:
            self._end(journey, "left", now)

    def close(self) -> None:
        """The takeover ends: everybody is handed back from now on."""
        self._closed = frozenset(road_user for road_user, j in self.all.items() if j.fate == "inside")

    def look(self, world: WorldState, now: float) -> None:
        """See after every SUMO step who has arrived or got lost; `world` is the state after it."""
        arrived = arrived_ids(self._api)
        known = loaded_ids(self._api)
        for road_user in self.under_way:
            if road_user in known:
                continue
            self._gone.add(road_user)
            journey = self.all[road_user]
            fate: Fate = "lost"
            if road_user in arrived:
                reach = REACH_PERSON if journey.type == RoadUserType.PEDESTRIAN else REACH_VEHICLE
                last_way = self._last[road_user][2] * self._step if road_user in self._last else 0.0
                fate = "home" if self._apart(road_user) < reach + last_way else "elsewhere"
            journey.after = fate
            if journey.fate in ("inside", "finishing") and not (self._closed and road_user in self._closed):
                self._end(journey, fate, now)
        self._last = {
            road_user: (x, y, speed)
            for road_user, x, y, speed in zip(
                world.ids, world.x.tolist(), world.y.tolist(), world.speed.tolist(), strict=True
            )
            if road_user in self.all
        }

    def _end(self, journey: Journey, fate: Fate, now: float) -> None:
        journey.fate = journey.after = fate
        journey.inside_s += now - journey.taken

    def _apart(self, road_user: str) -> float:
        """m from where a road user was last seen to its own destination."""
        if road_user not in self._last:
            return float("inf")
        x, y, _ = self._last[road_user]
        return float(np.hypot(*(self.all[road_user].ends - (x, y)).T).min(initial=np.inf))

    def _on_route(self, road_user: str, journey: Journey) -> bool:
        """Whether SUMO will drive or walk it to where it wanted to go when it was taken first."""
        if journey.type == RoadUserType.PEDESTRIAN:
            edges, _ = walk_of(self._api, road_user)
            return bool(edges) and edges[-1] == journey.edges[-1]
        (route, _), road = vehicle_route(self._api, road_user), vehicle_road(self._api, road_user)
        return route == journey.edges and (road in route or road.startswith(":"))


@dataclass(frozen=True)
class Outcome:
    """How many journeys of some type had which end; road users."""

    taken: int
    on_route: int
    """Left the region on their own route, or arrived at their own destination, before the end of the takeover."""
    counted: int
    """Of whom that was to be expected; see `outcome`."""
    strayed: int
    strayed_at_end: int
    """Of those, how many had gone off the network at their own destination."""
    off_route: int
    """Given back with another route, or arrived elsewhere."""
    lost: int
    unfinished: int
    """Still learned at the end of the takeover."""
    home_later: int
    """Of those, how many SUMO has then brought to their destination within the tail."""
    under_way: int
    """Still in SUMO at the end of the tail."""


def outcome(journeys: Iterable[Journey], end: float, time_to_leave: float, under_way: int) -> Outcome:
    """Count journeys of a takeover that ended at `end` (s).

    Counted are those that were taken at least `time_to_leave` s before the end, and those that have left by then,
    whatever way: so a road user that stands in the way for ever counts as one that did not leave, and one that came
    shortly before the end does not count. Lost ones count.
    """
    journeys = list(journeys)
    good: NDArray[np.bool_] = np.array([j.fate in ("left", "home") for j in journeys], np.bool_)
    gone = np.array([j.fate not in ("inside", "finishing") for j in journeys], np.bool_)
    early = np.array([j.taken <= end - time_to_leave for j in journeys], np.bool_)
    inside = [j for j in journeys if j.fate in ("inside", "finishing")]
    return Outcome(
        taken=len(journeys),
        on_route=int(good.sum()),
        counted=int((gone | early).sum()),
        strayed=sum(j.fate == "strayed" for j in journeys),
        strayed_at_end=sum(j.fate == "strayed" and j.strayed_at_end for j in journeys),
        off_route=sum(j.fate in ("off_route", "elsewhere") for j in journeys),
        lost=sum(j.fate == "lost" or j.after == "lost" for j in journeys),
        unfinished=len(inside),
        home_later=sum(j.after == "home" for j in inside),
        under_way=under_way,
    )
