"""Trips of all road users, from departure to arrival."""

from dataclasses import dataclass

import numpy as np

from slrl_sumo.formats.trajectories import Trajectories, road_users
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import arrived_ids, departure_delay, loaded_ids, type_id, wanted_speed

MOVING_SPEED = 0.5
"""Speed (m/s) above which a stopped road user has started again, so that speeds around STANDING_SPEED are one stop."""
SHORTEST_STOP = 1.0
"""Least duration (s) of a stop: a pedestrian that is handed back to SUMO stands for one step, which is no stop."""


@dataclass
class Trip:
    """The trip of a road user; times in s. Sums are from the departure to the arrival, or to the last observed step."""

    type: int
    """RoadUserType."""
    sumo_type: str
    """vType, without the suffix that SUMO appends for a vehicle with changed parameters."""
    departed: float
    """Time at which the road user entered the network."""
    departure_delay: float
    """Time for which a vehicle waited for room on its first lane; 0 for persons."""
    arrived: float | None = None
    """Begin of the SUMO step of the arrival, as in SUMO's tripinfo. None before the arrival."""
    time_loss: float = 0.0
    """Additional time compared with the same path at the desired speed: the sum of dt (1 - v / v_desired), as in SUMO's
    tripinfo. The desired speed of a vehicle is the lane's limit times its speed factor, at most its top speed; the
    desired speed of a person is its walking speed."""
    stops: int = 0
    """Number of stops (below 0.1 m/s) of at least SHORTEST_STOP after a motion."""
    standing: float = 0.0
    distance: float = 0.0
    """m."""


class Stops:
    """Adds distance, standing and stops to trips."""

    def __init__(self) -> None:
        self._moving: set[str] = set()
        self._still: dict[str, float] = {}
        """Standing time (s) of each standing road user."""

    def add(self, trip: Trip, road_user: str, speed: float, dt: float) -> None:
        """Add `dt` s at `speed` (m/s) to the trip of a road user."""
        trip.distance += speed * dt
        if speed >= STANDING_SPEED:
            self._still.pop(road_user, None)
            if speed > MOVING_SPEED:
                self._moving.add(road_user)
            return
        trip.standing += dt
        still = self._still[road_user] = self._still.get(road_user, 0.0) + dt
        if still > SHORTEST_STOP - 1e-9 and road_user in self._moving:
            self._moving.remove(road_user)
            trip.stops += 1


class Trips:
    """Trips of all road users, observed through `api` (libsumo or a TraCI connection); call `update` after each
    step."""

    def __init__(self, api: SumoApi, step_length: float) -> None:
        self.all: dict[str, Trip] = {}
        self._api, self._step = api, step_length
        self._stops = Stops()

    def update(self, world: WorldState, now: float) -> None:
        """Update the trips. `world`: all road users after the step; `now`: time after the step, s."""
        api, dt = self._api, self._step
        for road_user in arrived_ids(api):
            if road_user in self.all:
                self.all[road_user].arrived = now - dt
        known = loaded_ids(api)
        for road_user, kind, speed in zip(world.ids, world.type.tolist(), world.speed.tolist(), strict=True):
            if road_user not in known:  # arrived in this step
                continue
            trip = self.all.get(road_user) or self._begin(road_user, kind, now)
            walking = kind == RoadUserType.PEDESTRIAN
            desired = wanted_speed(api, road_user, walking)
            if desired > 0.0:
                trip.time_loss += dt * max(0.0, 1.0 - speed / desired)
            self._stops.add(trip, road_user, speed, dt)

    def _begin(self, road_user: str, kind: int, now: float) -> Trip:
        walks = kind == RoadUserType.PEDESTRIAN
        delay = 0.0 if walks else departure_delay(self._api, road_user)
        sumo_type = type_id(self._api, road_user, walks).split("@")[0]
        self.all[road_user] = trip = Trip(kind, sumo_type, now - self._step, delay)
        return trip


def trips_of_trace(tracks: Trajectories, desired: Floats | None = None) -> dict[str, Trip]:
    """Trips of the road users of a trace that appear after its first time step.

    A road user that is missing in the last time step has arrived. A trip lasts from the first moment of a road user to
    its disappearance, in the tracks `id`, `id#1`, … If a track follows another one directly (at a jump), the interval
    between them has the speed of the following track. A trace has no waiting times before departures: `departure_delay`
    is 0. `desired`: desired speed in each row, m/s, (R,), for `time_loss`, which is 0 in rows with 0; None: 0 in all
    rows.
    """
    trips: dict[str, Trip] = {}
    stops, frames = Stops(), tracks.frames
    speed = tracks.speed.tolist()
    limit = np.zeros(len(tracks)) if desired is None else desired
    share = np.divide(tracks.speed, limit, out=np.ones(len(tracks)), where=limit > 0.0)
    lost = tracks.dt * np.maximum(0.0, 1.0 - share)
    seen: dict[str, int] = {}  # last frame of each road user's track before
    for track, road_user in enumerate(road_users(tracks.ids)):
        first, end = tracks.starts[track : track + 2].tolist()
        begin, last = (int(tracks.frame[row]) for row in (first, end - 1))
        before, seen[road_user] = seen.get(road_user, -1), last
        if begin == 0 or (before >= 0 and road_user not in trips):
            continue
        departed, gone = (tracks.t0 + frame * tracks.dt for frame in (begin, last + 1))
        trip = trips.setdefault(road_user, Trip(int(tracks.type[track]), "", departed, 0.0))
        trip.arrived = gone if last < frames[-1] else None
        since = first if before == begin - 1 else first + 1
        trip.time_loss += float(lost[since:end].sum())
        for row in range(since, end):
            stops.add(trip, road_user, speed[row], tracks.dt)
    return trips
