"""Signals and priority at the entries of junctions."""

import math
from typing import Literal

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry
from slrl_sumo.scene.route import SignalAspect
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.links import Link, ShownLinks, foe_lanes

LINE_OF_SIGHT = 4.5
"""Distance (m) before a junction from which vehicles see foes with priority (SUMO's foeVisibilityDistance)."""
ALWAYS_OPEN = Link("", "", True, True, "M")
"""Link assumed where SUMO has none."""
_ASPECTS = {
    "g": SignalAspect.GREEN,
    "G": SignalAspect.GREEN,
    "y": SignalAspect.YELLOW,
    "Y": SignalAspect.YELLOW,
    "r": SignalAspect.RED,
    "u": SignalAspect.RED,
}
"""https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html: junctions without a signal have other letters."""
_NO_SIGNAL = SignalAspect.NONE
"""Aspect of these other letters."""

Rule = Literal["go", "look", "stop"]
"""Rule at an entry: go on, approach slowly and look for foes, or stop at the line."""


class RightOfWay:
    """Rules at the entries of junctions, from the signals and links of a network. Call `renew` after each SUMO step.

    The caller checks whether vehicles with priority are near.
    """

    def __init__(self, api: SumoApi, graph: LaneGraph) -> None:
        self._shown = ShownLinks(api)
        self._links: dict[tuple[str, str, str], Link] = {}
        self._foes = FoeLanes(api, graph)

    def renew(self) -> None:
        """Drop the data of SUMO's last step."""
        self._links.clear()
        self._shown.renew()

    def rule(
        self, entry: JunctionEntry, distance: float, speed: float, deceleration: float, *, halted: bool, stopping: bool
    ) -> Rule:
        """The rule at an entry, see `link_rule`.

        Where vehicles must stop even without foes, it is "stop" until the vehicle has `halted` before the line. It
        stays "stop" at yellow for a vehicle that is already `stopping` for it.
        """
        link = self._link(entry.link)
        if (link.state in "ws" and not halted) or (link.state in "yY" and stopping):
            return "stop"
        return link_rule(link, distance, speed, deceleration)

    def has_priority(self, lane: str, target: str, via: str) -> bool:
        """Whether vehicles from a lane to a target lane over the internal lane `via` may enter now without yielding."""
        link = self._link((lane, target, via))
        return link.state not in "ruyY" and (link.has_priority or link.state in "GM")

    def is_green(self, lane: str, target: str, via: str) -> bool:
        """Whether no signal stops vehicles from a lane to a target lane over the internal lane `via` now."""
        return self._link((lane, target, via)).state not in "ruyY"

    def goes_first(self, lane: str, entry: JunctionEntry) -> bool:
        """Whether vehicles of a lane have priority over vehicles at an entry, whatever the target lane of the
        former."""
        return lane in self._foes(entry)

    def signal(self, entry: JunctionEntry) -> SignalAspect:
        """The signal at an entry."""
        return _ASPECTS.get(self._link(entry.link).state, _NO_SIGNAL)

    def _link(self, key: tuple[str, str, str]) -> Link:
        """The link from a lane to a target lane over an internal lane."""
        link = self._links.get(key)
        if link is None:
            lane, target, via = key
            link = self._links[key] = self._shown(lane).get((target, via), ALWAYS_OPEN)
        return link


class FoeLanes:
    """The lanes outside a junction from which vehicles have priority at an entry."""

    def __init__(self, api: SumoApi, graph: LaneGraph) -> None:
        self._api, self._graph = api, graph
        self._known: dict[tuple[str, str], tuple[str, ...]] = {}

    def __call__(self, entry: JunctionEntry) -> tuple[str, ...]:
        """Ids of these lanes."""
        key = (self._graph.origin(entry.lane), entry.target)
        lanes = self._known.get(key)
        if lanes is None:
            lanes = self._known[key] = foe_lanes(self._api, *key)
        return lanes


def link_rule(link: Link, distance: float, speed: float, deceleration: float) -> Rule:
    """The rule at the link of an entry for a vehicle at `speed` (m/s), `distance` m before the stop line.

    The vehicle brakes with `deceleration` (m/s²).
    """
    to_stop = speed * speed / (2.0 * deceleration)
    if link.state in "ru":
        return "stop"
    if link.state in "yY":
        return "stop" if to_stop + STOP_LINE <= distance else "go"
    # A vehicle that can no longer stop goes on: foes with priority were far away while stopping was possible.
    if link.has_priority or link.state in "GM" or to_stop > distance + 1.0:
        return "go"
    return "look"


def time_to_cover(distance: float, speed: float, acceleration: float) -> float:
    """Time (s) in which a road user covers `distance` (m) from `speed` (m/s) with `acceleration` (m/s²)."""
    return (math.sqrt(speed * speed + 2.0 * acceleration * max(distance, 0.0)) - speed) / acceleration
