"""The driver `lane`: each road user follows its lane and route, roughly as in SUMO. A baseline without models.

Speeds are safe speeds of Krauss' model for SUMO's leader, signals, priority, lane limits, and all boxes on the path,
within the acceleration and deceleration of the vehicle's type. Persons walk along the edges of their walk.
"""

import math
import random
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.driver import Moved
from slrl_sumo.agent.lane_baseline.obstacles import Approach, slowed
from slrl_sumo.agent.lane_baseline.speeds import LaneSpeeds
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.routing.lane_choice import LaneChoice
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.routes import is_near_end
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.routing.walking.pedestrian_tracker import PedestrianTracker
from slrl_sumo.routing.walking.waiting_persons import WaitingPersons
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, SPAWNED_PREFIX, STANDING_SPEED, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals

SIDEWAYS = 1.5
"""Greatest lateral speed (m/s) in the lane; also at most `SLANT` of the speed."""
SLANT = 0.3
SIDEWAYS_ACCELERATION = 1.0
"""Lateral deceleration (m/s²) at the end of a lateral movement."""
OFF_END = 12.0
"""Distance (m) past the end of its path that a road user without destination continues."""
STANDSTILL_TIME = 6.0
"""Standing time (s) after which a vehicle ignores standing vehicles that are not ahead in its lane."""


@dataclass(slots=True)
class _Motion:
    """State of a vehicle between decisions."""

    lateral_speed: float = 0.0
    """Lateral speed (m/s) to the left of the path."""
    standing_time: float = 0.0
    """Standing time, s."""
    obstructed: bool = False
    """Whether a road user on its path slows the vehicle down."""
    ignores_standing_until: float = -math.inf
    """Time (s) until which standing vehicles beside its lane do not stop the vehicle."""


