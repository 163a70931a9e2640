"""Road users of the scenario that are moved from outside for a while, and given back to SUMO as they were.

The rules (measured with libsumo 1.28, see docs/takeover.md):

- Vehicles move with keepRoute 3, so that their route survives, with speed mode and lane change mode 0; both are put
  back on return (without that SUMO drives them through everything), and `setSpeed(-1)` ends our say over the speed.
- A vehicle with stops ahead loses them silently when it is moved past one: those are left to SUMO.
- A walk over many edges ends in "Disconnected walk" or a crash when the person is moved. While a person is moved its
  walk is that of the one edge under it; on return it gets the rest of its walk again, and keeps its later stages.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, front_from_centre, heading_to_sumo
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.sublanes import Sublanes

LEFT_TO_SUMO = frozenset(
    {
        *("tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"),
        *("ship", "container", "aircraft", "drone"),
    }
)
"""Vehicle classes that are never taken over (https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html)."""
KEEP_ROUTE_VEHICLE, KEEP_ROUTE_PERSON = 3, 7
KEEP_ROUTE_STRICTLY = 1
"""Onto the route, wherever the vehicle is said to be."""
EVERYWHERE = 1e5
"""m; farther than any place of a network is from another."""
MATCH_THRESHOLD = 5.0
"""m; SUMO's default of 100 m makes a call up to 40 times slower."""
MATCH_THRESHOLD_PERSON = 0.1
"""m; with 5 m SUMO pulls persons that are beside their edge up to 5 m towards it."""
WALKING = 2
"""Type of a walking stage (https://sumo.dlr.de/docs/TraCI/Person_Value_Retrieval.html)."""


@dataclass
class _Walk:
    """A lent person's walk: where it was to go, and the one edge that it has while we move it."""

    edges: tuple[str, ...]
    arrival: float
    stop: str
    here: str | None


