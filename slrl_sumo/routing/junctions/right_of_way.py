"""Signals and priority where the paths of vehicles enter junctions."""

import math
from collections.abc import Mapping
from typing import Literal

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.links import Link, ShownLinks, foe_lanes, internal_foe_lanes, read_links
from slrl_sumo.sumo.road_users import lane_position, vehicle_speed, vehicles_on_lane

LINE_OF_SIGHT = 4.5
"""m before a junction from which vehicles see road users that have priority (SUMO's foeVisibilityDistance)."""
TRUST_TIME = 10.0
"""s of standing after which a vehicle no longer trusts SUMO's judgement of a link; after twice that it goes first."""
ALWAYS_OPEN = Link("", "", True, True, "M")
"""Where SUMO has no link."""
_SHOWN = {"g": 1, "G": 1, "y": 2, "Y": 2, "r": 3, "u": 3}
"""https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html: junctions without a signal have other letters."""


class RightOfWay:
    """Whether vehicles may enter junctions, from SUMO's signals and links. Call `renew` after each SUMO step."""

    def __init__(self, api: SumoApi, graph: LaneGraph, *, trust_sumo: bool = True) -> None:
        """`trust_sumo`: for TRUST_TIME, believe SUMO where it sees a foe; otherwise foes are left to the caller."""
        self._api = api
        self._trust_sumo = trust_sumo
        self._graph = graph
        self._links: dict[str, Mapping[tuple[str, str], Link]] = {}
        self._shown = ShownLinks(api)
        self._foes: dict[tuple[str, str], tuple[str, ...]] = {}
        self._internal_foes: dict[str, tuple[str, ...]] = {}

    def renew(self) -> None:
        """Forget what was read of SUMO's last step."""
        self._links.clear()
        self._shown.renew()

    def speed(
        self, entry: JunctionEntry, distance: float, speed: float, limits: tuple[float, float], standing_time: float
    ) -> float:
        """The speed (m/s) that signal and priority at an entry allow a vehicle; inf where they set no limit.

        `distance`: m from its front to the stop line; `speed`: of the vehicle, m/s; `limits`: its acceleration and
        deceleration, m/s²; `standing_time`: s that it has stood.
        """
        rule = self.rule(entry, distance, speed, limits, standing_time)
        if rule == "stop":
            return math.sqrt(2.0 * limits[1] * max(distance - STOP_LINE, 0.0))
        if rule == "look":
            return math.sqrt(2.0 * limits[1] * max(distance, LINE_OF_SIGHT))
        return math.inf

    def rule(
        self, entry: JunctionEntry, distance: float, speed: float, limits: tuple[float, float], standing_time: float
    ) -> Literal["go", "look", "stop"]:
        """The rule at an entry: go on, approach slowly and look, or stop at the line; arguments as for `speed`."""
        acceleration, deceleration = limits
        to_stop = speed * speed / (2.0 * deceleration)
        link = self._link(entry)
        if link.state in "ru":
            return "stop"
        if link.state in "yY":
            return "stop" if to_stop + STOP_LINE <= distance else "go"
        # Too late to stop: foes were far away when stopping was possible.
        if link.has_priority or link.state in "GM" or to_stop > distance + 1.0:
            return "go"
        if distance > LINE_OF_SIGHT + speed:
            return "look"
        clear = time_to_cover(distance + entry.exit - entry.stop_line + 5.0, speed, acceleration)
        if not self._trust_sumo:
            return "look"
        if standing_time < TRUST_TIME:
            return "stop" if not link.is_open or self._foe_arrives(entry, clear) else "look"
        # SUMO counts a vehicle with speed mode 0, as all taken-over ones have, as a foe even where it waits at red: a
        # link may never be open. Then moving vehicles decide, and at last only those that move inside the junction.
        arrives = standing_time < 2.0 * TRUST_TIME and self._foe_arrives(entry, clear)
        return "stop" if arrives or self._foe_inside(entry) else "look"

    def has_priority(self, lane: str, target: str, via: str) -> bool:
        """Whether vehicles may enter now from a lane to a target lane over an internal lane, and need not yield."""
        link = self._links_from(lane).get((target, via), ALWAYS_OPEN)
        return link.state not in "ruyY" and (link.has_priority or link.state in "GM")

    def is_green(self, lane: str, target: str, via: str) -> bool:
        """Whether no signal stops vehicles now that go from a lane to a target lane over an internal lane."""
        return self._links_from(lane).get((target, via), ALWAYS_OPEN).state not in "ruyY"

    def goes_first(self, lane: str, entry: JunctionEntry) -> bool:
        """Whether vehicles of a lane have priority over those at an entry, wherever they go."""
        return lane in self._foe_lanes(entry)

    def halts(self, entry: JunctionEntry) -> bool:
        """Whether vehicles have to stand before the line even where nothing comes."""
        return self._link(entry).state in "ws"

    def signal(self, entry: JunctionEntry) -> int:
        """The signal at an entry: 0 none, 1 green, 2 yellow, 3 red."""
        return _SHOWN.get(self._link(entry).state, 0)

    def _link(self, entry: JunctionEntry) -> Link:
        return self._links_from(entry.lane).get((entry.target, entry.via), ALWAYS_OPEN)

    def _links_from(self, lane: str) -> Mapping[tuple[str, str], Link]:
        """The links from a lane, by target and via."""
        links = self._links.get(lane)
        if links is None:
            if self._trust_sumo:
                links = {(link.target, link.via): link for link in read_links(self._api, lane)}
            else:
                links = self._shown(lane)
            self._links[lane] = links
        return links

    def _foe_arrives(self, entry: JunctionEntry, within: float) -> bool:
        """Whether a moving vehicle with priority reaches the junction within `within` s."""
        for lane in self._foe_lanes(entry):
            if self._all_red(lane):
                continue
            length = self._graph.lanes[lane].length
            for foe in vehicles_on_lane(self._api, lane):
                foe_speed = vehicle_speed(self._api, foe)
                if foe_speed > 1.0 and length - lane_position(self._api, foe) < foe_speed * within:
                    return True
        return False

    def _foe_lanes(self, entry: JunctionEntry) -> tuple[str, ...]:
        """The lanes outside the junction from which vehicles have priority at an entry."""
        key = (self._graph.origin(entry.lane), entry.target)
        lanes = self._foes.get(key)
        if lanes is None:
            lanes = self._foes[key] = foe_lanes(self._api, *key)
        return lanes

    def _all_red(self, lane: str) -> bool:
        """Whether all links from a lane are red now."""
        links = self._links_from(lane).values()
        return bool(links) and all(link.state in "ru" for link in links)

    def _foe_inside(self, entry: JunctionEntry) -> bool:
        """Whether a vehicle from another lane moves on an internal lane that crosses this one."""
        lanes = self._internal_foes.get(entry.via)
        if lanes is None:
            origin = self._graph.origin(entry.lane)
            foes = internal_foe_lanes(self._api, entry.via)
            lanes = self._internal_foes[entry.via] = tuple(
                lane for lane in foes if lane in self._graph.lanes and self._graph.origin(lane) != origin
            )
        return any(vehicle_speed(self._api, foe) > 0.5 for lane in lanes for foe in vehicles_on_lane(self._api, lane))


def time_to_cover(distance: float, speed: float, acceleration: float) -> float:
    """s to cover `distance` (m) from `speed` (m/s) with `acceleration` (m/s²)."""
    return (math.sqrt(speed * speed + 2.0 * acceleration * max(distance, 0.0)) - speed) / acceleration
