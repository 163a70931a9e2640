"""Takeover of road users of the scenario, and their hand-back to SUMO."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.driver import Driver
from slrl_sumo.background.yielding import Yielding
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.contacts import colliding_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, SPAWNED_PREFIX, STANDING_SPEED, RoadUserType
from slrl_sumo.simulation.placement.wraparound import left_scene
from slrl_sumo.simulation.population import Population
from slrl_sumo.simulation.region import Region
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.taken_over import TakenOverControl

HYSTERESIS = 5.0
"""Distance (m) outside the region from which a road user is handed back."""

FAST_LANE_RATIO = 1.2
"""Ratio of a lane's speed limit to the top speed of learned cars above which learned cars do not use the lane."""
SHARP_TURN_TIME = 10.0
"""Time (s) for which SUMO drives a road user before a turn that its models cannot follow; then it may be taken over
again."""
FAST_LANE_REASON = "fast lane"
"""Reason why a road user on a fast lane is not taken over."""
EXCLUDED_REASON = "excluded"
"""Reason why a road user in `exclude` is not taken over."""
NEAR_JUNCTION = 2.0
"""Distance (m) before the end of its lane, in addition to the way of one decision, within which a vehicle is not taken
over: after its first step it could be in a turn that it cannot follow, or past its destination, where SUMO does not
take it back."""
JUNCTION_STANDING_SPEED = 0.5
"""Speed (m/s) up to which vehicles are taken over inside junctions, too; in one decision they move by 0.2 m at most."""
REAR_TOLERANCE = 0.2
"""Length (m) of a vehicle that may still be before its lane: SUMO's vehicles depart within 0.1 m of their length."""
RIM = 8.0
"""Distance (m) outside the network's bounding box up to which a road user of the scenario may be."""


@dataclass(frozen=True)
class Takeover:
    """Rule of the takeover: a share of each type, (3,), of the scenario's road users in a region, drawn by seed."""

    shares: Floats
    region: Region
    seed: int
    most: float = np.inf
    """Greatest number of learned road users at the same time; further road users stay SUMO's until there is room."""


