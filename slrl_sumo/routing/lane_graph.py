"""Paths of single vehicles along the lanes of their routes: lane choice, and one line to drive on."""

import math
import random
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from slrl_sumo.routing.junctions.bent_lane import bent_lane
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry, LanePath, junction_of
from slrl_sumo.routing.lane_proximity import SPACING, clear_of, sampled
from slrl_sumo.routing.path_line import path_line
from slrl_sumo.routing.route_lane_changes import RouteLaneChanges
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.network.lane_ends import cut_back
from slrl_sumo.sumo.network.lane_state import LaneState
from slrl_sumo.sumo.network.lanes import Lane, lane_index
from slrl_sumo.sumo.network.links import LaneLinks, internal_lanes
from slrl_sumo.sumo.network.narrow_lanes import moved_apart

MOST_LANES = 30
MOST_PATHS = 2_000
WAITS_APART = 0.5
"""Distance (m) between a vehicle that waits before or inside a junction and vehicles on other ways through it: vehicles
do not stop to the centimetre. netconvert's waiting positions leave 0.1 m where ways cross at a small angle, and its
stop lines lie up to 10 m past other ways where the lanes of an edge are drawn into the junction."""
HALF_CAR, HALF_BICYCLE = 0.9, 0.325
"""Half the width (m) of SUMO's default car and bicycle."""
LOOKS = 3
"""Decisions (1.2 s) between readings of permissions: reading at each decision took 3 % of the time of 64 road users."""
BACK = 15.0
"""Distance (m) before the end of a lane within which a stop line is moved back."""
REACH = 250.0
"""Length (m) of a path beyond its first lane, if the route is that long: at 40 m/s a vehicle sees 230 m
(scene.route)."""
ROOM = 15.0
"""Length (m) of an edge below which a lane change has no room: 2.1 s at 7 m/s."""
SHARPEST = 2.2
"""Angle (rad, 126 degrees) of turns, such as U-turns, from which vehicles without a destination take only if no other
turn exists."""


