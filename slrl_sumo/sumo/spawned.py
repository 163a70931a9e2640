"""Spawned road users: added to SUMO, moved and removed with calls that do not crash SUMO, according to measurements.

Rules (measured with libsumo 1.28, see docs/architecture.md):

- The first `moveToXY` of a vehicle must put it on a lane that it may use, else SUMO crashes. Therefore `add` stages the
  vehicle on the nearest carriageway for one SUMO step, and the second `move` puts it at its position.
- Afterwards cars and bicycles move with keepRoute 2 (any position). Bit 4 (ignore permissions) crashes SUMO if a long
  vehicle is mapped to a pedestrian lane beside a crossing, so it is used for the staging step only.
- Bicycles have a vehicle type of class "passenger": SUMO then maps them to car lanes, and cars stop for them.
- Persons move with keepRoute 7 (2 crashes); their walk is renewed when the edge under them changes.
- Each road user is moved in each SUMO step: a vehicle beside its lane disappears in the first step without a move.
- No vehicle is moved to an edge with a calibrator or a vaporizer: see `removing_edges`.
- With the sublane model, SUMO crashes later when a vehicle has left all lanes: see `sublanes`.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, front_from_centre, heading_to_sumo
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, PEDESTRIAN, SPAWNED_PREFIX, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.api import RoadUserDomain, SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane, LanePoints, lane_index
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.removing_edges import MAY_BE_REMOVED, RemovingEdges
from slrl_sumo.sumo.road_users import loaded_ids
from slrl_sumo.sumo.sublanes import Sublanes

LEARNED_TYPES = tuple(f"{SPAWNED_PREFIX}{name}" for name in TYPE_NAMES)
"""vType ids of learned road users, indexed by RoadUserType."""

SUMO_TEMPLATES = ("DEFAULT_VEHTYPE", "DEFAULT_BIKETYPE", "DEFAULT_PEDTYPE")
KEEP_ROUTE_VEHICLE, KEEP_ROUTE_STAGING, KEEP_ROUTE_PERSON = 2, 6, 7
MATCH_THRESHOLD = 5.0
"""matchThreshold (m) of vehicles; SUMO's default of 100 m makes a call up to 40 times slower."""
MATCH_THRESHOLD_PERSON = 0.1
"""matchThreshold (m) of persons; with 5 m, SUMO moves about 1 % of them by up to 8 m, to the edge of another lane."""

SHORT_LANE = 1.0
"""Length (m) up to which lanes are used only in networks without longer lanes."""


