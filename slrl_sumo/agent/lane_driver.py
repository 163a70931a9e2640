"""The driver `lane`: each road user follows its lane and route, roughly as in SUMO. A baseline without models.

Speeds are Krauss' safe speeds with regard to SUMO's leader, signals, priority, lane limits, and all boxes on the path,
within the acceleration and deceleration of the vehicle's type. Persons walk along the edges of their walk.
"""

import math
import random
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.obstacles import Approach, slowed
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.pedestrian_tracker import PedestrianTracker
from slrl_sumo.routing.routes import is_near_end
from slrl_sumo.routing.speed_limits import SpeedLimits
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.routing.vehicle_tracker import VehicleTracker
from slrl_sumo.routing.waiting_persons import WaitingPersons
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import SPAWNED_PREFIX, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals

SIDEWAYS = 1.5
"""m/s at most across the lane, and at most `SLANT` of the speed."""
SLANT = 0.3
SIDEWAYS_ACCELERATION = 1.0
"""m/s² with which a move across the lane ends."""
OFF_END = 12.0
"""m beyond the end of its path that a road user without destination continues."""
STANDSTILL_TIME = 6.0
"""s after which a vehicle goes on that stands because of another standing vehicle that is not ahead in its lane."""


class LaneDriver:
    """Drives taken-over and spawned road users.

    Spawned road users (ids `learned_…`) have no route: at junctions they continue at random, equally in every run.
    `refusals`: road users for which SUMO has refused a call; they stay where they are.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self._api, self._levels = api, network.levels
        self._graph = LaneGraph(api, network)
        self._vehicles = VehicleTracker(api, network, self._graph)
        self._speed_limits = SpeedLimits(api, self._graph, self._vehicles, RightOfWay(api, self._graph))
        self._pedestrians = PedestrianTracker(api, network)
        self._waiting = WaitingPersons(api, network)

    def drive(self, learned: WorldState, dt: float, others: WorldState | None = None) -> WorldState:
        """The state of n road users `dt` s later.

        `others`: the rest of the world, which SUMO's leaders do not cover (persons, crossing vehicles). Speeds are the
        distances between centres over time.
        """
        self._speed_limits.renew()
        self._pedestrians.renew()
        x, y, heading = learned.x.copy(), learned.y.copy(), learned.heading.copy()
        walking = learned.type == RoadUserType.PEDESTRIAN
        for i in np.flatnonzero(walking).tolist():
            with self.refusals.of(learned.ids[i]):
                x[i], y[i], heading[i] = self._pedestrians.step(learned.ids[i], x[i], y[i], heading[i], dt)
        world = learned if others is None else self._waiting.at_kerb(learned.join(others), len(learned))
        tracks: dict[int, VehicleTrack] = {}
        for i in np.flatnonzero(~walking).tolist():
            with self.refusals.of(learned.ids[i]):
                tracks[i] = self._vehicles.planned(learned, i)
        for i, track in tracks.items():
            self._vehicles.choose_lane(learned.ids[i], track, world, i)
        obstacles = self._obstacles(world, np.array(list(tracks), np.intp), list(tracks.values()), dt)
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
        """Which of n driven road users are so near their destination that SUMO should finish the trip, (n,)."""
        near = []
        for i in ids:
            track = self._vehicles.get(i)
            left = min(self._vehicles.remaining_distance(i), self._pedestrians.remaining_distance(i))
            near.append(is_near_end(left, 0.0 if track is None else track.speed))
        return np.array(near, np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the tracks of road users that are no longer driven."""
        self._vehicles.forget(ids)
        self._pedestrians.forget(ids)

    def _obstacles(
        self, world: WorldState, rows: NDArray[np.intp], tracks: list[VehicleTrack], dt: float
    ) -> list[tuple[float, bool]]:
        """For each track the speed (m/s) that road users on its path allow, and whether the decisive one stands."""
        if not tracks:
            return []
        look = max(d.speed * (dt + 0.5) + d.speed**2 / (2.0 * d.decel) + 8.0 for d in tracks)
        ahead = SPACING * np.arange(int(look / SPACING) + 2)
        approach = Approach(
            rows=rows,
            path_x=np.array([np.interp(d.s + ahead, d.path.line.s, d.path.line.x) for d in tracks]),
            path_y=np.array([np.interp(d.s + ahead, d.path.line.s, d.path.line.y) for d in tracks]),
            room=np.array([d.path.line.end - d.s for d in tracks]),
            speed=np.array([d.speed for d in tracks]),
            limits=np.array([[d.accel, d.decel, d.emergency] for d in tracks]),
            ignores_standing=np.array([world.time < d.ignores_standing_until for d in tracks]),
        )
        safe, standing = slowed(approach, world, dt, self._levels)
        return list(zip(safe.tolist(), standing.tolist(), strict=True))

    def _advance(
        self, state: WorldState, i: int, track: VehicleTrack, safe: float, standing: bool, dt: float
    ) -> tuple[float, float, float]:
        """Move along the path for `dt` s; returns the new centre and heading."""
        road_user, length = state.ids[i], float(state.length[i])
        allowed = self._speed_limits.allowed_speed(track, dt)
        following = min(safe, self._speed_limits.following_speed(road_user, track, dt))
        low = track.speed - track.decel * dt
        speed = min(track.speed + track.accel * dt, max(allowed, low))
        speed = max(min(speed, max(following, track.speed - track.emergency * dt)), 0.0)
        track.obstructed = safe < min(allowed, track.speed + track.accel * dt)
        track.standing_time = track.standing_time + dt if speed < 0.1 else 0.0
        if standing and safe < 0.5 and track.standing_time > STANDSTILL_TIME + 4.0 * random.Random(road_user).random():
            track.ignores_standing_until, track.standing_time = state.time + 5.0, 0.0
        # Spawned vehicles have no destination: they leave the network at its end, and are reinserted.
        beyond = OFF_END if road_user.startswith(SPAWNED_PREFIX) else 0.0
        track.speed = speed = min(speed, max(track.path.end + beyond - track.s, 0.0) / dt)
        track.s += speed * dt
        self._centre(track, dt)
        line = track.path.line
        front_x, front_y, direction = line.at(track.s)
        rear_x, rear_y, _ = line.at(track.s - length)
        front_x, front_y = (
            front_x - track.lateral_offset * math.sin(direction),
            front_y + track.lateral_offset * math.cos(direction),
        )
        heading = math.atan2(line.at(track.s)[1] - rear_y, line.at(track.s)[0] - rear_x)
        heading += math.atan2(track.lateral_speed, max(speed, 0.5))
        track.x, track.y = front_x - 0.5 * length * math.cos(heading), front_y - 0.5 * length * math.sin(heading)
        return track.x, track.y, heading

    def _centre(self, track: VehicleTrack, dt: float) -> None:
        """Move towards the middle of the lane, slowly enough not to move sideways visibly."""
        most = min(SIDEWAYS, SLANT * track.speed, math.sqrt(2.0 * SIDEWAYS_ACCELERATION * abs(track.lateral_offset)))
        most = min(most, abs(track.lateral_offset) / dt, abs(track.lateral_speed) + 2.0 * SIDEWAYS_ACCELERATION * dt)
        track.lateral_speed = -math.copysign(most, track.lateral_offset)
        track.lateral_offset += track.lateral_speed * dt
