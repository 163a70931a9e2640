"""Persons that are moved from outside (rules: see slrl_sumo.sumo.taken_over)."""

from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.road_users import WALKING_STAGE, loaded_ids
from slrl_sumo.sumo.scenario.loaded_files import ADDITIONAL, CONFIGURATION, edges_of_access

KEEP_ROUTE = 7
MATCH_THRESHOLD = 0.1
"""matchThreshold (m); with 5 m, SUMO moves persons beside their edge by up to 5 m towards the edge."""
WITHIN_EDGE = 0.3
"""Least distance (m) from the ends of its edge at which a person is handed back: exactly at an end, 11 of 11 persons
stood for ever, with the speed of their last step, up to 65 m/s."""
NOT_WALKING = "no walk"
"""Reason why a person cannot be taken over: it rides, waits or walks to a stop with <access>."""
NO_WALK = "it does not walk any more"
INFINITELY_WIDE = "it is on a lane of infinite width, where SUMO has persons nowhere"


@dataclass
class _Walk:
    """The original walk of a person, and the edge of its walk during the takeover."""

    edges: tuple[str, ...]
    arrival: float
    stop: str
    current_edge: str | None
    """None until the person is moved for the first time."""


class TakenOverPersons:
    """Takes single persons over, moves them, and hands them back; `refusals`: persons that SUMO cannot move."""

    def __init__(self, api: SumoApi, network: Network, refusals: Refusals) -> None:
        self._api, self._network, self._refusals = api, network, refusals
        self._walks: dict[str, _Walk] = {}
        self._kept: dict[str, tuple[float, float]] = {}
        """Positions (m) of the persons that were handed back since the last step."""
        self._lanes: dict[str, Lane] = {}
        """The first lane of each edge that persons may use."""
        for lane in network.lanes:
            if not lane.internal and "pedestrian" in lane.allowed:
                self._lanes.setdefault(lane.edge, lane)
        self._edge_of_stop = {stop: api.busstop.getLaneID(stop).rpartition("_")[0] for stop in api.busstop.getIDList()}
        files = (api.simulation.getOption(name) for name in (ADDITIONAL, CONFIGURATION))
        self._access = edges_of_access(*files) if self._edge_of_stop else {}
        """The edges from which each stop has an <access>."""

    @property
    def ids(self) -> frozenset[str]:
        """Ids of the persons that are presently taken over."""
        return frozenset(self._walks)

    def obstacle(self, road_user: str) -> str:
        """Reason why a person cannot be taken over, because it does not walk; '' if it can."""
        person = self._api.person
        if person.getVehicle(road_user) != "" or person.getRoadID(road_user) == "":
            return NOT_WALKING
        stage = person.getStage(road_user, 0)
        if stage.type != WALKING_STAGE:
            return NOT_WALKING
        return NOT_WALKING if stage.edges and self._has_access(stage.destStop, stage.edges[-1]) else ""

    def _has_access(self, stop: str, edge: str) -> bool:
        """Whether a walk that ends on an edge reaches its `stop` ('' for none) by <access>.

        It does if the stop is on another edge; accesses on the same edge are known from SUMO's files, if readable here.
        """
        return self._edge_of_stop.get(stop, edge) != edge or edge in self._access.get(stop, ())

    def does_not_walk(self, road_user: str) -> bool:
        """Whether SUMO or a script has begun another stage of a person."""
        return self._api.person.getStage(road_user, 0).type != WALKING_STAGE

    def take_over(self, road_user: str) -> bool:
        """Take a person over; the caller must move it in each SUMO step from now on."""
        stage = self._api.person.getStage(road_user, 0)
        # getEdges begins with the present edge, the stage with the first one.
        edges = tuple(self._api.person.getEdges(road_user, 0)) or tuple(stage.edges)
        self._walks[road_user] = _Walk(edges, stage.arrivalPos, stage.destStop, None)
        return True

    def move(self, road_user: str, lane: int, x: float, y: float, angle: float) -> None:
        """Move the front of a person to a position (m), facing a SUMO `angle` (degrees), in the next SUMO step.

        `lane`: index of the lane of the network's walks under the person, -1 without one.
        """
        if self.does_not_walk(road_user):
            # SUMO or a script has begun another stage: a move would make the person walk again.
            self._refusals.add(road_user, NO_WALK)
        elif lane >= 0 and self._network.walks.lanes[lane].id in self._network.infinitely_wide:
            self._refusals.add(road_user, INFINITELY_WIDE)
        else:
            self._shorten_walk(road_user, lane)
            self._api.person.moveToXY(road_user, "", x, y, angle, KEEP_ROUTE, MATCH_THRESHOLD)

    def hand_back(self, road_user: str, off_route: bool) -> bool:
        """Hand a person back, with `off_route` also from a crossing or beside its edge; returns whether it
        succeeded."""
        walk = self._walks[road_user]
        if walk.current_edge is None or self.does_not_walk(road_user):
            # The person was never moved, so that its walk is unchanged; or SUMO or a script has begun another stage.
            del self._walks[road_user]
            return True
        x, y = self._api.person.getPosition(road_user)
        if self._api.person.getRoadID(road_user) != walk.current_edge or not (
            off_route or self._is_on(walk.current_edge, x, y)
        ):
            return False
        edges = self._rest_of(walk)
        if not edges:
            return False
        self._restore_walk(road_user, edges)
        self._kept[road_user] = self._on_lane(walk.current_edge, x, y)
        del self._walks[road_user]
        return True

    def keep_in_place(self) -> None:
        """Let the next SUMO step keep handed-back persons at their positions, or at the nearest place of their edge.

        Otherwise a new walk begins at the right side of the lane.
        """
        kept, self._kept = self._kept, {}
        present = loaded_ids(self._api) if kept else frozenset[str]()
        for road_user, (x, y) in kept.items():
            if road_user in self._walks or road_user not in present:
                continue
            with self._refusals.of(road_user):
                # A walk that is at its end is over immediately: the person may already ride or be in an <access> stage.
                if not self.does_not_walk(road_user):
                    angle = self._api.person.getAngle(road_user)
                    self._api.person.moveToXY(road_user, "", x, y, angle, KEEP_ROUTE, MATCH_THRESHOLD)

    def abandon(self, road_user: str, present: Container[str]) -> None:
        """Return a person to SUMO at its position; if its id is among those `present`, it walks on to its
        destination."""
        if road_user in present:
            with self._refusals.of(road_user):
                if not self.does_not_walk(road_user) and (edges := self._rest_of(self._walks[road_user])):
                    self._restore_walk(road_user, edges)
        self._walks.pop(road_user, None)

    def _shorten_walk(self, road_user: str, lane: int) -> None:
        """Set the walk of a person to the edge under it; `lane` -1 (no edge under it) keeps the last edge."""
        walk = self._walks[road_user]
        edge = self._network.walks.lanes[lane].edge if lane >= 0 else walk.current_edge or walk.edges[0]
        if edge != walk.current_edge:
            self._set_walk(road_user, (edge,), 0.5 * self._length(edge), "")
            walk.current_edge = edge

    def _set_walk(self, road_user: str, edges: tuple[str, ...], arrival: float, stop: str) -> None:
        stage = self._api.simulation.Stage(type=WALKING_STAGE, edges=list(edges), arrivalPos=arrival, destStop=stop)
        self._api.person.replaceStage(road_user, 0, stage)

    def _restore_walk(self, road_user: str, edges: tuple[str, ...]) -> None:
        """Let a person walk along `edges` to its own destination."""
        walk = self._walks[road_user]
        arrival = min(max(walk.arrival, 0.0), self._length(edges[-1]))
        self._set_walk(road_user, edges, arrival, walk.stop)

    def _length(self, edge: str) -> float:
        """Length of an edge, m; 0 for edges that persons may not use."""
        return self._lanes[edge].length if edge in self._lanes else 0.0

    def _is_on(self, edge: str, x: float, y: float) -> bool:
        """Whether a position is on an edge, and not beside it or on a crossing that SUMO assigns to the edge."""
        lane = int(self._network.walks.lanes_under(np.array([x]), np.array([y]))[0])
        return lane >= 0 and self._network.walks.lanes[lane].edge == edge

    def _on_lane(self, edge: str, x: float, y: float) -> tuple[float, float]:
        """The place on an edge that is nearest to a position, WITHIN_EDGE from both of its ends.

        A person 0.1 m beside its edge or at its ends stands for ever in SUMO, or its walk ends immediately
        (slrl_sumo.sumo.taken_over).
        """
        lane, place = self._lanes[edge], np.array([x, y])
        begins, steps = lane.shape[:-1], np.diff(lane.shape, axis=0)
        lengths = np.maximum(np.hypot(*steps.T), 1e-9)
        before = np.cumsum(lengths) - lengths
        along = np.clip(((place - begins) * steps).sum(axis=1) / lengths, 0.0, lengths)
        feet = begins + (along / lengths)[:, None] * steps
        nearest = int(np.hypot(*(place - feet).T).argmin())
        end = before[-1] + lengths[-1]
        within = min(WITHIN_EDGE, 0.5 * end)
        s = np.clip(before[nearest] + along[nearest], within, end - within)
        part = int(np.searchsorted(before, s, side="right")) - 1
        dx, dy = steps[part] / lengths[part]
        foot = begins[part] + (s - before[part]) * np.array([dx, dy])
        aside = np.clip((y - foot[1]) * dx - (x - foot[0]) * dy, -0.5 * lane.width, 0.5 * lane.width)
        return float(foot[0] - aside * dy), float(foot[1] + aside * dx)

    def _rest_of(self, walk: _Walk) -> tuple[str, ...]:
        """The edges from a person's present edge to its destination; () without a route."""
        if walk.current_edge is None:
            return ()
        if walk.current_edge in walk.edges:
            return walk.edges[walk.edges.index(walk.current_edge) :]
        stages = self._api.simulation.findIntermodalRoute(walk.current_edge, walk.edges[-1], "")
        return tuple(edge for stage in stages if stage.type == WALKING_STAGE for edge in stage.edges)
