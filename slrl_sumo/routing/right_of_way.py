"""Signals and priority at the places where the ways of vehicles enter junctions."""

import math
from typing import Literal

from slrl_sumo.routing.lane_graph import JunctionEntry, LaneGraph
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.links import foe_lanes, internal_foe_lanes, read_links
from slrl_sumo.sumo.road_users import lane_position, vehicle_speed, vehicles_on_lane

STOP_LINE = 1.0
"""m that vehicles stop before a line."""
LINE_OF_SIGHT = 4.5
"""m before a junction from which vehicles see those that they have to let pass (SUMO's foeVisibilityDistance)."""
PATIENCE = 10.0
"""s of standing after which a vehicle no longer trusts that SUMO knows who comes; twice that, and it goes first."""
_SHOWN = {"g": 1, "G": 1, "y": 2, "Y": 2, "r": 3, "u": 3}
"""https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html: other letters are those of junctions without a signal."""


class RightOfWay:
    """Whether vehicles may enter, as SUMO's signals and links say now. Call `renew` when SUMO has made a step."""

    def __init__(self, api: SumoApi, graph: LaneGraph, *, trusting: bool = True) -> None:
        """`trusting`: believe SUMO for PATIENCE where it says that somebody comes; otherwise see who does."""
        self._api = api
        self._trusting = trusting
        self._graph = graph
        self._states: dict[str, dict[tuple[str, str], tuple[bool, bool, str]]] = {}
        self._before: dict[tuple[str, str], tuple[str, ...]] = {}
        self._origins: dict[str, str] = {}
        self._inside: dict[str, tuple[str, ...]] = {}

    def renew(self) -> None:
        """Forget what was read of SUMO's last step."""
        self._states.clear()

    def red(self, entry: JunctionEntry) -> bool:
        """Whether a crossing or junction is closed by a signal now."""
        return self._state(entry)[2] in "ru"

    def speed(
        self, entry: JunctionEntry, distance: float, speed: float, limits: tuple[float, float], waited: float
    ) -> float:
        """The speed (m/s) that signal and priority at a entry allow a vehicle; inf where they have no say.

        `distance`: m from its front to the line; `speed`: its own in m/s; `limits`: its acceleration and deceleration
        in m/s²; `waited`: s that it has stood.
        """
        said = self.says(entry, distance, speed, limits, waited)
        if said == "stop":
            return math.sqrt(2.0 * limits[1] * max(distance - STOP_LINE, 0.0))
        if said == "look":
            return math.sqrt(2.0 * limits[1] * max(distance, LINE_OF_SIGHT))
        return math.inf

    def says(
        self, entry: JunctionEntry, distance: float, speed: float, limits: tuple[float, float], waited: float
    ) -> Literal["go", "look", "stop"]:
        """What signal and priority at a entry say: go on, come slowly and look, or stop at the line; as for `speed`."""
        acceleration, deceleration = limits
        to_stop = speed * speed / (2.0 * deceleration)
        prior, is_open, state = self._state(entry)
        if state in "ru":
            return "stop"
        if state in "yY":
            return "stop" if to_stop + STOP_LINE <= distance else "go"
        # Too late to stop: those with priority had been far away.
        if prior or state in "GM" or to_stop > distance + 1.0:
            return "go"
        if distance > LINE_OF_SIGHT + speed:
            return "look"
        clear = _time(distance + entry.out - entry.line + 5.0, speed, acceleration)
        if self._trusting and waited < PATIENCE:
            return "stop" if not is_open or self._comes(entry, clear) else "look"
        # Vehicles whose speed mode is 0, as of all that are taken over, count for SUMO as coming even where they wait
        # at red: a link may never be open. Then what moves decides, and at last only what moves inside.
        closed = self._trusting or not is_open
        faith = PATIENCE * (2.0 if self._trusting else 1.0)
        blocked = closed and (self._busy(entry) or (waited < faith and self._comes(entry, clear)))
        return "stop" if blocked else "look"

    def signal(self, entry: JunctionEntry) -> int:
        """What the signal at a entry shows: 0 there is none, 1 green, 2 yellow, 3 red."""
        return _SHOWN.get(self._state(entry)[2], 0)

    def _state(self, entry: JunctionEntry) -> tuple[bool, bool, str]:
        """Of a link: whether it has priority, whether it is open now, and its state as SUMO's letter."""
        return self._links(entry.lane).get((entry.target, entry.via), (True, True, "M"))

    def _links(self, lane: str) -> dict[tuple[str, str], tuple[bool, bool, str]]:
        """Of the links from a lane, by target and lane inside: priority, open now, and state as SUMO's letter."""
        states = self._states.get(lane)
        if states is None:
            states = self._states[lane] = {
                (link.target, link.via): (link.has_priority, link.is_open, link.state)
                for link in read_links(self._api, lane)
            }
        return states

    def _comes(self, entry: JunctionEntry, within: float) -> bool:
        """Whether a moving vehicle with priority reaches the junction within so many seconds."""
        key = (self._origin(entry.lane), entry.target)
        lanes = self._before.get(key)
        if lanes is None:
            lanes = self._before[key] = foe_lanes(self._api, *key)
        for lane in lanes:
            if self._held(lane):
                continue
            length = self._graph.lanes[lane].length
            for foe in vehicles_on_lane(self._api, lane):
                pace = vehicle_speed(self._api, foe)
                if pace > 1.0 and length - lane_position(self._api, foe) < pace * within:
                    return True
        return False

    def _held(self, lane: str) -> bool:
        """Whether everybody on a lane has red now."""
        states = self._links(lane).values()
        return bool(states) and all(state in "ru" for _, _, state in states)

    def _busy(self, entry: JunctionEntry) -> bool:
        """Whether somebody who came from another lane moves inside the junction on a lane that crosses this way."""
        lanes = self._inside.get(entry.via)
        if lanes is None:
            origin = self._origin(entry.lane)
            foes = internal_foe_lanes(self._api, entry.via)
            lanes = self._inside[entry.via] = tuple(
                lane for lane in foes if lane in self._graph.lanes and self._origin(lane) != origin
            )
        return any(vehicle_speed(self._api, foe) > 0.5 for lane in lanes for foe in vehicles_on_lane(self._api, lane))

    def _origin(self, lane: str) -> str:
        """The lane that leads to a lane inside a junction, from outside; any other lane itself."""
        if not self._origins:
            for begin in self._graph.lanes:
                if begin.startswith(":"):
                    continue
                for _, via in self._graph.links(begin):
                    while via and via not in self._origins:
                        self._origins[via] = begin
                        via = next((inner for _, inner in self._graph.links(via)), "")
        return self._origins.get(lane, lane)


def _time(distance: float, speed: float, acceleration: float) -> float:
    """s to cover `distance` (m) from `speed` (m/s) with `acceleration` (m/s²)."""
    return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
