"""Tracks of pedestrians: their paths along the edges of their walks, and their speeds."""

import math
import random
from dataclasses import dataclass

import numpy as np

from slrl_sumo.routing.walking.walk_graph import WalkGraph
from slrl_sumo.routing.walking.walk_path import CrossingEntry, WalkPath
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.types import SPAWNED_PREFIX
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.links import ShownLinks
from slrl_sumo.sumo.road_users import person_edge, walk_of, walking_speed

AIM = 1.0
"""Distance (m) along the path to the point towards which a person walks."""
PAST = 0.5
"""Distance (m) past its waiting place, where the kerb is, up to which a person still counts as waiting there."""
KERB = 1.0
"""Distance (m) on a crossing up to which persons still wait for its signal: SUMO's persons stand on its edge, others
cut the corner before it. `metrics.traffic.signal_crossings` counts from this distance on."""
OFF_PATH = 4.0
"""Distance (m) beside its path beyond which an observed person is elsewhere on this path, or on another path."""
ASTRAY = 6.0
"""Distance (m) beside its path beyond which a person of the scenario gets a new path from its position: it would walk
beside its path, over the street. With 4 m, fewer vehicles arrive in jams at small signals: in `crowd` 0.75 instead of
0.86 of SUMO's vehicles."""
DISPLACED = 0.5
"""Distance (m) from the planned position beyond which SUMO or a user's script has moved the person: a new path is
needed."""
SPAWNED_SPEED = 1.3
"""Speed (m/s) of spawned pedestrians."""


@dataclass(slots=True)
class PedestrianTrack:
    """One person on its path."""

    path: WalkPath | None
    """Path of the person; None if no path is known: the person stands."""
    s: float
    """Position (m along the path)."""
    speed: float
    """Walking speed (m/s)."""
    x: float
    """Centre at the last update, m."""
    y: float
    begun: CrossingEntry | None = None
    """Crossing whose kerb the person passed while the signal was not red: it goes on, even if the lane of the crossing
    begins later."""


