"""Background vehicles brake for every learned road user that their path meets, whether SUMO sees it or not.

SUMO lets a vehicle see what it has mapped to the vehicle's lane. A road user that is moved from outside is often mapped
elsewhere or nowhere: partly on the lane, inside a junction, on a crossing, off its route. So before each SUMO step the
boxes that the background vehicles are about to sweep are compared with those of the learned road users, now and over
the next `HORIZON`, and the speed of vehicles that would not stop in time is set (`setSpeed`). SUMO's own rules stay in
force: a vehicle that is held drives as fast as set, or slower where SUMO wants that. See docs/yielding.md.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.lane_paths import SPACING, Paths
from slrl_sumo.background.swept_boxes import sweep
from slrl_sumo.background.swept_conflicts import approaching, meetings, predicted, speed_along
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, front_from_centre
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.reader import Snapshot

HORIZON = 1.5
"""s that learned road users are predicted, going on as they do now."""
MOMENTS = np.linspace(0.0, HORIZON, 6)
STOP_SHORT = 1.0
"""m that vehicles stop before a road user where they can."""
AHEAD_BY = 0.3
"""s by which vehicles that could still stop must be past before a road user comes, to go first."""
MAX_DECELERATION_BIT = 4
"""Of a speed mode: brake no harder than `decel` (https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html)."""


class Yielding:
    """Holds back the background vehicles of a simulation for learned road users.

    `api`: libsumo or a TraCI connection; `step_length`: SUMO's step in s. Call `apply` before each SUMO step.
    `interventions` counts how often a vehicle began to be held, `held` are those that are held now.
    """

    def __init__(self, api: Any, network: Network, step_length: float) -> None:
        self._api = api
        self._dt = step_length
        self._paths = Paths(api, network)
        self._types: dict[str, tuple[float, float, float, str]] = {}
        self._ways: dict[str, tuple[str, str, int]] = {}
        self._speed_modes: dict[str, int] = {}
        self._hard: set[str] = set()
        self.interventions = 0

    @property
    def held(self) -> frozenset[str]:
        """Ids of the vehicles that are held now."""
        return frozenset(self._speed_modes)

    def apply(self, snapshot: Snapshot, learned: WorldState) -> None:
        """Hold or release the vehicles of `snapshot` (SUMO's last step) with regard to `learned`, now.

        Road users of the snapshot whose ids are in `learned` are left alone.
        """
        own = frozenset(learned.ids)
        for road_user in own & self._speed_modes.keys():
            self._forget(road_user)
        rows = np.array(
            [
                i
                for i, (road_user, lane) in enumerate(zip(snapshot.ids, snapshot.lane, strict=True))
                if lane and road_user not in own and not snapshot.person[i]
            ],
            np.intp,
        )
        speeds: dict[str, tuple[float, bool]] = {}
        if len(rows) and len(learned):
            speeds = self._speeds(snapshot, rows, learned)
        self.release(self._speed_modes.keys() - speeds.keys())
        for vehicle, (speed, hard) in speeds.items():
            self._hold(vehicle, speed, hard)

    def release(self, vehicles: Iterable[str] | None = None) -> None:
        """Give vehicles (None: all that are held) back to SUMO, with the speed mode that they had before."""
        releasing = [v for v in (self.held if vehicles is None else vehicles) if v in self._speed_modes]
        present = frozenset(self._api.vehicle.getIDList()) if releasing else frozenset()
        for vehicle in releasing:
            if vehicle in present:
                self._api.vehicle.setSpeed(vehicle, -1.0)
                if vehicle in self._hard:
                    self._api.vehicle.setSpeedMode(vehicle, self._speed_modes[vehicle])
            self._forget(vehicle)

    def _forget(self, vehicle: str) -> None:
        del self._speed_modes[vehicle]
        self._hard.discard(vehicle)

    def _hold(self, vehicle: str, speed: float, hard: bool) -> None:
        if vehicle not in self._speed_modes:
            self._speed_modes[vehicle] = self._api.vehicle.getSpeedMode(vehicle)
            self.interventions += 1
        mode = self._speed_modes[vehicle]
        if hard and vehicle not in self._hard:
            self._api.vehicle.setSpeedMode(vehicle, mode & ~MAX_DECELERATION_BIT)
            self._hard.add(vehicle)
        elif not hard and vehicle in self._hard:
            self._api.vehicle.setSpeedMode(vehicle, mode)
            self._hard.discard(vehicle)
        self._api.vehicle.setSpeed(vehicle, speed)

    def _speeds(self, snapshot: Snapshot, rows: NDArray[np.intp], learned: WorldState) -> dict[str, tuple[float, bool]]:
        """Speeds (m/s) of the vehicles `rows` of the snapshot that must be held, and whether that is hard braking."""
        limits = np.array([self._limits(snapshot.sumo_type[i])[:3] for i in rows])
        look = _look_ahead(snapshot.speed[rows], limits[:, 1], self._dt) + 0.5 * snapshot.length[rows]
        spread = 0.5 * np.hypot(learned.length, learned.width) + learned.speed * HORIZON
        dx = snapshot.x[rows][:, None] - learned.x
        dy = snapshot.y[rows][:, None] - learned.y
        near = dx * dx + dy * dy < (look[:, None] + spread) ** 2
        chosen = np.flatnonzero(near.any(axis=1))
        if not len(chosen):
            return {}
        rows, limits, near = rows[chosen], limits[chosen], near[chosen]
        speed, length, heading = snapshot.speed[rows], snapshot.length[rows], snapshot.heading[rows]
        front_x, front_y = front_from_centre(snapshot.x[rows], snapshot.y[rows], heading, length)
        count = int(look[chosen].max() / SPACING) + 2
        path_x, path_y, room = self._paths.sample(self._path_rows(snapshot, rows), snapshot.lane_position[rows], count)
        size = np.column_stack([length, snapshot.width[rows]])
        boxes = predicted(learned, MOMENTS)
        vehicle, agent = np.nonzero(near)
        coming = approaching(path_x, path_y, size, vehicle, boxes, agent)
        vehicle, agent = vehicle[coming], agent[coming]
        # Most vehicles near somebody pass by: only the others are looked at closely.
        close, vehicle = np.unique(vehicle, return_inverse=True)
        if not len(close):
            return {}
        rows, limits, speed = rows[close], limits[close], speed[close]
        ahead = sweep(
            path_x[close], path_y[close], room[close], front_x[close], front_y[close], heading[close], size[close]
        )
        enter, leave = meetings(ahead, vehicle, boxes, agent, learned.speed > 0.05)
        target, hard = safe_speeds(
            enter,
            leave,
            speed[vehicle],
            speed_along(ahead, vehicle, enter, boxes, agent, learned.speed),
            limits[vehicle],
            self._dt,
        )
        slowest = np.full(len(rows), np.inf)
        np.minimum.at(slowest, vehicle, target)
        brakes_hard = np.zeros(len(rows), np.bool_)
        np.logical_or.at(brakes_hard, vehicle, hard & (target <= slowest[vehicle]))
        holding = np.flatnonzero(slowest < speed + limits[:, 0] * self._dt)
        return {snapshot.ids[rows[i]]: (float(slowest[i]), bool(brakes_hard[i])) for i in holding}

    def _limits(self, sumo_type: str) -> tuple[float, float, float, str]:
        """Acceleration, deceleration and emergency deceleration (m/s²) of a vehicle type, and its class."""
        limits = self._types.get(sumo_type)
        if limits is None:
            types = self._api.vehicletype
            limits = self._types[sumo_type] = (
                types.getAccel(sumo_type),
                types.getDecel(sumo_type),
                types.getEmergencyDecel(sumo_type),
                types.getVehicleClass(sumo_type),
            )
        return limits

    def _path_rows(self, snapshot: Snapshot, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """The path of each of the vehicles `rows`; asked anew of SUMO only on a new lane or with a new route."""
        if self._paths.full or len(self._ways) > 20_000:
            self._paths.clear()
            self._ways.clear()
        vehicles = self._api.vehicle
        paths = []
        for i in rows.tolist():
            vehicle, lane = snapshot.ids[i], snapshot.lane[i]
            route = vehicles.getRouteID(vehicle)
            way = self._ways.get(vehicle)
            if way is None or way[0] != lane or way[1] != route:
                index = vehicles.getRouteIndex(vehicle)
                following = vehicles.getRoute(vehicle)[max(index, 0) + 1 : max(index, 0) + 25]
                path = self._paths.row(lane, tuple(following), self._limits(snapshot.sumo_type[i])[3])
                way = self._ways[vehicle] = (lane, route, path)
            paths.append(way[2])
        return np.array(paths, np.intp)


def _look_ahead(speed: Floats, deceleration: Floats, dt: float) -> Floats:
    """How far ahead of their fronts vehicles have to look, in m: the way to a stop, and a bit."""
    return speed * (dt + 0.5) + speed * speed / (2.0 * deceleration) + STOP_SHORT + 5.0


def safe_speeds(
    enter: Floats, leave: Floats, speed: Floats, leading: Floats, limits: Floats, dt: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Speeds for the next step that let vehicles stop in time, (p,) in m/s, and where that is harder than `decel`.

    `enter`, `leave`: metres driven at first and last touch at each of `MOMENTS`, (p, q); `speed`: of the vehicles,
    (p,); `leading`: of the road users along the way, (p, q); `limits`: acceleration, deceleration, emergency
    deceleration, (p, 3). inf where nothing is in the way. The speed is Krauss' safe speed with a reaction time of one
    step (https://sumo.dlr.de/docs/Car-Following-Models.html); where `decel` does not suffice it is the least braking
    that does, up to the emergency deceleration.
    """
    return _safe_speeds(enter, leave, speed, leading, limits, dt, MOMENTS, SPACING)


@compiled
def _safe_speeds(
    enter: Floats,
    leave: Floats,
    speed: Floats,
    leading: Floats,
    limits: Floats,
    dt: float,
    moments: Floats,
    spacing: float,
) -> tuple[Floats, NDArray[np.bool_]]:
    """See `safe_speeds`."""
    targets, hard = np.full(len(speed), np.inf), np.zeros(len(speed), np.bool_)
    for p, v in enumerate(speed):
        acceleration, comfortable, emergency = limits[p, 0], limits[p, 1], limits[p, 2]
        delay = comfortable * dt
        for m, moment in enumerate(moments):
            first, following = enter[p, m], leading[p, m]
            needed = (v * v - following * following) / (2.0 * max(first - spacing, 1e-3))
            # Who will only come later is met if it stays (last moment), or if the vehicle may be there then ...
            now, last = moment == 0.0, moment >= HORIZON
            matters = now or last or first <= v * moment + 0.5 * acceleration * moment * moment + STOP_SHORT
            # ... and is not past before. Who can no longer stop had better go, even if it is a near thing.
            ahead_by = 0.0 if needed > emergency else AHEAD_BY
            if not matters or not (now or leave[p, m] + spacing >= v * max(moment - ahead_by, 0.0)):
                continue
            gap = max(first - STOP_SHORT, 0.0)
            target = math.sqrt(delay * delay + following * following + 2.0 * comfortable * gap) - delay
            needed = min(max(needed, comfortable), emergency)
            breaks = target < v - comfortable * dt
            if breaks:
                target = v - needed * dt
            target = max(target, 0.0)
            if target < targets[p]:
                targets[p], hard[p] = target, breaks and needed > comfortable
    return targets, hard