class LaneGraph:
    """The lanes of a loaded network and the links between them; links are read on demand.

    Call `renew` after each SUMO step: limits and permissions may change.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.links = LaneLinks(api, network)
        self.lanes = {lane.id: lane for lane in network.lanes}
        self.lanes.update((lane.id, lane) for lane in moved_apart(network.lanes, self.links))
        self.lanes.update((lane.id, lane) for lane in cut_back(self.lanes, self.links))
        self.inside: dict[str, list[str]] = {}
        """The internal lanes of each junction (see `junction_of`), with pedestrian crossings, without walking areas."""
        self.version = 0
        """Number of changes of permissions: older paths may lead over closed lanes, or end before opened lanes."""
        self.round = 0
        """Number of times that reading the permissions again was allowed."""
        self._state, self._looked_at, self._renewed = LaneState(api), set[str](), 0
        self._changed: dict[str, Lane] = {}
        """Lanes with changed permissions, in their original state."""
        self._of_edge: dict[str, list[str]] = {}
        for lane in network.lanes:
            self._of_edge.setdefault(lane.edge, []).append(lane.id)
            if lane.internal and not is_walking_area(lane.id):
                self.inside.setdefault(junction_of(lane.id), []).append(lane.id)
        for lanes in self._of_edge.values():
            lanes.sort(key=lane_index)
        self._admitted: dict[tuple[str, str], list[tuple[str, str]]] = {}
        self._origins: dict[str, str] = {}
        self._waiting: dict[str, float] = {}
        self._bent: dict[tuple[str, str], str] = {}
        self._drawn_as: dict[str, str] = {}
        """The internal lane of SUMO's network from which each bent lane was made."""
        self._changes = RouteLaneChanges(self.lanes, self._of_edge, self.links)
        self._paths: OrderedDict[tuple[str, tuple[str, ...], str, tuple[tuple[float, float], ...]], LanePath]
        self._paths = OrderedDict()

    def renew(self) -> None:
        """Drop the limits of SUMO's last step; at every LOOKS-th call also allow reading the permissions again."""
        self._state.renew()
        self._renewed += 1
        if self._renewed % LOOKS == 0:
            self._looked_at.clear()
            self.round += 1

    def limit(self, lane: str) -> float:
        """Speed limit of a lane now, m/s."""
        return self._state.limit(self.in_network(lane))

    def in_network(self, lane: str) -> str:
        """The lane of SUMO's network for a lane of a path, which may be bent (see `junctions.bent_lane`)."""
        return self._drawn_as.get(lane, lane)

    def look_at(self, edge: str) -> None:
        """Read the present permissions of the lanes of an edge."""
        if edge in self._looked_at:
            return
        self._looked_at.add(edge)
        for lane in self._of_edge.get(edge, ()):
            allowed = self._state.newly_allowed(lane)
            if allowed is not None and allowed != self.lanes[lane].allowed:
                self._changed.setdefault(lane, self.lanes[lane])
                self.lanes[lane] = replace(self.lanes[lane], allowed=allowed)
                self.version += 1
                self._changes.clear()
                self._admitted.clear()
                self._paths.clear()

    def is_closed_after(self, lane: str, vehicle_class: str) -> bool:
        """Whether a vehicle class is no longer admitted to any lane that follows, and was at first."""
        if not self._changed:
            return False
        following = [target for target, _ in self.links(lane)]
        was = any(target in self._changed and self._changed[target].admits(vehicle_class) for target in following)
        return was and not any(self.lanes[target].admits(vehicle_class) for target in following)

    def lane_to_change_to(self, lane: str, vehicle_class: str, edges: tuple[str, ...]) -> str | None:
        """The neighbouring lane that brings a vehicle nearer to its route `edges`, which begin with the lane's edge.

        None where the vehicle should stay, or where no lane of the edge continues along the route.
        """
        return self._changes(edges, vehicle_class).towards(lane)

    def equal_lanes(self, lane: str, vehicle_class: str, edges: tuple[str, ...]) -> list[str]:
        """The neighbouring lanes on which a vehicle may stay until the end of the edge, see `lane_to_change_to`.

        The route `edges` begins with the lane's edge. The lane farther from the kerb comes first.
        """
        changes = self._changes(edges, vehicle_class)
        near = self.neighbours(lane, vehicle_class)
        return [other for other in near if other in changes.after and changes.towards(other) is None]

    def lanes_of(self, lane: str) -> list[str]:
        """All lanes of the edge of a lane, from the kerb on."""
        return self._of_edge[self.lanes[lane].edge]

    def neighbours(self, lane: str, vehicle_class: str) -> list[str]:
        """The neighbouring lanes that are open to a vehicle class; the lane farther from the kerb comes first."""
        lanes = self._of_edge[self.lanes[lane].edge]
        here = lanes.index(lane)
        near = [lanes[k] for k in (here + 1, here - 1) if 0 <= k < len(lanes)]
        return [other for other in near if self.lanes[other].admits(vehicle_class)]

    def path(
        self, lane: str, edges: tuple[str, ...], vehicle_class: str, before: list[tuple[float, float]], seed: str = ""
    ) -> LanePath:
        """The path from the begin of `lane` along the route `edges`, which begin after the lane's edge.

        `before`: points before the lane's begin, for the rear of a vehicle that has just entered the lane. `seed`:
        after the last edge, continue at random, equally for equal seeds; '' ends the path there.
        """
        if seed:
            return self._path(lane, edges, vehicle_class, before, random.Random(seed))
        # At each decision, a vehicle that may change lanes needs the path on the next lane.
        key = (lane, edges, vehicle_class, tuple(before))
        path = self._paths.get(key)
        if path is None:
            path = self._paths[key] = self._path(lane, edges, vehicle_class, before, None)
            if len(self._paths) > MOST_PATHS:
                self._paths.popitem(last=False)
        return path

    def _path(
        self,
        lane: str,
        edges: tuple[str, ...],
        vehicle_class: str,
        before: list[tuple[float, float]],
        rng: random.Random | None,
    ) -> LanePath:
        chain = [lane]
        entries: list[tuple[int, str, str, str]] = []
        remaining, length = edges, 0.0
        while length < REACH and len(chain) < MOST_LANES:
            here = chain[-1]
            link = self._choose(here, remaining, vehicle_class, rng)
            if link is None:
                break
            target, via = link
            if via:
                entries.append((len(chain) - 1, here, via, target))
            if not via and remaining and self.lanes[here].internal:
                chain[-1], target = self._without_change(here, target, remaining, vehicle_class)
            chain.append(via or target)
            length += self.lanes[chain[-1]].length
            if not via and remaining and self.lanes[target].edge == remaining[0]:
                remaining = remaining[1:]
        early = {here: self._early(here, via) for _, here, via, _ in entries}
        path = _joined([self.lanes[i] for i in chain], entries, before, self.lanes, early)
        if self.lanes[lane].internal or len(self._of_edge[self.lanes[lane].edge]) == 1:
            return path
        route = (self.lanes[lane].edge, *edges)
        if rng is not None:
            onward = self._edge_after(lane, vehicle_class, rng) if len(chain) == 1 else None
            if onward is None:
                return path
            route = (route[0], onward)
        return replace(path, route=route, next_lane=self.lane_to_change_to(lane, vehicle_class, route))

    def _edge_after(self, lane: str, vehicle_class: str, rng: random.Random) -> str | None:
        """An edge after the nearest lane beside a `lane` that ends, for a vehicle without a destination."""
        lanes = self.lanes_of(lane)
        for other in sorted(lanes, key=lambda one: abs(lanes.index(one) - lanes.index(lane))):
            if self.lanes[other].admits(vehicle_class):
                link = self._choose(other, (), vehicle_class, rng)
                if link is not None:
                    return self.lanes[link[0]].edge
        return None

    def _without_change(self, via: str, target: str, route: tuple[str, ...], vehicle_class: str) -> tuple[str, str]:
        """The internal lane `via` and the lane `target` after it, or a bent one and the lane that the `route` needs.

        The latter if `target` does not continue along the route, which begins with its edge, and the edge has no room
        for the lane changes.
        """
        changes = self._changes(route, vehicle_class)
        if target in changes.after:
            return via, target
        needed = target
        while (nearer := changes.towards(needed)) is not None:
            needed = nearer
        many = abs(lane_index(needed) - lane_index(target))
        if not many or self.lanes[target].length >= many * ROOM:
            return via, target
        bent = self._bent.get((via, needed))
        if bent is None:
            lane = bent_lane(self.lanes[via], self.lanes[needed])
            bent = self._bent[via, needed] = "" if lane is None else lane.id
            if lane is not None:
                self.lanes[bent], self._drawn_as[bent], self._origins[bent] = lane, via, self.origin(via)
        return (bent, needed) if bent else (via, target)

    def origin(self, lane: str) -> str:
        """The lane outside the junction that leads to an internal lane; for any other lane, the lane itself."""
        if not self._origins:
            for begin in self.lanes:
                if begin.startswith(":"):
                    continue
                for _, via in self.links(begin):
                    for inner in internal_lanes(via, self.links):
                        self._origins.setdefault(inner, begin)
        return self._origins.get(lane, lane)

    def _early(self, lane: str, via: str) -> float:
        """Distance (m) from the stop line of a lane to the lane's end; vehicles at the line are clear of other ways.

        `lane` leads into a junction, or on inside it, to the internal lane `via`.
        """
        early = self._waiting.get(lane)
        if early is None:
            mine, own = sampled(self.lanes[lane].shape), self.lanes[self.origin(lane)].edge
            others = [
                (sampled(self.lanes[other].shape), WAITS_APART + self._half_width(lane) + self._half_width(other))
                for other in self.inside[junction_of(via)]
                if self.origin(other) != other and self.lanes[self.origin(other)].edge != own
            ]
            early = self._waiting[lane] = _moved_back(mine, others, inside=self.lanes[lane].internal)
        return early

    def _half_width(self, lane: str) -> float:
        """Half the width (m) of the vehicles on a lane."""
        return HALF_CAR if self.lanes[lane].admits("passenger") else HALF_BICYCLE

    def _choose(
        self, lane: str, remaining: tuple[str, ...], vehicle_class: str, rng: random.Random | None
    ) -> tuple[str, str] | None:
        links = self._admitted.get((lane, vehicle_class))
        if links is None:
            links = [link for link in self.links(lane) if self.lanes[link[0]].admits(vehicle_class)]
            self._admitted[lane, vehicle_class] = links
        if self.lanes[lane].internal:
            # An internal lane continues on one lane, perhaps over another internal one.
            return next((k for k in links if not remaining or self.lanes[k[0]].edge == remaining[0]), None)
        if not remaining:
            exits = [k for k in links if not k[0].startswith(":")]
            if not rng or not exits:
                return None
            usual = [k for k in exits if abs(self.turn(lane, k[0])) < SHARPEST]
            return rng.choice(usual or exits)
        links = [link for link in links if self.lanes[link[0]].edge == remaining[0]]
        costs = self._changes(remaining, vehicle_class).total
        return min(links, key=lambda k: costs.get(k[0], math.inf), default=None)

    def turn(self, lane: str, target: str) -> float:
        """Angle (rad, to the left above 0) from the end of a lane to the begin of the next one."""
        (x0, y0), (x1, y1) = self.lanes[lane].points[-2:]
        (x2, y2), (x3, y3) = self.lanes[target].points[:2]
        turn = math.atan2(y3 - y2, x3 - x2) - math.atan2(y1 - y0, x1 - x0)
        return math.remainder(turn, math.tau)


