"""The driver `lane`: follows its own lane and route as SUMO's vehicles do, roughly. A baseline, and a stand-in.

Speeds are Krauss' safe speeds with regard to SUMO's leader, signals, priority, lane limits, and whatever box lies on
the way; all within the acceleration and deceleration of the vehicle's type. Persons walk along the edges of their walk.
"""

import math
import random
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.obstacles import Approach, slowed
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.pedestrian_tracker import PedestrianTracker
from slrl_sumo.routing.routes import near_end
from slrl_sumo.routing.speed_limits import SpeedLimits
from slrl_sumo.routing.vehicle_tracker import VehicleTrack, VehicleTracker
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network

SIDEWAYS = 1.5
"""m/s at most across the lane, and at most `SLANT` of the speed."""
SLANT = 0.3
SIDEWAYS_ACCELERATION = 1.0
"""m/s² with which a move across the lane ends."""
OFF_END = 12.0
"""m beyond the end of its way that a road user without a destination goes on."""
IMPATIENCE = 6.0
"""s after which a vehicle that stands for another one that stands too, not ahead in its lane, goes on."""


class LaneDriver:
    """Drives road users through `api` (libsumo or a TraCI connection): those taken over, and those that we added.

    Road users that we added (ids `learned_…`) have no route: they go on at random at junctions, the same in every run.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._graph = LaneGraph(api, network)
        self._vehicles = VehicleTracker(api, network, self._graph)
        self._speed_limits = SpeedLimits(api, self._graph, self._vehicles)
        self._pedestrians = PedestrianTracker(api, network)

    def drive(self, learned: WorldState, dt: float, others: WorldState | None = None) -> WorldState:
        """The state of n road users `dt` s later.

        `others`: the rest of the world, which SUMO's leader does not tell of (persons, vehicles across the way). Speeds
        are the distance that centres cover, over time.
        """
        self._speed_limits.renew()
        self._pedestrians.renew()
        x, y, heading = learned.x.copy(), learned.y.copy(), learned.heading.copy()
        walking = learned.type == RoadUserType.PEDESTRIAN
        for i in np.flatnonzero(walking).tolist():
            x[i], y[i], heading[i] = self._pedestrians.step(learned.ids[i], x[i], y[i], heading[i], dt)
        rows = np.flatnonzero(~walking)
        world = learned if others is None else learned.join(others)
        drives = [self._vehicles.known(learned, i) for i in rows.tolist()]
        for i, drive in zip(rows.tolist(), drives, strict=True):
            self._vehicles.choose_lane(learned.ids[i], drive, world, i)
        held = self._obstacles(world, rows, drives, dt)
        for i, drive, (safe, standing) in zip(rows.tolist(), drives, held, strict=True):
            x[i], y[i], heading[i] = self._advance(learned, i, drive, safe, standing, dt)
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
        """Who of n driven road users has so little way left that SUMO should finish the trip, (n,)."""
        return near_end(self._vehicles, self._pedestrians, ids)

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop what is known of road users that are no longer driven."""
        self._vehicles.forget(ids)
        self._pedestrians.forget(ids)

    def _obstacles(
        self, world: WorldState, rows: NDArray[np.intp], drives: list[VehicleTrack], dt: float
    ) -> list[tuple[float, bool]]:
        """For each drive the speed that what lies on its way allows, and whether that is something that stands."""
        if not drives:
            return []
        look = max(d.speed * (dt + 0.5) + d.speed**2 / (2.0 * d.decel) + 8.0 for d in drives)
        ahead = SPACING * np.arange(int(look / SPACING) + 2)
        approach = Approach(
            rows=rows,
            path_x=np.array([np.interp(d.s + ahead, d.way.line.s, d.way.line.x) for d in drives]),
            path_y=np.array([np.interp(d.s + ahead, d.way.line.s, d.way.line.y) for d in drives]),
            room=np.array([d.way.line.end - d.s for d in drives]),
            speed=np.array([d.speed for d in drives]),
            limits=np.array([[d.accel, d.decel, d.emergency] for d in drives]),
            heedless=np.array([world.time < d.free_until for d in drives]),
        )
        safe, standing = slowed(approach, world, dt)
        return list(zip(safe.tolist(), standing.tolist(), strict=True))

    def _advance(
        self, state: WorldState, i: int, drive: VehicleTrack, safe: float, standing: bool, dt: float
    ) -> tuple[float, float, float]:
        """VehicleTrack on for `dt` s; the new centre and heading."""
        road_user, length = state.ids[i], float(state.length[i])
        calm = self._speed_limits.calm(drive, dt)
        hard = min(safe, self._speed_limits.behind(road_user, drive, dt))
        low = drive.speed - drive.decel * dt
        speed = min(drive.speed + drive.accel * dt, max(calm, low))
        speed = max(min(speed, max(hard, drive.speed - drive.emergency * dt)), 0.0)
        drive.held = safe < min(calm, drive.speed + drive.accel * dt)
        drive.stood = drive.stood + dt if speed < 0.1 else 0.0
        if standing and safe < 0.5 and drive.stood > IMPATIENCE + 4.0 * random.Random(road_user).random():
            drive.free_until, drive.stood = state.time + 5.0, 0.0
        # What we added has no destination: at the end of the network it drives off, and is looped.
        beyond = OFF_END if road_user.startswith("learned_") else 0.0
        drive.speed = speed = min(speed, max(drive.way.end + beyond - drive.s, 0.0) / dt)
        drive.s += speed * dt
        self._blend(drive, dt)
        line = drive.way.line
        front_x, front_y, direction = line.at(drive.s)
        rear_x, rear_y, _ = line.at(drive.s - length)
        front_x, front_y = (
            front_x - drive.beside * math.sin(direction),
            front_y + drive.beside * math.cos(direction),
        )
        heading = math.atan2(line.at(drive.s)[1] - rear_y, line.at(drive.s)[0] - rear_x)
        heading += math.atan2(drive.slide, max(speed, 0.5))
        drive.x, drive.y = front_x - 0.5 * length * math.cos(heading), front_y - 0.5 * length * math.sin(heading)
        return drive.x, drive.y, heading

    def _blend(self, drive: VehicleTrack, dt: float) -> None:
        """Move towards the middle of the lane, slowly enough not to slide."""
        most = min(SIDEWAYS, SLANT * drive.speed, math.sqrt(2.0 * SIDEWAYS_ACCELERATION * abs(drive.beside)))
        most = min(most, abs(drive.beside) / dt, abs(drive.slide) + 2.0 * SIDEWAYS_ACCELERATION * dt)
        drive.slide = -math.copysign(most, drive.beside)
        drive.beside += drive.slide * dt