class SpawnedControl:
    """Adds, moves and removes spawned road users. `refusals`: road users for which SUMO has refused a call."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self._api = api
        self._added: set[str] = set()
        self._edge_of_person: dict[str, str] = {}
        self._staged: set[str] = set()
        self._routes: set[str] = set(api.route.getIDList())
        self._removing = RemovingEdges(api, network)
        lanes = [lane for lane in network.lanes if not lane.internal]
        # In networks without lanes for cars (cycle paths), bicycles are of class "bicycle".
        self._vehicle_class = "passenger" if any("passenger" in lane.allowed for lane in lanes) else "bicycle"
        free = _staging_points([lane for lane in lanes if lane.edge not in network.removing], self._vehicle_class)
        self._staging = free if len(free) else _staging_points(lanes, self._vehicle_class)
        self._walks = network.walks
        if any(lane.length <= SHORT_LANE for lane in self._walks.lanes):
            self._walks = _staging_points(lanes, "pedestrian")
        self._sublanes = Sublanes(api, network)
        self._define_types()

    def _define_types(self) -> None:
        types = self._api.vehicletype
        for kind, name in enumerate(LEARNED_TYPES):
            if name in types.getIDList():
                continue
            types.copy(SUMO_TEMPLATES[kind], name)
            types.setLength(name, float(DEFAULT_LENGTH[kind]))
            types.setWidth(name, float(DEFAULT_WIDTH[kind]))
            types.setMaxSpeed(name, 70.0)
            # Spawned road users have no route, so that a rerouting device for all vehicles of a scenario would fail.
            types.setParameter(name, "has.rerouting.device", "false")
        types.setVehicleClass(LEARNED_TYPES[RoadUserType.CAR], self._vehicle_class)
        types.setVehicleClass(LEARNED_TYPES[RoadUserType.BICYCLE], self._vehicle_class)

    def add(self, ids: tuple[str, ...], kinds: NDArray[np.int8], x: Floats, y: Floats) -> None:
        """Add road users; they are in the simulation after the next SUMO step.

        `ids`: n new ids; `kinds`: RoadUserType, (n,); `x`, `y`: centres in m, (n,).
        """
        walking = kinds == PEDESTRIAN
        for road_user, point in zip(
            _pick(ids, walking), self._walks.nearest_point(x[walking], y[walking]), strict=True
        ):
            with self.refusals.of(road_user):
                self._add_person(road_user, int(point))
        points = self._staging.nearest_point(x[~walking], y[~walking])
        for road_user, kind, point in zip(_pick(ids, ~walking), kinds[~walking].tolist(), points, strict=True):
            with self.refusals.of(road_user):
                self._add_vehicle(road_user, LEARNED_TYPES[kind], int(point))

    def move(
        self,
        ids: tuple[str, ...],
        kinds: NDArray[np.int8],
        x: Floats,
        y: Floats,
        heading: Floats,
        speed: Floats,
        length: Floats,
    ) -> None:
        """Set the state of road users after the next SUMO step: centres (m), headings (rad), speeds (m/s), all (n,)."""
        front_x, front_y = (a.tolist() for a in front_from_centre(x, y, heading, length))
        angles, speeds = heading_to_sumo(heading).tolist(), speed.tolist()
        walking = kinds == PEDESTRIAN
        lanes_under = iter(self._walks.lanes_under(x[walking], y[walking]).tolist())
        forbidden = self._removing.near(x, y).tolist()
        vehicle, person = self._api.vehicle, self._api.person
        for i, (road_user, walks) in enumerate(zip(ids, walking.tolist(), strict=True)):
            lane = next(lanes_under) if walks else -1
            try:
                if walks:
                    # SUMO ignores a change of the walk before the person has departed.
                    if road_user not in self._staged:
                        self._renew_walk(road_user, lane)
                    person.moveToXY(
                        road_user, "", front_x[i], front_y[i], angles[i], KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON
                    )
                    continue
                self._sublanes.clear(road_user)
                if road_user in self._staged:
                    continue
                if forbidden[i]:
                    self.refusals.add(road_user, MAY_BE_REMOVED)
                    continue
                vehicle.moveToXY(
                    road_user, "", -1, front_x[i], front_y[i], angles[i], KEEP_ROUTE_VEHICLE, MATCH_THRESHOLD
                )
                vehicle.setSpeed(road_user, speeds[i])
            except Exception as error:
                self.refusals.catch(road_user, error)
        self._staged.difference_update(ids)

    def loaded(self) -> frozenset[str]:
        """Ids of all road users in the simulation."""
        return loaded_ids(self._api)

    def remove(self, ids: tuple[str, ...]) -> None:
        """Remove road users that were added here and are still in the simulation."""
        # SUMO lists neither staged road users, which depart in the next step, nor vehicles beside all lanes. For
        # removed road users, SUMO refuses these calls.
        gone, on_road = Refusals(), set(self._api.vehicle.getIDList())
        for road_user in self._added.intersection(ids):
            with gone.of(road_user):
                if road_user in self._edge_of_person:
                    _remove(self._api.person, road_user)
                else:
                    if road_user in on_road:
                        self._sublanes.clear(road_user)
                    _remove(self._api.vehicle, road_user)
            self._edge_of_person.pop(road_user, None)
        self._added.difference_update(ids)
        self._staged.difference_update(ids)
        self._sublanes.forget(ids)

    def _add_person(self, road_user: str, point: int) -> None:
        lane = self._walks.lanes[self._walks.lane[point]]
        edge = lane.edge
        self._api.person.add(
            road_user, edge, float(self._walks.offset[point]), typeID=LEARNED_TYPES[RoadUserType.PEDESTRIAN]
        )
        self._added.add(road_user)
        self._edge_of_person[road_user] = edge
        self._api.person.appendWalkingStage(road_user, [edge], arrival_on(lane))
        self._staged.add(road_user)

    def _add_vehicle(self, road_user: str, sumo_type: str, point: int) -> None:
        """Stage a vehicle at a point of the carriageway."""
        lane = self._staging.lanes[self._staging.lane[point]]
        route = f"{SPAWNED_PREFIX}{lane.edge}"
        if route not in self._routes:
            self._api.route.add(route, [lane.edge])
            self._routes.add(route)
        self._api.vehicle.add(road_user, route, typeID=sumo_type)
        self._added.add(road_user)
        self._api.vehicle.setSpeedMode(road_user, 0)
        self._api.vehicle.setLaneChangeMode(road_user, 0)
        self._api.vehicle.moveToXY(
            road_user,
            lane.edge,
            lane_index(lane.id),
            float(self._staging.x[point]),
            float(self._staging.y[point]),
            float(heading_to_sumo(self._staging.heading[point])),
            KEEP_ROUTE_STAGING,
            MATCH_THRESHOLD,
        )
        self._staged.add(road_user)

    def _renew_walk(self, road_user: str, lane: int) -> None:
        """Set the walk of a person to the edge under it; `lane` -1 (no edge under it) keeps the last edge."""
        if lane < 0:
            return
        edge = self._walks.lanes[lane].edge
        if edge != self._edge_of_person.get(road_user):
            self._api.person.appendWalkingStage(road_user, [edge], arrival_on(self._walks.lanes[lane]))
            self._api.person.removeStage(road_user, 0)
            self._edge_of_person[road_user] = edge


def _staging_points(lanes: list[Lane], vehicle_class: str) -> LanePoints:
    """Points on the lanes for a class; on short lanes only without longer lanes (grids with streets of 8 m)."""
    admitting = [lane for lane in lanes if vehicle_class in lane.allowed]
    return LanePoints([lane for lane in admitting if lane.length > SHORT_LANE] or admitting, spacing=2.0)


def arrival_on(lane: Lane) -> float:
    """End of the walk of a moved person (m along the lane): SUMO refuses positions past the lane's end."""
    return min(1.0, 0.5 * lane.length)