def _moved_back(mine: Floats, others: list[tuple[Floats, float]], *, inside: bool) -> float:
    """Distance (m) before the end of a lane at which vehicles wait clear of all `others` (see `clear_of`).

    `inside` a junction this is the last clear position, else the last position before the first of the `others`; 0 if
    there is none within BACK.
    """
    line = mine[-1, 2].item() - STOP_LINE
    near = mine[mine[:, 2] >= line - BACK]
    clear = clear_of(near, others)
    places = near[clear if inside else np.logical_and.accumulate(clear), 2]
    places = places[places <= line]
    # A gap below SPACING is no reason to move the line: positions between two points may be clear as well.
    return 0.0 if not len(places) or places[-1] > line - SPACING else line - places[-1].item()


def _joined(
    lanes: list[Lane],
    entries: list[tuple[int, str, str, str]],
    before: list[tuple[float, float]],
    network: Mapping[str, Lane],
    early: Mapping[str, float],
) -> LanePath:
    line, ends = path_line(lanes, before, network)
    stops = [ends[position] - early[here] for position, here, *_ in entries]
    found = []
    for (position, here, via, target), stop in zip(entries, stops, strict=True):
        end = next((ends[i - 1] for i in range(position + 1, len(lanes)) if not lanes[i].internal), ends[-1])
        waits = next((line for line in stops if stop + 1e-6 < line < end), math.inf)
        found.append(JunctionEntry(stop, here, via, target, end, waits))
    return LanePath(tuple(i.id for i in lanes), ends, tuple(found), line)
