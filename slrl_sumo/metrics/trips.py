"""Everybody's trip, from the departure to the arrival."""

from dataclasses import dataclass

from slrl_sumo.metrics.counters import STANDING_SPEED
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import arrived_ids, departure_delay, loaded_ids, type_id, wanted_speed

MOVING_SPEED = 0.5
"""m/s; who has stopped has started again when it is faster than this: swaying about the limit is one stop."""
SHORTEST_STOP = 1.0
"""s; who is handed back to SUMO as a pedestrian stands for a step, which is none."""


@dataclass
class Trip:
    """One road user; times in s. Sums go from the departure to the arrival, or to the last step that was seen."""

    type: int
    """RoadUserType."""
    sumo_type: str
    """vType, without what SUMO appends to that of a vehicle that was changed."""
    departed: float
    """When it was first on the network."""
    departure_delay: float
    """How long a vehicle had to wait until there was room for it on its first lane; 0 for persons."""
    arrived: float | None = None
    """The begin of the SUMO step in which it arrived, as in SUMO's tripinfo. None where it had not arrived at the
    end."""
    time_loss: float = 0.0
    """Time beyond what the same way takes at the speed wanted: the sum of dt (1 - v / v_wanted), as SUMO's tripinfo has
    it. A vehicle wants the lane's limit times its speed factor, at most its own; a person its own walking speed."""
    stops: int = 0
    """How often it came to stand (below 0.1 m/s) for at least SHORTEST_STOP, after it had moved."""
    standing: float = 0.0
    distance: float = 0.0
    """m."""


class Trips:
    """Follows everybody through `api` (libsumo or a TraCI connection); call `look` after every SUMO step."""

    def __init__(self, api: SumoApi, step_length: float) -> None:
        self.all: dict[str, Trip] = {}
        self._api, self._step = api, step_length
        self._moving: set[str] = set()
        self._still: dict[str, float] = {}
        """s for which a road user has been standing."""

    def look(self, world: WorldState, now: float) -> None:
        """`world`: everybody after the step, `now`: the time then, s."""
        api, dt = self._api, self._step
        for road_user in arrived_ids(api):
            if road_user in self.all:
                self.all[road_user].arrived = now - dt
        known = loaded_ids(api)
        for road_user, kind, speed in zip(world.ids, world.type.tolist(), world.speed.tolist(), strict=True):
            if road_user not in known:  # it has arrived with this step
                continue
            trip = self.all.get(road_user) or self._begin(road_user, kind, now)
            walking = kind == RoadUserType.PEDESTRIAN
            wanted = wanted_speed(api, road_user, walking)
            if wanted > 0.0:
                trip.time_loss += dt * max(0.0, 1.0 - speed / wanted)
            trip.distance += speed * dt
            if speed >= STANDING_SPEED:
                self._still.pop(road_user, None)
                if speed > MOVING_SPEED:
                    self._moving.add(road_user)
                continue
            trip.standing += dt
            still = self._still[road_user] = self._still.get(road_user, 0.0) + dt
            if still > SHORTEST_STOP - 1e-9 and road_user in self._moving:
                self._moving.remove(road_user)
                trip.stops += 1

    def _begin(self, road_user: str, kind: int, now: float) -> Trip:
        walks = kind == RoadUserType.PEDESTRIAN
        delay = 0.0 if walks else departure_delay(self._api, road_user)
        sumo_type = type_id(self._api, road_user, walks).split("@")[0]
        self.all[road_user] = trip = Trip(kind, sumo_type, now - self._step, delay)
        return trip
