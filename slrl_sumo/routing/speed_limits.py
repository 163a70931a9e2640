"""How fast vehicles may go: limits, signals, priority, leaders, the end of their lane."""

import math

from slrl_sumo.routing.lane_graph import JunctionEntry, LaneGraph
from slrl_sumo.routing.right_of_way import LINE_OF_SIGHT, STOP_LINE, RightOfWay
from slrl_sumo.routing.vehicle_tracker import VehicleTrack, VehicleTracker
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.road_users import leader_of, vehicle_speed

ROLLING = 2.0
"""m/s from which a vehicle that is just over a line does not stop there any more."""
LANE_END = 3.0
"""m before the end of its lane at which a vehicle waits for a gap beside it."""


class SpeedLimits:
    """Speeds of driven vehicles, as SUMO's leaders, signals and lanes allow through `api`."""

    def __init__(self, api: SumoApi, graph: LaneGraph, vehicles: VehicleTracker, *, trusting: bool = True) -> None:
        self._api, self._graph, self._vehicles = api, graph, vehicles
        self._right = RightOfWay(api, graph, trusting=trusting)

    def renew(self) -> None:
        """Forget what was read of SUMO's last step."""
        self._right.renew()

    def calm(self, drive: VehicleTrack, dt: float) -> float:
        """The speed (m/s) that limits, signals, priority and the end of the lane allow."""
        speed = self.limit(drive, dt)
        for entry, distance in self._entries_near(drive, dt):
            limits = (drive.accel, drive.decel)
            allowed = self._right.speed(entry, distance, drive.speed, limits, drive.stood)
            speed = min(speed, _discrete(allowed, drive.decel, dt))
        if self.leads_on(drive):
            return speed
        # Wait at the end of the lane for a gap in the next one.
        return min(speed, _slowing(0.0, drive.way.end - drive.s - LANE_END, drive.decel, dt))

    def limit(self, drive: VehicleTrack, dt: float, soft: float = 1.0) -> float:
        """The speed (m/s) that the limits of the lanes under the vehicle and ahead of it allow.

        Lower limits ahead are reached with the share `soft` of its deceleration.
        """
        way, decel = drive.way, soft * drive.decel
        here = way.lane_at(drive.s)
        speed = min(way.limits[here] * drive.factor, drive.top_speed)
        look = _sight(drive.speed, decel, dt)
        for k in range(here + 1, len(way.lanes)):
            distance = way.ends[k - 1] - drive.s
            if distance > look:
                break
            limit = min(way.limits[k] * drive.factor, drive.top_speed)
            speed = min(speed, _slowing(limit, distance, decel, dt))
        return speed

    def stop(self, drive: VehicleTrack, dt: float, soft: float, hesitant: float) -> tuple[float, float]:
        """How far ahead (m, inf: nowhere) the vehicle must stop, and the speed (m/s) at which it sees who comes.

        That speed is reached with the share `soft` of its deceleration, and `dt` seconds early. It is expected to cross
        junctions with the share `hesitant` of its acceleration.
        """
        stop, look = math.inf, math.inf
        for entry, distance in self._entries_near(drive, dt):
            if distance < 0.0 and drive.speed > ROLLING:
                continue  # over the line already: it goes on
            limits = (hesitant * drive.accel, drive.decel)
            said = self._right.says(entry, distance, drive.speed, limits, drive.stood)
            if said == "stop":
                stop = min(stop, distance - STOP_LINE)
            elif said == "look":
                seen = max(distance - drive.speed * dt, LINE_OF_SIGHT)
                look = min(look, math.sqrt(2.0 * soft * drive.decel * seen))
        if not self.leads_on(drive):
            stop = min(stop, drive.way.end - drive.s - LANE_END)
        return stop, look

    def signal(self, entry: JunctionEntry) -> int:
        """What the signal at a entry shows: 0 there is none, 1 green, 2 yellow, 3 red."""
        return self._right.signal(entry)

    def _entries_near(self, drive: VehicleTrack, dt: float) -> list[tuple[JunctionEntry, float]]:
        """Gates that matter at the present speed, with the way to them in m."""
        look = _sight(drive.speed, drive.decel, dt) + 5.0
        return [(entry, near) for entry in drive.way.entries if -0.5 < (near := entry.line - drive.s) < look]

    def leads_on(self, drive: VehicleTrack) -> bool:
        """Whether the lane under a vehicle leads on along its route; inside a junction it does, whatever follows."""
        here = drive.way.lane_at(drive.s)
        return drive.way.lanes[here].startswith(":") or not drive.edges or self._reaches_on(drive)

    def _reaches_on(self, drive: VehicleTrack) -> bool:
        """Whether the way goes on as far as the route does, or further than anybody looks."""
        last = self._graph.lanes[drive.way.lanes[-1]]
        return drive.way.end - drive.s > 120.0 or last.edge == drive.edges[-1]

    def behind(self, road_user: str, drive: VehicleTrack, dt: float) -> float:
        """Krauss' safe speed behind SUMO's leader (https://sumo.dlr.de/docs/Car-Following-Models.html)."""
        if road_user.startswith("learned_"):
            return math.inf
        leader = leader_of(self._api, road_user, 50.0)
        if leader is None:
            return math.inf
        other = self._vehicles.get(leader[0])
        pace = other.speed if other is not None else max(vehicle_speed(self._api, leader[0]), 0.0)
        gap = max(leader[1], 0.0)
        delay = drive.decel * max(drive.tau, dt)
        safe = math.sqrt(delay * delay + pace * pace + 2.0 * drive.decel * gap) - delay
        return min(safe, self._keeps_clear(drive, gap, pace, dt))

    def _keeps_clear(self, drive: VehicleTrack, gap: float, pace: float, dt: float) -> float:
        """Do not stop inside a junction: wait before it while its exit is taken."""
        for entry in drive.way.entries[:1]:
            distance = entry.line - drive.s
            if distance > 0.0 and pace < 1.0 and -2.0 < gap - (entry.out - drive.s) < 5.0:
                return _slowing(0.0, distance - STOP_LINE, drive.decel, dt)
        return math.inf


def _sight(speed: float, decel: float, dt: float) -> float:
    """m ahead of a vehicle that matter at `speed` (m/s), if it brakes with `decel` (m/s²)."""
    return speed * dt + speed**2 / (2.0 * decel) + 10.0


def _slowing(target: float, distance: float, decel: float, dt: float) -> float:
    """The speed (m/s) from which `target` is reached after `distance` (m), after one more interval at that speed."""
    delay = decel * dt
    root = delay * delay + target * target + 2.0 * decel * max(distance, 0.0)
    return max(math.sqrt(root) - delay, target)


def _discrete(speed: float, decel: float, dt: float) -> float:
    """A speed that could be kept up in continuous time, for one that is held over the next interval."""
    if not math.isfinite(speed):
        return speed
    return math.sqrt(decel * decel * dt * dt + speed * speed) - decel * dt