class TakenOverControl:
    """Road users of the scenario that SUMO has lent to us, through `api` (libsumo or a TraCI connection)."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._modes: dict[str, tuple[int, int]] = {}
        self._walks: dict[str, _Walk] = {}
        self._lengths: dict[str, float] = {}
        for lane in network.lanes:
            if not lane.internal and "pedestrian" in lane.allowed:
                self._lengths.setdefault(lane.edge, lane.length)
        self._network = network
        self._sublanes = Sublanes(api, network)

    @property
    def ids(self) -> frozenset[str]:
        """Everybody on loan now."""
        return frozenset(self._modes) | frozenset(self._walks)

    def eligible(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Who of n road users on the network may be taken over, (n,); `person` (n,) tells persons from vehicles.

        Vehicles on a lane without stops ahead that are no trains, ships or aircraft; persons that walk.
        """
        walks, drives = self._may_walk, self._may_drive
        return np.array([walks(i) if p else drives(i) for i, p in zip(ids, person.tolist(), strict=True)], np.bool_)

    def take(self, ids: Sequence[str], person: NDArray[np.bool_]) -> None:
        """Take over n eligible road users; from now on `move` them in every SUMO step."""
        for road_user, walks in zip(ids, person.tolist(), strict=True):
            if walks:
                stage = self._api.person.getStage(road_user, 0)
                # getEdges begins with the edge that the person is on, the stage with the one that it began on.
                edges = tuple(self._api.person.getEdges(road_user, 0)) or tuple(stage.edges)
                self._walks[road_user] = _Walk(edges, stage.arrivalPos, stage.destStop, None)
            else:
                vehicle = self._api.vehicle
                self._modes[road_user] = (vehicle.getSpeedMode(road_user), vehicle.getLaneChangeMode(road_user))
                vehicle.setSpeedMode(road_user, 0)
                vehicle.setLaneChangeMode(road_user, 0)

    def move(
        self,
        ids: Sequence[str],
        person: NDArray[np.bool_],
        x: Floats,
        y: Floats,
        heading: Floats,
        speed: Floats,
        length: Floats,
    ) -> None:
        """Say where n lent road users are after the next SUMO step: centres (m), headings (rad), speeds (m/s), (n,)."""
        front_x, front_y = (a.tolist() for a in front_from_centre(x, y, heading, length))
        angles, speeds = heading_to_sumo(heading).tolist(), speed.tolist()
        self._sublanes.clear([i for i, walks in zip(ids, person.tolist(), strict=True) if not walks])
        lanes_under = iter(self._network.walks.lanes_under(x[person], y[person]).tolist())
        vehicle, persons = self._api.vehicle, self._api.person
        for i, (road_user, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            if walks:
                self._cut_walk(road_user, next(lanes_under))
                persons.moveToXY(
                    road_user, "", front_x[i], front_y[i], angles[i], KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON
                )
            else:
                vehicle.moveToXY(
                    road_user, "", -1, front_x[i], front_y[i], angles[i], KEEP_ROUTE_VEHICLE, MATCH_THRESHOLD
                )
                vehicle.setSpeed(road_user, speeds[i])

    def give_back(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Give n lent road users back to SUMO, (n,): False where one stays ours, must be moved on, and may be later.

        That is where SUMO has a vehicle on no lane or inside a junction, and a person on no edge but a crossing, say.
        """
        return self._give_back(ids, person, forced=False)

    def bring_home(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Give n lent road users back that have strayed from the network, (n,): False where one stays ours.

        Vehicles on no lane are put on the nearest place of their route, however far that is.
        """
        return self._give_back(ids, person, forced=True)

    def forget(self, ids: Sequence[str]) -> None:
        """Drop the loans of road users that are no longer in the simulation."""
        self._sublanes.forget(ids)
        for road_user in ids:
            self._modes.pop(road_user, None)
            self._walks.pop(road_user, None)

    def release(self) -> tuple[str, ...]:
        """Give everybody back at once who can be; returns the ids of those who cannot.

        Persons go to the right side of their edge, also from a crossing or from beside it. Vehicles on no lane are put
        on the nearest place of their route, however far that is: beside it SUMO would lose them.
        """
        present = frozenset(self._api.vehicle.getIDList()) | frozenset(self._api.person.getIDList())
        self.forget([road_user for road_user in self.ids if road_user not in present])
        held = sorted(self.ids)
        back = self._give_back(held, np.array([road_user in self._walks for road_user in held], np.bool_), forced=True)
        return tuple(road_user for road_user, given in zip(held, back.tolist(), strict=True) if not given)

    def _give_back(self, ids: Sequence[str], person: NDArray[np.bool_], forced: bool) -> NDArray[np.bool_]:
        back = [
            self._walk_on(road_user, forced) if walks else self._drive_on(road_user, forced)
            for road_user, walks in zip(ids, person.tolist(), strict=True)
        ]
        return np.array(back, np.bool_)

    def _may_drive(self, road_user: str) -> bool:
        vehicle = self._api.vehicle
        if vehicle.getLaneID(road_user) == "" or vehicle.getStops(road_user, 1):
            return False
        # Bits 1 and 8 and up of the stop state: standing at a stop, parked, or waiting for somebody.
        return vehicle.getStopState(road_user) == 0 and vehicle.getVehicleClass(road_user) not in LEFT_TO_SUMO

    def _may_walk(self, road_user: str) -> bool:
        person = self._api.person
        return bool(
            person.getVehicle(road_user) == ""
            and person.getRoadID(road_user) != ""
            and person.getStage(road_user, 0).type == WALKING
        )

    def _cut_walk(self, road_user: str, lane: int) -> None:
        """A moved person walks on one edge at a time: the one under it. -1 (no edge under it) keeps the last one."""
        walk = self._walks[road_user]
        edge = self._network.walks.lanes[lane].edge if lane >= 0 else walk.here or walk.edges[0]
        if edge != walk.here:
            self._set_walk(road_user, (edge,), 0.5 * self._lengths.get(edge, 0.0), "")
            walk.here = edge

    def _set_walk(self, road_user: str, edges: tuple[str, ...], arrival: float, stop: str) -> None:
        stage = self._api.simulation.Stage(type=WALKING, edges=list(edges), arrivalPos=arrival, destStop=stop)
        self._api.person.replaceStage(road_user, 0, stage)

    def _drive_on(self, road_user: str, forced: bool) -> bool:
        vehicle = self._api.vehicle
        # Not the road: SUMO goes on naming the last one when the vehicle is far beside it, and would lose it there.
        lane = vehicle.getLaneID(road_user)
        # Inside a junction SUMO may brake hard for others that it would not have met there.
        if (lane == "" or lane.startswith(":")) and not forced:
            return False
        if lane == "":
            x, y = vehicle.getPosition(road_user)
            angle = vehicle.getAngle(road_user)
            vehicle.moveToXY(road_user, "", -1, x, y, angle, KEEP_ROUTE_STRICTLY, EVERYWHERE)
        self._sublanes.clear((road_user,))
        self._sublanes.forget((road_user,))
        speed_mode, lane_change_mode = self._modes.pop(road_user)
        vehicle.setSpeed(road_user, -1.0)
        vehicle.setSpeedMode(road_user, speed_mode)
        vehicle.setLaneChangeMode(road_user, lane_change_mode)
        return True

    def _walk_on(self, road_user: str, forced: bool) -> bool:
        walk = self._walks[road_user]
        if walk.here is None:
            # Taken but never moved: its walk is still whole.
            del self._walks[road_user]
            return True
        x, y = self._api.person.getPosition(road_user)
        if self._api.person.getRoadID(road_user) != walk.here or not (forced or self._is_on(walk.here, x, y)):
            return False
        edges = self._rest_of(walk)
        if not edges:
            return False
        arrival = min(max(walk.arrival, 0.0), self._lengths.get(edges[-1], 0.0))
        self._set_walk(road_user, edges, arrival, walk.stop)
        if not forced:
            # A walk that is set begins at the right side of the lane; this keeps the person where it is. Not so on
            # release: beside its edge a person would stand for ever, and libsumo crashes in the next simulation of the
            # process where a person's move is still waiting when the present one is closed.
            angle = self._api.person.getAngle(road_user)
            self._api.person.moveToXY(road_user, "", x, y, angle, KEEP_ROUTE_PERSON, MATCH_THRESHOLD_PERSON)
        del self._walks[road_user]
        return True

    def _is_on(self, edge: str, x: float, y: float) -> bool:
        """Whether a position is on an edge, and not beside it or on a crossing that SUMO counts to its end."""
        lane = int(self._network.walks.lanes_under(np.array([x]), np.array([y]))[0])
        return lane >= 0 and self._network.walks.lanes[lane].edge == edge

    def _rest_of(self, walk: _Walk) -> tuple[str, ...]:
        """The edges from where a person is to where it was to go; () where no way is known."""
        assert walk.here is not None
        if walk.here in walk.edges:
            return walk.edges[walk.edges.index(walk.here) :]
        stages = self._api.simulation.findIntermodalRoute(walk.here, walk.edges[-1], "")
        return tuple(edge for stage in stages if stage.type == WALKING for edge in stage.edges)
