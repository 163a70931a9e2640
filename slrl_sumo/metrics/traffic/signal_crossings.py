"""Road users that pass a signal, and the aspect of the signal."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.routing.walking.walking_area import distance_to
from slrl_sumo.scene.geometry import Floats, front_from_centre
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.network.links import LaneLinks, signal_links, signal_states
from slrl_sumo.sumo.road_users import vehicle_ids, vehicle_lane, vehicle_route

Aspect = Literal["red", "yellow", "green"]
PERMISSIVE: tuple[Aspect, ...] = ("red", "yellow", "green")
"""Aspects from the least to the most permissive."""

BEYOND, ASIDE = 0.5, 10.0
"""Distance (m) past a stop line, and greatest distance beside its lane, at which a vehicle that stands, or has no lane
in SUMO, has passed the line; others inside the junction have passed it at 0 m."""
CROSSING_END = 1.0
"""Length (m) at each end of a crossing on which persons may wait for green, or cut the corner."""
AWAY = 3.0
"""Distance (m) outside a crossing from which a person that returns makes a new crossing."""


@dataclass(frozen=True)
class SignalCrossing:
    """A passage of a signal: a vehicle into a junction, or a person onto a crossing."""

    time: float
    """End (s) of the SUMO step of the passage."""
    road_user: str
    type: RoadUserType
    lane: str
    """The lane before the junction, or the lane of the crossing."""
    aspect: Aspect


@dataclass(frozen=True)
class _Link:
    """A connection over lanes inside a junction to an edge."""

    signal: str
    """Id of the signal; '' for a connection without a signal, such as a right turn beside the signal."""
    index: int
    inside: frozenset[str]
    edge: str


@dataclass(frozen=True)
class _Crossing:
    lane: str
    line: Floats
    inner: Floats
    """The line without its ends, where persons wait."""
    half_width: float
    link: _Link
    walking_areas: tuple[Floats, ...]
    """Outlines of the walking areas of its junction, (k, 2) each: netconvert's crossings begin up to 3 m beyond round
    kerbs."""


class SignalCrossings:
    """Observes signals through `api` (libsumo or a TraCI connection); call `update` after each SUMO step.

    A vehicle passes when SUMO moves it from a lane that ends at a signal to a lane after the signal. A vehicle without
    a lane in SUMO, because it is moved from outside and far from its route, passes when its front is past the stop
    line. A person passes when its centre is on a crossing with a signal, more than CROSSING_END from the ends, from any
    side; the most permissive aspect counts since the person stepped onto the crossing, or off a walking area within
    AWAY of it.

    Red means red before and after the step. SUMO switches signals at the begin of a step: a road user that moves in the
    step in which the signal turns green, or in which yellow ends, has not passed a red signal.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._lanes = {lane.id: lane for lane in network.lanes}
        self._links: dict[str, list[_Link]] = {}
        self._crossings: list[_Crossing] = []
        self._walking_areas: dict[str, list[Floats]] = {}
        for lane in network.lanes:
            if is_walking_area(lane.id):
                self._walking_areas.setdefault(junction_of(lane.id), []).append(lane.shape)
        self._following = LaneLinks(api, network)
        for signal_link in signal_links(api):
            self._add(*signal_link)
        for start, links in self._links.items():
            known = {inside for link in links for inside in link.inside}
            links += [self._link("", 0, end, via) for end, via in self._following(start) if via not in known]
        self._approach: dict[str, str] = {}
        self._passed: dict[str, str] = {}
        self._stepped: dict[str, str] = {}
        self._waiting: dict[tuple[str, str], Aspect] = {}
        """Aspect seen by persons at the end of a crossing, until they pass or leave, by person and crossing."""
        self._states = signal_states(api)

    def update(self, world: WorldState, counted: Iterable[str]) -> list[SignalCrossing]:
        """Crossings of the road users `counted` in the last SUMO step; `world` is the state after it."""
        wanted = frozenset(counted)
        before, self._states = self._states, signal_states(self._api)
        rows = np.array([i for i, road_user in enumerate(world.ids) if road_user in wanted], np.intp)
        users = world.take(rows)
        walking = users.type == RoadUserType.PEDESTRIAN
        found = self._walkers(users.take(np.flatnonzero(walking)), before)
        found += self._vehicles(users.take(np.flatnonzero(~walking)), before)
        for memory in (self._approach, self._passed, self._stepped):
            for road_user in [r for r in memory if r not in wanted]:
                del memory[road_user]
        return found

    def _add(self, signal: str, index: int, start: str, end: str, via: str) -> None:
        crossing = next((self._lanes[i] for i in (end, via) if i and self._is_crossing(i)), None)
        if crossing is not None:
            if all(known.lane != crossing.id for known in self._crossings):
                link = _Link(signal, index, frozenset(), "")
                inner = shortened(crossing.shape, CROSSING_END)
                areas = tuple(self._walking_areas.get(junction_of(crossing.id), ()))
                shape, half_width = crossing.shape, 0.5 * crossing.width
                self._crossings.append(_Crossing(crossing.id, shape, inner, half_width, link, areas))
        elif start in self._lanes and end in self._lanes and not start.startswith(":"):
            self._links.setdefault(start, []).append(self._link(signal, index, end, via))

    def _link(self, signal: str, index: int, end: str, via: str) -> _Link:
        inside = [via] if via else []
        # A second internal lane follows after a waiting position inside a junction.
        while inside and len(inside) < 5:
            onward = [via for _, via in self._following(inside[-1]) if via]
            if not onward:
                break
            inside.append(onward[0])
        return _Link(signal, index, frozenset(inside), self._lanes[end].edge)

    def _is_crossing(self, lane: str) -> bool:
        return lane in self._lanes and self._lanes[lane].surface == Surface.CROSSING

    def _vehicles(self, users: WorldState, before: dict[str, str]) -> list[SignalCrossing]:
        if not self._links:
            return []
        found = []
        front_x, front_y = front_from_centre(users.x, users.y, users.heading, users.length)
        present = vehicle_ids(self._api)
        for row, vehicle in enumerate(users.ids):
            if vehicle not in present:
                continue
            lane = vehicle_lane(self._api, vehicle)
            came = self._approach.get(vehicle)
            links = self._links[came] if came is not None else []
            front = float(front_x[row]), float(front_y[row])
            taken = self._taken(vehicle, lane, links, front, came, stands=bool(users.speed[row] < STANDING_SPEED))
            if came is not None and taken:
                del self._approach[vehicle]
                edge = self._lanes[came].edge
                controlled = [link for link in taken if link.signal]
                if self._passed.get(vehicle) != edge and controlled:
                    self._passed[vehicle] = edge
                    aspect = self._aspect(controlled, before)
                    found.append(SignalCrossing(users.time, vehicle, RoadUserType(users.type[row]), came, aspect))
            if lane and not lane.startswith(":"):
                # The vehicle is on a road again: if it returns to the same signal, it passes the signal again. In SUMO,
                # a moved vehicle that stands at the stop line may alternate between both sides: that is one crossing.
                if self._passed.get(vehicle) not in (None, self._lanes[lane].edge):
                    del self._passed[vehicle]
                if lane in self._links:
                    self._approach[vehicle] = lane
                else:
                    self._approach.pop(vehicle, None)
        return found

    def _taken(
        self,
        vehicle: str,
        lane: str,
        links: list[_Link],
        front: tuple[float, float],
        came: str | None,
        *,
        stands: bool,
    ) -> list[_Link]:
        """The links from the lane `came` that a vehicle has taken in this step; empty if it has taken none."""
        if came is None or not links:
            return []
        if not lane:
            return self._on_route(vehicle, came, links) if self._beyond(came, *front) else []
        if lane.startswith(":"):
            # SUMO places a moved vehicle inside the junction that stands exactly on the line, or that waits for green
            # before a turnaround and already steers, up to 1.7 m before the line.
            if not self._beyond(came, *front, by=BEYOND if stands else 0.0):
                return []
            return [link for link in links if lane in link.inside] or (
                self._on_route(vehicle, came, links) if self._same_junction(lane, links) else []
            )
        edge = self._lanes[lane].edge
        return [link for link in links if link.edge == edge] if edge != self._lanes[came].edge else []

    def _beyond(self, lane: str, x: float, y: float, by: float = BEYOND) -> bool:
        """Whether a position (m) is `by` m past the stop line at the end of a lane."""
        line = self._lanes[lane].shape
        ahead_x, ahead_y = (line[-1] - line[-2]) / max(float(np.hypot(*(line[-1] - line[-2]))), 1e-9)
        dx, dy = x - line[-1, 0], y - line[-1, 1]
        ahead, aside = dx * ahead_x + dy * ahead_y, dy * ahead_x - dx * ahead_y
        return bool(ahead >= by and abs(aside) <= ASIDE + ahead)

    def _same_junction(self, lane: str, links: list[_Link]) -> bool:
        junction = lane.rsplit("_", 2)[0]
        return any(inside.rsplit("_", 2)[0] == junction for link in links for inside in link.inside)

    def _on_route(self, vehicle: str, came: str, links: list[_Link]) -> list[_Link]:
        """The links from a lane to the next edge of the route; all links if none leads there, none if it ends here."""
        route, _ = vehicle_route(self._api, vehicle)
        here = self._lanes[came].edge
        following = {after for edge, after in pairwise(route) if edge == here}
        if route[-1:] == (here,) and not following:
            return []
        return [link for link in links if link.edge in following] or links

    def _walkers(self, users: WorldState, before: dict[str, str]) -> list[SignalCrossing]:
        found: list[SignalCrossing] = []
        if not len(users):
            return found
        waiting, self._waiting = self._waiting, {}
        for crossing in self._crossings:
            outside = outside_by(users.x, users.y, crossing.line, crossing.half_width)
            near = np.flatnonzero(outside <= AWAY)
            places = np.stack([users.x[near], users.y[near]], axis=1)
            on_area = np.full(len(near), not crossing.walking_areas)
            for outline in crossing.walking_areas if len(near) else ():
                on_area |= distance_to(outline, places) <= 0.0
            near = near[(outside[near] <= 0.0) | ~on_area]
            beyond = outside_by(users.x[near], users.y[near], crossing.inner, crossing.half_width) <= 0.0
            for row, passes in zip(near.tolist(), beyond.tolist(), strict=True):
                person = users.ids[row]
                if self._stepped.get(person) == crossing.lane:
                    continue
                shown = self._aspect([crossing.link], before)
                seen = max(shown, waiting.get((person, crossing.lane), shown), key=PERMISSIVE.index)
                if passes:
                    self._stepped[person] = crossing.lane
                    found.append(SignalCrossing(users.time, person, RoadUserType.PEDESTRIAN, crossing.lane, seen))
                else:
                    self._waiting[person, crossing.lane] = seen
            for row in np.flatnonzero(outside > AWAY).tolist():
                if self._stepped.get(users.ids[row]) == crossing.lane:
                    del self._stepped[users.ids[row]]
        return found

    def _aspect(self, links: list[_Link], before: dict[str, str]) -> Aspect:
        """The aspect of links; if it is unknown which of several links was taken, the most permissive aspect counts."""
        seen = [
            (before.get(link.signal, self._states[link.signal])[link.index], self._states[link.signal][link.index])
            for link in links
        ]
        if all(a in "ru" and b in "ru" for a, b in seen):
            return "red"
        return "yellow" if all(a in "ruyY" and b in "ruyY" for a, b in seen) else "green"