def bare_moves(api: SumoApi, learned: WorldState) -> Callable[[], None]:
    """Only the `moveToXY` calls for learned road users, to their present positions: for benchmarks."""
    present = loaded_ids(api)
    x, y = front_from_centre(learned.x, learned.y, learned.heading, learned.length)
    rows = zip(learned.ids, x.tolist(), y.tolist(), heading_to_sumo(learned.heading).tolist(), strict=True)
    users = [row for row in rows if row[0] in present]
    walking = {learned.ids[i] for i in np.flatnonzero(learned.type == PEDESTRIAN)}
    vehicles = [user for user in users if user[0] not in walking]
    persons = [user for user in users if user[0] in walking]

    def move() -> None:
        vehicle, person = api.vehicle, api.person
        for user, front_x, front_y, angle in vehicles:
            vehicle.moveToXY(user, "", -1, front_x, front_y, angle, KEEP_ROUTE_VEHICLE, MATCH_THRESHOLD)
        for user, front_x, front_y, angle in persons:
            person.moveToXY(user, "", front_x, front_y, angle, KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON)

    return move


def _remove(domain: RoadUserDomain, road_user: str) -> None:
    # SUMO's next step would fail on subscriptions of a user's script to removed road users.
    if domain.getSubscriptionResults(road_user):
        domain.unsubscribe(road_user)
    domain.remove(road_user)


def _pick(ids: tuple[str, ...], mask: NDArray[np.bool_]) -> list[str]:
    return [road_user for road_user, keep in zip(ids, mask.tolist(), strict=True) if keep]
