"""Yielding: background vehicles brake for learned road users on their paths, and background persons stop before them.

A vehicle in SUMO detects road users that SUMO has mapped to its lane. A road user that is moved from outside is often
mapped to another lane or to none: partly on the lane, inside a junction, on a crossing, off its route. Before each SUMO
step, the swept boxes of background vehicles are therefore compared with the present and predicted boxes of the learned
road users (see `forecast`), and the speed of vehicles that would not stop in time is set (`setSpeed`). SUMO's rules
stay in force: a held vehicle drives at the set speed, or slower if SUMO requires it. See docs/explanation/yielding.md.
"""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.background.forecast import FORECAST_HORIZON, FORECAST_STANDING_SPEED, forecast
from slrl_sumo.background.lane_paths import SPACING, Paths
from slrl_sumo.background.persons import YieldingPersons
from slrl_sumo.background.safe_speed import STOP_SHORT, safe_speeds
from slrl_sumo.background.swept_boxes import sweep
from slrl_sumo.background.swept_conflicts import approaching, conflicts, cosine_at_touch, speed_along, touched
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.geometry import Floats, front_from_centre
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.road_users import TypeParameters, route_id, type_parameters, vehicle_route
from slrl_sumo.sumo.speed_control import SpeedControl, WalkControl

STANDING_MARGIN = 0.3
"""Lateral distance (m) within which a vehicle slows down to PASSING beside standing road users."""
PASSING = 2.0
"""Speed (m/s) at which a vehicle passes standing road users within STANDING_MARGIN."""
NEARBY = 20.0
"""Greatest distance (m) from a vehicle that stands in a junction to a road user that may be the reason."""
LONGEST_VEHICLE_WAIT = 20.0
"""Standing time (s) after which a vehicle slowly passes a road user that stands on its lane, if SUMO allows it: in
SUMO's networks, vehicles touch vehicles that wait beside their lane. By then, blocked learned road users try to move
(agent/deadlock.py)."""
ONCOMING = -0.8
"""Cosine of the angle between the directions of a vehicle and of a road user that stands on its lane, outside
junctions, below which the vehicle passes it at once: neither would go on before the other. Some networks draw the lanes
of both directions over each other."""