class PedestrianTracker:
    """The tracks of the learned pedestrians of a simulation, by id."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._graph = WalkGraph(api, network)
        self._network = network
        self._pedestrians: dict[str, PedestrianTrack] = {}
        self._links = ShownLinks(api)
        self._red: dict[tuple[str, str], bool | None] = {}

    def renew(self) -> None:
        """Drop the data of SUMO's last step."""
        self._links.renew()
        self._red.clear()

    def step(self, person: str, x: float, y: float, heading: float, dt: float) -> tuple[float, float, float]:
        """Position (m) and heading (rad) `dt` s later of a person that walks along its path."""
        track = self._pedestrians.get(person)
        moved = math.inf if track is None else math.hypot(x - track.x, y - track.y)
        if track is None or moved > DISPLACED or (person.startswith(SPAWNED_PREFIX) and _is_at_end(track)):
            track = self._pedestrians[person] = self._begin(person, x, y, heading)
        if track.path is not None:
            x, y, heading = self._advance(track, track.path, x, y, heading, dt)
        track.x, track.y = x, y
        return x, y, heading

    def observed(self, person: str, x: float, y: float, heading: float) -> PedestrianTrack:
        """The track of a person that moves freely, at a position (m) with a heading (rad)."""
        track = self._pedestrians.get(person)
        if track is not None and (path := track.path) is not None:
            s, _, distance = path.line.place(x, y, track.s - 2.0, track.s + 4.0)
            if distance > OFF_PATH:
                s, _, distance = path.line.place(x, y, track.s - 2.0, math.inf)
                if distance > ASTRAY and not person.startswith(SPAWNED_PREFIX):
                    # The walk of a person of the scenario is read once, at its takeover: after that SUMO keeps only
                    # part of it.
                    back = self._graph.back_on(path, s, _side(person), x, y)
                    track.path = path if back is None else back
                    s = s if back is None else back.line.nearest(x, y, end=back.ends[0])[0]
            track.s = s
        if track is None or (
            (_is_at_end(track) or math.hypot(x - track.x, y - track.y) > OFF_PATH) and person.startswith(SPAWNED_PREFIX)
        ):
            track = self._pedestrians[person] = self._begin(person, x, y, heading)
        track.x, track.y = x, y
        return track

    def next_signal(self, track: PedestrianTrack) -> tuple[float, float, bool]:
        """Distance (m) to the stop position (inf: none), distance (m) to the next crossing with a signal, whether
        red."""
        for entry in track.path.crossings if track.path is not None else ():
            if entry.s <= track.s - KERB or entry is track.begun:
                continue
            red = self._is_red(entry)
            if red is None:
                break
            if not red and track.s > entry.wait + PAST:
                track.begun = entry
            return (entry.wait - track.s if red else math.inf), entry.s - track.s, red
        return math.inf, math.inf, False

    def remaining_distance(self, person: str) -> float:
        """Remaining walking distance (m) of a person on edges; inf without a track, and for spawned pedestrians."""
        if person.startswith(SPAWNED_PREFIX) or (track := self._pedestrians.get(person)) is None:
            return math.inf
        return track.path.last_edge_end - track.s if track.path is not None else 0.0

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the tracks of persons."""
        for person in ids:
            self._pedestrians.pop(person, None)

    def _begin(self, person: str, x: float, y: float, heading: float) -> PedestrianTrack:
        if person.startswith(SPAWNED_PREFIX):
            path, speed = self._random_path(person, x, y, heading), SPAWNED_SPEED
        else:
            # Read before the walk is cut to the edge under the person (see `TakenOverControl.move`).
            here = person_edge(self._api, person)
            path = self._graph.path(*walk_of(self._api, person), _side(person), x, y, here)
            speed = walking_speed(self._api, person)
        if path is None:
            return PedestrianTrack(None, 0.0, speed, x, y)
        return PedestrianTrack(path, path.line.nearest(x, y, end=path.second_edge_end)[0], speed, x, y)

    def _random_path(self, person: str, x: float, y: float, heading: float) -> WalkPath | None:
        walks = self._network.walks
        if not len(walks):
            return None
        point = int(walks.nearest(np.array([x]), np.array([y]))[0, 0])
        forward = abs(float(wrap_angle(walks.heading[point] - heading))) < 0.5 * math.pi
        edge = walks.lanes[walks.lane[point]].edge
        return self._graph.random_path(edge, forward, _side(person), random.Random(f"{person}:{edge}"))

    def _advance(
        self, track: PedestrianTrack, path: WalkPath, x: float, y: float, heading: float, dt: float
    ) -> tuple[float, float, float]:
        line = path.line
        distance = min(track.speed * dt, line.end - track.s)
        for entry in path.crossings:
            if entry.wait - track.speed * dt < track.s < entry.s + KERB and self._is_red(entry):
                distance = min(distance, max(entry.wait - track.s, 0.0))
        if distance <= 0.01:
            return x, y, heading
        aim_x, aim_y, _ = line.at(min(track.s + max(AIM, 2.0 * distance), line.end + AIM))
        heading = math.atan2(aim_y - y, aim_x - x)
        x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
        reached, _ = line.nearest(x, y, begin=track.s, end=track.s + 4.0 * distance + AIM)
        # If the line turns back on itself, the nearest place may not move: advance by at least 0.2 of the distance.
        track.s = max(reached, track.s + 0.2 * distance)
        return x, y, heading

    def _is_red(self, entry: CrossingEntry) -> bool | None:
        """Whether the signal at a crossing is red; None without a signal."""
        key = (entry.lane, entry.crossing)
        if key not in self._red:
            states = [link.state for link in self._links(entry.lane).values() if link.target == entry.crossing]
            signal = any(state in "gGyYru" for state in states)
            self._red[key] = any(state in "ru" for state in states) if signal else None
        return self._red[key]


def _side(person: str) -> float:
    """Lateral position of a person on sidewalks and crossings (see `WalkGraph.path`): random, on the right side.

    If all persons walked on one line, a crossing 6 m wide would pass one person per second, like a narrow crossing.
    """
    return random.Random(person).uniform(-1.0, 0.0)


def _is_at_end(track: PedestrianTrack) -> bool:
    """Whether a person is near the end of its random path, so that it needs a new path."""
    path = track.path
    return path is not None and path.line.s[-1] - track.s < 2.0 * AIM
