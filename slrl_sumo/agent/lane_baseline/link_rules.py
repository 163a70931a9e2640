"""Rules at junctions for the baseline `lane`, from SUMO's judgement whether a vehicle with priority comes."""

from slrl_sumo.routing.junctions.right_of_way import (
    ALWAYS_OPEN,
    LINE_OF_SIGHT,
    FoeLanes,
    Rule,
    link_rule,
    time_to_cover,
)
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import JunctionEntry
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.links import Link, internal_foe_lanes, read_links
from slrl_sumo.sumo.road_users import lane_position, vehicle_speed, vehicles_on_lane

TRUST_TIME = 10.0
"""Standing time (s) after which a vehicle no longer uses SUMO's judgement of a link; after twice this time it goes
first."""


class LinkRules:
    """Rules at entries, from SUMO's links and the vehicles on their lanes. Call `renew` after each SUMO step."""

    def __init__(self, api: SumoApi, graph: LaneGraph) -> None:
        self._api, self._graph = api, graph
        self._foes = FoeLanes(api, graph)
        self._links: dict[str, dict[tuple[str, str], Link]] = {}
        self._internal_foes: dict[str, tuple[str, ...]] = {}

    def renew(self) -> None:
        """Drop the data of SUMO's last step."""
        self._links.clear()

    def rule(
        self, entry: JunctionEntry, distance: float, speed: float, limits: tuple[float, float], standing_time: float
    ) -> Rule:
        """The rule at an entry for a vehicle `distance` m before the line, at `speed` (m/s).

        `limits`: its acceleration and deceleration, m/s². `standing_time`: its standing time, s.
        """
        acceleration, deceleration = limits
        link = self._links_from(entry.lane).get((entry.target, entry.via), ALWAYS_OPEN)
        rule = link_rule(link, distance, speed, deceleration)
        if rule != "look" or distance > LINE_OF_SIGHT + speed:
            return rule
        clear = time_to_cover(distance + entry.exit - entry.stop_line + 5.0, speed, acceleration)
        if standing_time < TRUST_TIME:
            return "stop" if not link.is_open or self._foe_arrives(entry, clear) else "look"
        # SUMO counts a vehicle with speed mode 0, such as each taken-over vehicle, as a foe even if it waits at a red
        # signal: a link may never be open. Then moving foes decide, and finally only foes moving inside the junction.
        arrives = standing_time < 2.0 * TRUST_TIME and self._foe_arrives(entry, clear)
        return "stop" if arrives or self._foe_inside(entry) else "look"

    def _links_from(self, lane: str) -> dict[tuple[str, str], Link]:
        """The links from a lane, by target and via."""
        links = self._links.get(lane)
        if links is None:
            links = self._links[lane] = {(link.target, link.via): link for link in read_links(self._api, lane)}
        return links

    def _foe_arrives(self, entry: JunctionEntry, within: float) -> bool:
        """Whether a moving vehicle with priority reaches the junction within `within` s."""
        for lane in self._foes(entry):
            if self._all_red(lane):
                continue
            length = self._graph.lanes[lane].length
            for foe in vehicles_on_lane(self._api, lane):
                foe_speed = vehicle_speed(self._api, foe)
                if foe_speed > 1.0 and length - lane_position(self._api, foe) < foe_speed * within:
                    return True
        return False

    def _all_red(self, lane: str) -> bool:
        """Whether all links from a lane are red now."""
        links = self._links_from(lane).values()
        return bool(links) and all(link.state in "ru" for link in links)

    def _foe_inside(self, entry: JunctionEntry) -> bool:
        """Whether a vehicle from another lane moves on an internal lane that crosses the lane of this entry."""
        lanes = self._internal_foes.get(entry.via)
        if lanes is None:
            origin = self._graph.origin(entry.lane)
            foes = internal_foe_lanes(self._api, entry.via)
            lanes = self._internal_foes[entry.via] = tuple(
                lane for lane in foes if lane in self._graph.lanes and self._graph.origin(lane) != origin
            )
        return any(vehicle_speed(self._api, foe) > 0.5 for lane in lanes for foe in vehicles_on_lane(self._api, lane))