def outside_by(x: Floats, y: Floats, line: Floats, half_width: float) -> NDArray[np.float64]:
    """Distance of n points from a ribbon with straight ends around the polyline `line` (k, 2), m, (n,).

    Negative or 0 inside. The nearest segment decides; the ends of the line bound the ribbon.
    """
    best = np.full(len(x), np.inf)
    for number, (a, b) in enumerate(pairwise(line)):
        length = float(np.hypot(*(b - a)))
        if length <= 0.0:
            continue
        ux, uy = (b - a) / length
        ahead = (x - a[0]) * ux + (y - a[1]) * uy
        aside = np.abs((y - a[1]) * ux - (x - a[0]) * uy)
        before, behind = -ahead, ahead - length
        if number > 0:
            before = before - half_width
        if number < len(line) - 2:
            behind = behind - half_width
        best = np.minimum(best, np.maximum(np.maximum(before, behind), aside - half_width))
    return best


def shortened(line: Floats, cut: float) -> Floats:
    """The polyline `line` (k, 2) without `cut` m, at most a third of its length, at each end."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    cut = min(cut, float(along[-1]) / 3.0)
    s = np.concatenate([[cut], along[(along > cut) & (along < along[-1] - cut)], [along[-1] - cut]])
    return np.column_stack([np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])])
