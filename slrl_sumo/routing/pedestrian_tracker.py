"""How the driver `lane` moves persons: along the edges of their walk, at their own pace."""

import math
import random
from dataclasses import dataclass

import numpy as np

from slrl_sumo.routing.walk_graph import CrossingEntry, WalkPath, Walkways
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.links import read_links
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.road_users import walk_of, walking_speed

AIM = 1.0
"""m along the walk to the point that a person heads for."""
CLEARANCE = 0.3
"""m kept from the edge of what can be walked on."""
KERB = 0.6
"""m before a crossing at which persons wait for its signal."""
ASTRAY = 4.0
"""m beside its walk beyond which a person that goes where it wants is somewhere else on it, or on another one."""
STRAYED = 0.5
"""m from where it was moved to: somebody else moved the person, and its walk is looked for anew."""


@dataclass(slots=True)
class PedestrianTrack:
    """What is known of one person."""

    walk: WalkPath | None
    s: float
    beside: float
    """m to the left of the walk's line that the person keeps."""
    pace: float
    x: float
    y: float


class PedestrianTracker:
    """Persons under way, through `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._ways = Walkways(api, network)
        self._network = network
        self._pedestrians: dict[str, PedestrianTrack] = {}
        self._reds: dict[tuple[str, str], bool | None] = {}

    def renew(self) -> None:
        """Forget what was read of SUMO's last step."""
        self._reds.clear()

    def step(self, person: str, x: float, y: float, heading: float, dt: float) -> tuple[float, float, float]:
        """Where a person at a position (m) with a heading (rad) is `dt` s later."""
        stroll = self._pedestrians.get(person)
        moved = math.inf if stroll is None else math.hypot(x - stroll.x, y - stroll.y)
        if stroll is None or moved > STRAYED or (person.startswith("learned_") and _is_out(stroll)):
            stroll = self._pedestrians[person] = self._begin(person, x, y, heading)
        if stroll.walk is not None:
            x, y, heading = self._onward(stroll, stroll.walk, x, y, heading, dt)
        stroll.x, stroll.y = x, y
        return x, y, heading

    def followed(self, person: str, x: float, y: float, heading: float) -> PedestrianTrack:
        """What is known of a person that goes where it wants, at a position (m), with a heading (rad)."""
        stroll = self._pedestrians.get(person)
        if stroll is not None and (walk := stroll.walk) is not None:
            place, _, distance = walk.line.place(x, y, stroll.s - 2.0, stroll.s + 4.0)
            if distance > ASTRAY:
                # The walk is asked for once, when a person of the scenario is taken over: later it is cut.
                place, _ = walk.line.nearest(x, y, stroll.s - 2.0)
            stroll.s = place
        if stroll is None or (
            person.startswith("learned_") and (_is_out(stroll) or math.hypot(x - stroll.x, y - stroll.y) > ASTRAY)
        ):
            stroll = self._pedestrians[person] = self._begin(person, x, y, heading)
        stroll.x, stroll.y = x, y
        return stroll

    def stop(self, stroll: PedestrianTrack) -> tuple[float, float, bool]:
        """m to where a person must stop (inf: nowhere), m to the next crossing with a signal, and whether that is
        red."""
        for kerb in stroll.walk.kerbs if stroll.walk is not None else ():
            if kerb.s > stroll.s:
                red = self._red(kerb)
                if red is None:
                    break
                return (kerb.s - KERB - stroll.s if red else math.inf), kerb.s - stroll.s, red
        return math.inf, math.inf, False

    def left(self, person: str) -> float:
        """m that a person still has to walk on edges; inf for one not known, or who walks without destination."""
        stroll = self._pedestrians.get(person)
        if stroll is None or person.startswith("learned_"):
            return math.inf
        return stroll.walk.leave - stroll.s if stroll.walk is not None else 0.0

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of persons."""
        for person in ids:
            self._pedestrians.pop(person, None)

    def _begin(self, person: str, x: float, y: float, heading: float) -> PedestrianTrack:
        if person.startswith("learned_"):
            walk = self._wander(person, x, y, heading)
            pace = 1.3
        else:
            # Asked before the walk is cut to the edge under the person (see `TakenOverControl.move`).
            walk = self._ways.walk(*walk_of(self._api, person))
            pace = walking_speed(self._api, person)
        if walk is None:
            return PedestrianTrack(None, 0.0, 0.0, pace, x, y)
        s, beside = walk.line.nearest(x, y, end=walk.first)
        room = max(walk.half_width - CLEARANCE, 0.0)
        return PedestrianTrack(walk, s, min(max(beside, -room), room), pace, x, y)

    def _wander(self, person: str, x: float, y: float, heading: float) -> WalkPath | None:
        under = self._network.walks
        if not len(under):
            return None
        point = int(under.nearest(np.array([x]), np.array([y]))[0, 0])
        forward = abs(float(wrap_angle(under.heading[point] - heading))) < 0.5 * math.pi
        edge = under.lanes[under.lane[point]].edge
        return self._ways.wandering(edge, forward, random.Random(f"{person}:{edge}"))

    def _onward(
        self, stroll: PedestrianTrack, walk: WalkPath, x: float, y: float, heading: float, dt: float
    ) -> tuple[float, float, float]:
        line = walk.line
        room = min(stroll.pace * dt, line.end - stroll.s)
        for kerb in walk.kerbs:
            if kerb.s - KERB - stroll.pace * dt < stroll.s < kerb.s and self._red(kerb):
                room = min(room, max(kerb.s - KERB - stroll.s, 0.0))
        if room <= 0.01:
            return x, y, heading
        aim_x, aim_y, direction = line.at(min(stroll.s + max(AIM, 2.0 * room), line.end + AIM))
        aim_x -= stroll.beside * math.sin(direction)
        aim_y += stroll.beside * math.cos(direction)
        heading = math.atan2(aim_y - y, aim_x - x)
        x, y = x + room * math.cos(heading), y + room * math.sin(heading)
        reached, _ = line.nearest(x, y, begin=stroll.s, end=stroll.s + 4.0 * room + AIM)
        # Where the line turns back on itself the nearest place can stand still: go on with it.
        stroll.s = max(reached, stroll.s + 0.2 * room)
        return x, y, heading

    def _red(self, kerb: CrossingEntry) -> bool | None:
        """Whether the signal at a crossing is red; None where there is none."""
        key = (kerb.lane, kerb.crossing)
        if key not in self._reds:
            shown = [link.state for link in read_links(self._api, kerb.lane) if link.target == kerb.crossing]
            signal = any(state in "gGyYru" for state in shown)
            self._reds[key] = any(state in "ru" for state in shown) if signal else None
        return self._reds[key]


def _is_out(stroll: PedestrianTrack) -> bool:
    """Whether a walk without destination is at its end: it is drawn anew there."""
    return stroll.walk is not None and stroll.walk.line.end - stroll.s < 2.0 * AIM