class Yielding:
    """Holds the background vehicles and persons of a simulation back for learned road users.

    `step_length`: SUMO's step, s. `exclude`: ids of road users that are not held. Call `apply` before each SUMO step.
    `interventions` counts the beginnings of holds. `refusals`: road users for which SUMO has refused a call.
    """

    def __init__(self, api: SumoApi, network: Network, step_length: float, exclude: Collection[str] = ()) -> None:
        self._api, self._exclude = api, frozenset(exclude)
        self._dt = step_length
        self._paths, self._levels = Paths(api, network), network.levels
        self._control = SpeedControl(api)
        self.refusals = self._control.refusals
        self._persons, self._walks = YieldingPersons(step_length), WalkControl(api, self.refusals)
        self._types: dict[str, TypeParameters] = {}
        self._path_of: dict[str, tuple[str, str, int]] = {}
        self._stood: dict[str, float] = {}
        """Standing time (s) of held vehicles since the begin of the hold."""
        self._waited: dict[str, float] = {}
        """Standing time (s) of vehicles in their present junction, at least with their rear."""
        self.interventions = 0

    @property
    def held(self) -> frozenset[str]:
        """Ids of the road users that are presently held."""
        return self._control.held | self._walks.held

    def apply(self, snapshot: Snapshot, learned: WorldState, context: RouteContext | None = None) -> None:
        """Hold or release the road users of `snapshot` (SUMO's last step), given the state of `learned` after the next.

        `context`: the routes of `learned` at the last decision, where they are known. Learned road users in the
        snapshot are left unchanged.
        """
        own = frozenset(learned.ids)
        self._control.forget(own & (self._control.held | self._control.passing))
        rows = np.array(
            [
                i
                for i, (road_user, lane) in enumerate(zip(snapshot.ids, snapshot.lane, strict=True))
                if lane and road_user not in own and road_user not in self._exclude and not snapshot.person[i]
            ],
            np.intp,
        )
        speeds: dict[str, tuple[float, bool]] = {}
        if len(rows) and len(learned):
            speeds = self._speeds(snapshot, rows, learned, context)
        held = self._control.held
        self._control.release(held - speeds.keys())
        self._stood = {vehicle: self._stood.get(vehicle, 0.0) for vehicle in speeds}
        for row in rows[snapshot.speed[rows] < FORECAST_STANDING_SPEED].tolist():
            if snapshot.ids[row] in speeds:
                self._stood[snapshot.ids[row]] += self._dt
        self.interventions += len(speeds.keys() - held)
        for vehicle, (speed, hard) in speeds.items():
            self._control.hold(vehicle, speed, hard)
        self._control.let_pass(self._passing(snapshot, rows, learned))
        stopping, stopped = self._persons.stopping(snapshot, learned) - self._exclude, self._walks.held
        self._walks.release(stopped - stopping)
        self._walks.hold(stopping - stopped)
        self.interventions += len(stopping - stopped)

    def release(self, road_users: Collection[str] | None = None) -> None:
        """Return the speeds of road users (None: all held road users) to SUMO, with their former speed modes."""
        self._control.release(self._control.held if road_users is None else road_users)
        self._control.let_pass(() if road_users is None else self._control.passing.difference(road_users))
        self._walks.release(self._walks.held if road_users is None else road_users)

    def _passing(self, snapshot: Snapshot, rows: NDArray[np.intp], learned: WorldState) -> list[str]:
        """Ids of the vehicles `rows` that have stood for LONGEST_VEHICLE_WAIT in a junction near a learned road user.

        Where a street is shorter than a vehicle, the vehicle stands in the junctions at both ends.
        SUMO takes that road user for their leader even if it waits behind them, or does not let them go before it.
        """
        reaches_back = snapshot.lane_position < snapshot.length
        inside = [row for row in rows.tolist() if reaches_back[row] or snapshot.lane[row].startswith(":")]
        self._waited = {
            snapshot.ids[row]: self._waited.get(snapshot.ids[row], 0.0)
            + self._dt * float(snapshot.speed[row] < FORECAST_STANDING_SPEED)
            for row in inside
        }
        passing = []
        for row in inside:
            name = snapshot.ids[row]
            waits = name in self._control.passing
            if not waits and self._waited[name] > LONGEST_VEHICLE_WAIT:
                away = np.hypot(learned.x - snapshot.x[row], learned.y - snapshot.y[row])
                waits = away.min(initial=np.inf) < NEARBY
            if waits:
                passing.append(name)
        return passing

    def _speeds(
        self, snapshot: Snapshot, rows: NDArray[np.intp], learned: WorldState, context: RouteContext | None
    ) -> dict[str, tuple[float, bool]]:
        """The speed (m/s) of each vehicle of `rows` that must be held, by id, and whether it needs hard braking."""
        limits = np.array([self._parameters(snapshot.sumo_type[i]).limits for i in rows])
        look = _look_ahead(snapshot.speed[rows], limits[:, 1], self._dt) + 0.5 * snapshot.length[rows]
        spread = 0.5 * np.hypot(learned.length, learned.width) + np.where(
            learned.speed > FORECAST_STANDING_SPEED, learned.speed * FORECAST_HORIZON, 0.0
        )
        dx = snapshot.x[rows][:, None] - learned.x
        dy = snapshot.y[rows][:, None] - learned.y
        near = dx * dx + dy * dy < (look[:, None] + spread) ** 2
        chosen = np.flatnonzero(near.any(axis=1))
        if not len(chosen):
            return {}
        agents = np.flatnonzero(near.any(axis=0))
        learned, context = learned.take(agents), None if context is None else context.take(agents)
        rows, limits, near = rows[chosen], limits[chosen], near[chosen][:, agents]
        speed, length, heading = snapshot.speed[rows], snapshot.length[rows], snapshot.heading[rows]
        front_x, front_y = front_from_centre(snapshot.x[rows], snapshot.y[rows], heading, length)
        count = int(look[chosen].max() / SPACING) + 2
        paths = self._path_rows(snapshot, rows)
        path_x, path_y, inside, room = self._paths.sample(paths, snapshot.lane_position[rows], count)
        size = np.column_stack([length, snapshot.width[rows]])
        boxes, moments, committed = forecast(learned, context)
        vehicle, agent = np.nonzero(near)
        coming = approaching(path_x, path_y, size, vehicle, boxes, agent, STANDING_MARGIN)
        vehicle, agent = vehicle[coming], agent[coming]
        # Most vehicles near a road user pass by: compute boxes for the other vehicles only.
        close, vehicle = np.unique(vehicle, return_inverse=True)
        if not len(close):
            return {}
        rows, limits, speed = rows[close], limits[close], speed[close]
        ahead = sweep(
            path_x[close], path_y[close], room[close], front_x[close], front_y[close], heading[close], size[close]
        )
        standing = np.flatnonzero(moments[agent] == 1)
        # A vehicle slows down beside standing road users, and stops for road users on its path.
        patient = np.array([self._stood.get(snapshot.ids[row], 0.0) < LONGEST_VEHICLE_WAIT for row in rows], np.bool_)
        on_lanes = np.zeros(len(learned), np.bool_) if context is None else context.route.known
        margin = np.append(np.zeros(len(agent)), np.full(len(standing), STANDING_MARGIN))
        vehicle, agent = np.append(vehicle, vehicle[standing]), np.append(agent, agent[standing])
        enter, leave = conflicts(ahead, vehicle, boxes, agent, moments, margin, self._levels)
        place = touched(enter)
        cosine = cosine_at_touch(ahead, vehicle, place, boxes, agent)
        leading = speed_along(cosine, learned.speed[agent])
        oncoming = (cosine[:, 0] < ONCOMING) & ~inside[close[vehicle], place[:, 0]]
        beside = (~patient[vehicle] | oncoming) & (on_lanes & (learned.type != PEDESTRIAN) & (moments == 1))[agent]
        beside[len(beside) - len(standing) :] = True
        certain = np.where(beside, -1.0, np.where(moments[agent] == 1, np.inf, committed[agent]))
        target, hard = safe_speeds(
            enter, leave, leading, moments[agent], certain, speed[vehicle], limits[vehicle], self._dt, self._dt
        )
        target = np.maximum(target, np.where(beside, PASSING, 0.0))
        slowest = np.full(len(rows), np.inf)
        np.minimum.at(slowest, vehicle, target)
        brakes_hard = np.zeros(len(rows), np.bool_)
        np.logical_or.at(brakes_hard, vehicle, hard & (target <= slowest[vehicle]))
        # A vehicle that passes a road user after its wait stays held until it has passed.
        holding = np.flatnonzero((slowest < speed + limits[:, 0] * self._dt) | (~patient & np.isfinite(slowest)))
        return {snapshot.ids[rows[i]]: (float(slowest[i]), bool(brakes_hard[i])) for i in holding}

    def _parameters(self, sumo_type: str) -> TypeParameters:
        parameters = self._types.get(sumo_type)
        if parameters is None:
            parameters = self._types[sumo_type] = type_parameters(self._api, sumo_type)
        return parameters

    def _path_rows(self, snapshot: Snapshot, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """The paths of the vehicles `rows`; a vehicle's route is read again only on a new lane or with a new route."""
        if self._paths.full or len(self._path_of) > 20_000:
            self._paths.clear()
            self._path_of.clear()
        paths = []
        for i in rows.tolist():
            vehicle, lane = snapshot.ids[i], snapshot.lane[i]
            known, route, following = self._path_of.get(vehicle), "", tuple[str, ...]()
            # SUMO refuses the call if a script has removed the vehicle since the last step: its path ends with its
            # lane.
            with self.refusals.of(vehicle):
                route = route_id(self._api, vehicle)
                if known is None or known[0] != lane or known[1] != route:
                    edges, index = vehicle_route(self._api, vehicle)
                    following = edges[max(index, 0) + 1 : max(index, 0) + 25]
            if known is None or known[0] != lane or known[1] != route:
                path = self._paths.row(lane, following, self._parameters(snapshot.sumo_type[i]).vehicle_class)
                known = self._path_of[vehicle] = (lane, route, path)
            paths.append(known[2])
        return np.array(paths, np.intp)


def _look_ahead(speed: Floats, deceleration: Floats, dt: float) -> Floats:
    """Distance (m) ahead of their fronts that matters to vehicles: the stopping distance and a reserve."""
    return speed * (dt + 0.5) + speed * speed / (2.0 * deceleration) + STOP_SHORT + 5.0