class LaneDriver:
    """Drives taken-over and spawned road users, see Driver.

    Spawned road users (ids `learned_…`) have no route: at junctions they continue at random, in every run in the same
    way. `refusals`: road users for which SUMO has refused a call; they stay at their position.
    """

    has_models = False

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self.max_speed: Floats = np.full(len(RoadUserType), np.inf)
        self.hardest_braking: Floats = np.full(len(RoadUserType), -np.inf)
        self._levels, self._graph = network.levels, LaneGraph(api, network)
        self._vehicles = VehicleTracker(api, network, self._graph)
        self._lane_choice = LaneChoice(self._graph, self._vehicles, network.levels)
        self._speeds = LaneSpeeds(api, self._graph, self._vehicles)
        self._motions: dict[str, _Motion] = {}
        self._pedestrians = PedestrianTracker(api, network)
        self._waiting = WaitingPersons(api, network)

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        """See Driver."""
        return Moved(self.moved(world, n, DECISION_INTERVAL), None, {})

    def moved(self, world: WorldState, n: int, dt: float) -> WorldState:
        """The state of the first `n` road users of `world` `dt` s later; speed is the distance of centres over time."""
        self._graph.renew()
        self._speeds.renew()
        self._pedestrians.renew()
        learned = world.take(np.arange(n))
        x, y, heading = learned.x.copy(), learned.y.copy(), learned.heading.copy()
        walking = learned.type == RoadUserType.PEDESTRIAN
        for i in np.flatnonzero(walking).tolist():
            with self.refusals.of(learned.ids[i]):
                x[i], y[i], heading[i] = self._pedestrians.step(learned.ids[i], x[i], y[i], heading[i], dt)
        world = self._waiting.at_kerb(world, n)
        tracks: dict[int, VehicleTrack] = {}
        for i in np.flatnonzero(~walking).tolist():
            with self.refusals.of(learned.ids[i]):
                tracks[i] = self._vehicles.planned(learned, i)
                self._motions.setdefault(learned.ids[i], _Motion())
        for i, track in tracks.items():
            self._lane_choice.choose(track, world, i)
        obstacles = self._obstacles(world, tracks, dt)
        for (i, track), (safe, standing) in zip(tracks.items(), obstacles, strict=True):
            with self.refusals.of(learned.ids[i]):
                x[i], y[i], heading[i] = self._advance(learned, i, track, safe, standing, dt)
        speed = np.hypot(x - learned.x, y - learned.y) / dt
        return replace(
            learned,
            time=learned.time + dt,
            x=x,
            y=y,
            heading=wrap_angle(heading),
            speed=speed,
            acceleration=(speed - learned.speed) / dt,
            yaw_rate=wrap_angle(heading - learned.heading) / dt,
        )

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: SUMO finishes trips, because only SUMO can remove a road user from the network as arrived."""
        return np.array([self._is_near_end(road_user) for road_user in ids], np.bool_)

    def _is_near_end(self, road_user: str) -> bool:
        motion, track = self._motions.get(road_user), self._vehicles.get(road_user)
        # An obstructed vehicle stays with this driver: SUMO would brake harder for the obstacle, or not at all.
        if track is not None and motion is not None and not motion.obstructed:
            return is_near_end(self._vehicles.remaining_distance(road_user), track.speed)
        return is_near_end(self._pedestrians.remaining_distance(road_user), 0.0)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: vehicles never leave their lanes."""
        return np.zeros(len(ids), np.bool_)

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """See Driver: no turn is too sharp."""
        return np.zeros(len(ids), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """See Driver."""
        self._vehicles.forget(ids)
        self._pedestrians.forget(ids)
        for road_user in ids:
            self._motions.pop(road_user, None)

    def _obstacles(self, world: WorldState, tracks: dict[int, VehicleTrack], dt: float) -> list[tuple[float, bool]]:
        """For each track, the speed (m/s) that road users on its path allow, and whether the decisive one stands.

        `tracks`: by row of the world.
        """
        if not tracks:
            return []
        every = list(tracks.values())
        look = max(d.speed * (dt + 0.5) + d.speed**2 / (2.0 * d.parameters.decel) + 8.0 for d in every)
        ahead = SPACING * np.arange(int(look / SPACING) + 2)
        ignores = [world.time < self._motions[world.ids[row]].ignores_standing_until for row in tracks]
        limits = [(d.parameters.accel, d.parameters.decel, d.parameters.emergency_decel) for d in every]
        approach = Approach(
            rows=np.array(list(tracks), np.intp),
            path_x=np.array([np.interp(d.s + ahead, d.path.line.s, d.path.line.x) for d in every]),
            path_y=np.array([np.interp(d.s + ahead, d.path.line.s, d.path.line.y) for d in every]),
            room=np.array([d.path.line.end - d.s for d in every]),
            speed=np.array([d.speed for d in every]),
            limits=np.array(limits),
            ignores_standing=np.array(ignores),
        )
        safe, standing = slowed(approach, world, dt, self._levels)
        return list(zip(safe.tolist(), standing.tolist(), strict=True))

    def _advance(
        self, state: WorldState, i: int, track: VehicleTrack, safe: float, standing: bool, dt: float
    ) -> tuple[float, float, float]:
        """Move along the path for `dt` s; returns the new centre and heading."""
        road_user, length = state.ids[i], float(state.length[i])
        motion, own = self._motions[road_user], track.parameters
        allowed = self._speeds.allowed(track, motion.standing_time, dt)
        following = min(safe, self._speeds.following(road_user, track, dt))
        low = track.speed - own.decel * dt
        speed = min(track.speed + own.accel * dt, max(allowed, low))
        speed = max(min(speed, max(following, track.speed - own.emergency_decel * dt)), 0.0)
        motion.obstructed = safe < min(allowed, track.speed + own.accel * dt)
        motion.standing_time = motion.standing_time + dt if speed < STANDING_SPEED else 0.0
        patience = STANDSTILL_TIME + 4.0 * random.Random(road_user).random()
        if standing and safe < 0.5 and motion.standing_time > patience:
            motion.ignores_standing_until, motion.standing_time = state.time + 5.0, 0.0
        # Spawned vehicles have no destination: they leave the network at the end of their path, and are reinserted.
        beyond = OFF_END if road_user.startswith(SPAWNED_PREFIX) else 0.0
        track.speed = speed = min(speed, max(track.path.end + beyond - track.s, 0.0) / dt)
        track.s += speed * dt
        _centre(track, motion, dt)
        line = track.path.line
        front_x, front_y, direction = line.at(track.s)
        rear_x, rear_y, _ = line.at(track.s - length)
        front_x, front_y = (
            front_x - track.lateral_offset * math.sin(direction),
            front_y + track.lateral_offset * math.cos(direction),
        )
        heading = math.atan2(line.at(track.s)[1] - rear_y, line.at(track.s)[0] - rear_x)
        heading += math.atan2(motion.lateral_speed, max(speed, 0.5))
        track.x, track.y = front_x - 0.5 * length * math.cos(heading), front_y - 0.5 * length * math.sin(heading)
        return track.x, track.y, heading


def _centre(track: VehicleTrack, motion: _Motion, dt: float) -> None:
    """Move the vehicle towards the centre line of its lane, slowly enough that the lateral movement is not visible."""
    most = min(SIDEWAYS, SLANT * track.speed, math.sqrt(2.0 * SIDEWAYS_ACCELERATION * abs(track.lateral_offset)))
    most = min(most, abs(track.lateral_offset) / dt, abs(motion.lateral_speed) + 2.0 * SIDEWAYS_ACCELERATION * dt)
    motion.lateral_speed = -math.copysign(most, track.lateral_offset)
    track.lateral_offset += motion.lateral_speed * dt