class Handover:
    """Takes road users of the scenario over, except those in `exclude`, and hands them back to SUMO.

    `left`: road users that match the takeover but cannot be taken over, with the reason. `finished`: ids of road users
    that are not taken over again. `handed_back`: ids of road users that were learned and have not arrived.
    """

    def __init__(
        self,
        takeover: Takeover | None,
        population: Population,
        control: TakenOverControl,
        driver: Driver,
        network: Network,
        road_map: RoadMap,
        exclude: frozenset[str] = frozenset(),
    ) -> None:
        self._takeover, self._population, self._control = takeover, population, control
        self._driver, self._road_map, self._exclude = driver, road_map, exclude
        self._fast = fast_lanes(network, driver.max_speed)
        self._lane_ends = {lane.id: lane.length for lane in network.lanes if not lane.internal}
        self.left: dict[str, str] = {}
        self.finished: set[str] = set()
        self.handed_back: set[str] = set()
        self._turning: dict[str, float] = {}
        """Time (s) until which SUMO keeps road users that cannot follow a turn."""

    def return_to_route(self) -> tuple[str, ...]:
        """Let SUMO put taken-over road users that have left the scene or their route back on their route.

        Unlike spawned road users, they do not wrap around. Returns their ids.
        """
        if not self._population.taken_over.any():
            return ()
        learned = self._population.world
        # Walks lead around the ends of streets, on the rim of the network.
        gone = left_scene(learned, self._road_map, rim=RIM) | self._driver.off_route(learned.ids)
        returned = self._population.hand_back(gone, off_route=True)
        # They would leave their route again: from now on SUMO drives them.
        self.finished.update(returned)
        return returned

    def hand_back(self, snapshot: Snapshot, time: float) -> tuple[str, ...]:
        """Hand back road users that leave the region, or that their models cannot drive on; `time`: now, s."""
        if self._takeover is None or not self._population.taken_over.any():
            return ()
        learned = self._population.world
        ending = self._driver.near_end(learned.ids)
        leaving = ending | ~self._takeover.region.inside(learned.x, learned.y, HYSTERESIS)
        leaving |= self._population.unsupported()
        if self._fast:
            leaving |= self._on_fast_lane(learned.ids, snapshot)
        turning = self._driver.cannot_follow(learned.ids)
        leaving |= turning
        ending_ids = {learned.ids[row] for row in np.flatnonzero(ending)}
        back = self._population.hand_back(leaving)
        # A road user that is about to arrive is not taken over again.
        self.finished.update(ending_ids.intersection(back))
        self._turning |= {learned.ids[row]: time + SHARP_TURN_TIME for row in np.flatnonzero(turning)}
        return back

    def take_over(
        self,
        users: WorldState,
        snapshot: Snapshot,
        handed_back: tuple[str, ...],
        time: float,
        yielding: Yielding | None,
    ) -> tuple[str, ...]:
        """Take over the `users`, SUMO's in this `snapshot`, that match the takeover and were not just `handed_back`.

        `time`: now, s. `yielding`: may hold some of these road users, and then releases them.
        """
        rule = self._takeover
        if rule is None:
            return ()
        learned_before = self._population.ids
        # During the turn, SUMO keeps the vehicle at any rate: at the end, a learned vehicle would not be on its lane.
        if self._turning:
            lane = dict(zip(snapshot.ids, snapshot.lane, strict=True))
            inside = {user for user in self._turning if lane.get(user, "").startswith(":")}
            self._turning = {user: end for user, end in self._turning.items() if end > time or user in inside}
        skip = learned_before.union(handed_back, self.finished, self._turning)
        wanted = drawn(users.ids, users.type, rule.shares, rule.seed)
        wanted &= rule.region.inside(users.x, users.y)
        # Ids with the prefix of spawned road users mark road users without a route.
        wanted &= np.array([i not in skip and not i.startswith(SPAWNED_PREFIX) for i in users.ids], np.bool_)
        excluded = [users.ids[row] for row in np.flatnonzero(wanted) if users.ids[row] in self._exclude]
        wanted &= np.array([i not in self._exclude for i in users.ids], np.bool_)
        vehicles = np.flatnonzero(wanted & (users.type != RoadUserType.PEDESTRIAN))
        if len(vehicles):
            wanted[vehicles] = ~self._near_junction(vehicles, users, snapshot)
        # SUMO sets the heading of a person at its first step: until then, the heading may be wrong.
        persons = np.flatnonzero(users.type == RoadUserType.PEDESTRIAN)
        wanted[persons] &= users.speed[persons] > STANDING_SPEED
        # Persons of a flow depart inside each other: SUMO separates them, but learned pedestrians would stay in single
        # file.
        wanted[persons[colliding_pairs(users.take(persons))]] = False
        room = int(min(rule.most - len(learned_before), len(users)))
        rows = np.flatnonzero(wanted) if room > 0 else np.zeros(0, np.intp)
        ids = tuple(users.ids[row] for row in rows)
        obstacles = self._control.obstacles(ids, snapshot.person[rows], models=self._driver.has_models)
        if self._fast:
            fast = self._on_fast_lane(ids, snapshot).tolist()
            obstacles = tuple(why or FAST_LANE_REASON * on for why, on in zip(obstacles, fast, strict=True))
        # A road user that was learned before already counts as handed back.
        self.left = {
            user: why for user, why in zip(ids, obstacles, strict=True) if why and user not in self.handed_back
        } | dict.fromkeys(excluded, EXCLUDED_REASON)
        rows = rows[np.array([not why for why in obstacles], np.bool_)]
        rows = rows[self._can_brake(users.take(rows), snapshot.person[rows])][:room]
        taken = tuple(users.ids[row] for row in rows)
        if taken:
            if yielding is not None:
                yielding.release(taken)
            self._population.take_over(users.take(rows), tuple(snapshot.sumo_type[row] for row in rows))
            taken = tuple(i for i in taken if i in self._population.ids)
        return taken

    def _near_junction(self, rows: NDArray[np.intp], users: WorldState, snapshot: Snapshot) -> NDArray[np.bool_]:
        """Whether each vehicle of n `rows` moves in a junction, at least with its rear, or may do so after one
        decision, (n,)."""
        lanes, front = [snapshot.lane[row] for row in rows.tolist()], snapshot.lane_position[rows]
        left = np.array([self._lane_ends.get(lane, -math.inf) for lane in lanes]) - front
        near = left < NEAR_JUNCTION + DECISION_INTERVAL * users.speed[rows]
        # After a sharp turn, SUMO's vehicles do not have the direction of their lane yet.
        near |= front < users.length[rows] - REAR_TOLERANCE
        # Standing vehicles are taken over: otherwise they could block learned vehicles for ever.
        near &= users.speed[rows] > JUNCTION_STANDING_SPEED
        # Vehicles on no lane get their own reason later.
        return np.asarray(near & np.array([lane != "" for lane in lanes]))

    def _can_brake(self, users: WorldState, person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether the models of n of SUMO's road users brake hard enough for what SUMO brakes for at present, (n,).

        SUMO inserts vehicles as near before a red signal as their own deceleration allows, which may be twice that of
        the recorded ones: taken over at 20 m/s, they passed at red.
        """
        needed = self._control.needed_deceleration(users.ids, person, DECISION_INTERVAL)
        return np.asarray(needed <= -self._driver.hardest_braking[users.type])

    def _on_fast_lane(self, ids: tuple[str, ...], snapshot: Snapshot) -> NDArray[np.bool_]:
        """Whether each road user is on a fast lane (see `fast_lanes`), (n,)."""
        lane = dict(zip(snapshot.ids, snapshot.lane, strict=True))
        return np.array([lane.get(road_user, "") in self._fast for road_user in ids], np.bool_)


def fast_lanes(network: Network, max_speed: Floats) -> frozenset[str]:
    """Ids of car lanes with a speed limit above FAST_LANE_RATIO times the top speed of learned cars.

    No vehicle is learned there, because all other vehicles would queue behind it. `max_speed`: of each type, m/s, (3,);
    with 0 for cars, the result is empty.
    """
    most = FAST_LANE_RATIO * float(max_speed[RoadUserType.CAR]) or np.inf
    return frozenset(
        lane.id
        for lane in network.lanes
        if lane.max_speed > most and lane.surface == Surface.ROAD and not lane.internal
    )


def drawn(ids: Sequence[str], types: NDArray[np.int8], shares: Floats, seed: int) -> NDArray[np.bool_]:
    """Whether each of n road users is drawn for the takeover, (n,).

    `types`: RoadUserType, (n,). `shares`: by type, (3,). The draw depends only on the seed and the id, so that the same
    road users are learned in each run, and a larger share includes the road users of a smaller share.
    """
    return np.array([_position(i, seed) for i in ids], np.float64) < shares[types]


@lru_cache(maxsize=100_000)
def _position(road_user: str, seed: int) -> float:
    """A pseudo-random number in [0, 1) from id and seed; Python's hash() would differ from process to process."""
    digest = hashlib.blake2b(f"{seed}:{road_user}".encode(), digest_size=8).digest()
    # A float has 53 bits: 64 bits could round up to 1.
    return (int.from_bytes(digest) >> 11) / 2.0**53
