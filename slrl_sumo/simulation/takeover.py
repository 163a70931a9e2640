"""Which of the scenario's own road users become learned ones, and when they are SUMO's again."""

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
"""m that a road user may be outside the region before it is handed back."""

FAST_LANE_RATIO = 1.2
"""Ratio of a lane's speed limit to the top speed of learned cars above which they do not use it."""
SHARP_TURN_TIME = 10.0
"""s for which SUMO drives a road user before a turn that its models cannot follow; it may be handed back again."""
FAST_LANE_REASON = "fast lane"
"""Why a road user stays SUMO's there."""
EXCLUDED_REASON = "excluded"
"""Why one stays SUMO's, or the script's, by its id."""
NEAR_JUNCTION = 2.0
"""m before the end of its lane, and those of one decision, within which a vehicle is not taken over: after its first
step it could be in a turn that it cannot follow, or beyond its destination, where SUMO does not take it back."""
JUNCTION_STANDING_SPEED = 0.5
"""m/s: slower vehicles are taken over in junctions, too; in one decision they go 0.2 m at most."""
REAR_TOLERANCE = 0.2
"""m of a vehicle's length that may still be before its lane: SUMO's depart within 0.1 m of the whole length."""
RIM = 8.0
"""m outside the network's bounding box that a road user of the scenario may be."""


@dataclass(frozen=True)
class Takeover:
    """Which road users of the scenario become learned: a share of each type, (3,), inside a region, drawn by seed."""

    shares: Floats
    region: Region
    seed: int
    most: float = np.inf
    """Road users that are learned at the same time; further ones stay SUMO's until there is room."""


class Handover:
    """Takes road users of the scenario over, but none in `exclude`, and hands them back to SUMO.

    `left`: road users in the network that a takeover wants but cannot take, and why; `finished`: ids of those that are
    not taken over again; `handed_back`: ids of those that were learned before, and have not arrived.
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
        """Until when (s) SUMO keeps road users that cannot follow a turn."""

    def return_to_route(self) -> tuple[str, ...]:
        """Taken-over road users that have left the scene do not wrap around: SUMO puts them back on their route."""
        if not self._population.taken_over.any():
            return ()
        learned = self._population.world
        # Walks lead around the ends of streets, on the rim of the network.
        gone = left_scene(learned, self._road_map, rim=RIM) | self._driver.off_route(learned.ids)
        returned = self._population.hand_back(gone, off_route=True)
        # They would leave it again: from here on SUMO drives them.
        self.finished.update(returned)
        return returned

    def hand_back(self, snapshot: Snapshot, time: float) -> tuple[str, ...]:
        """Hand back those that leave the region, or that their models cannot drive any further; `time`: now, s."""
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
        """Take over those of `users`, SUMO's in this `snapshot`, that the takeover wants; not those just `handed_back`.

        `time`: now, s; `yielding` may hold some of them.
        """
        rule = self._takeover
        if rule is None:
            return ()
        learned_before = self._population.ids
        # In the turn itself SUMO goes on, however long it takes: at its end a learned vehicle would not be on its lane.
        if self._turning:
            lane = dict(zip(snapshot.ids, snapshot.lane, strict=True))
            inside = {user for user in self._turning if lane.get(user, "").startswith(":")}
            self._turning = {user: end for user, end in self._turning.items() if end > time or user in inside}
        skip = learned_before.union(handed_back, self.finished, self._turning)
        wanted = drawn(users.ids, users.type, rule.shares, rule.seed)
        wanted &= rule.region.inside(users.x, users.y)
        # Ids of spawned road users are those of road users without a route.
        wanted &= np.array([i not in skip and not i.startswith(SPAWNED_PREFIX) for i in users.ids], np.bool_)
        excluded = [users.ids[row] for row in np.flatnonzero(wanted) if users.ids[row] in self._exclude]
        wanted &= np.array([i not in self._exclude for i in users.ids], np.bool_)
        vehicles = np.flatnonzero(wanted & (users.type != RoadUserType.PEDESTRIAN))
        if len(vehicles):
            wanted[vehicles] = ~self._near_junction(vehicles, users, snapshot)
        # SUMO sets the heading of a person with its first step: until then it may face the other way.
        persons = np.flatnonzero(users.type == RoadUserType.PEDESTRIAN)
        wanted[persons] &= users.speed[persons] > STANDING_SPEED
        # Persons of a flow depart inside each other: SUMO leads them apart, learned ones would stay in single file.
        wanted[persons[colliding_pairs(users.take(persons))]] = False
        room = int(min(rule.most - len(learned_before), len(users)))
        rows = np.flatnonzero(wanted) if room > 0 else np.zeros(0, np.intp)
        ids = tuple(users.ids[row] for row in rows)
        obstacles = self._control.obstacles(ids, snapshot.person[rows], models=self._driver.has_models)
        if self._fast:
            fast = self._on_fast_lane(ids, snapshot).tolist()
            obstacles = tuple(why or FAST_LANE_REASON * on for why, on in zip(obstacles, fast, strict=True))
        # Where one was learned before, it is counted as handed back.
        self.left = {
            user: why for user, why in zip(ids, obstacles, strict=True) if why and user not in self.handed_back
        } | dict.fromkeys(excluded, EXCLUDED_REASON)
        rows = rows[np.array([not why for why in obstacles], np.bool_)][:room]
        taken = tuple(users.ids[row] for row in rows)
        if taken:
            if yielding is not None:
                yielding.release(taken)
            self._population.take_over(users.take(rows), tuple(snapshot.sumo_type[row] for row in rows))
            taken = tuple(i for i in taken if i in self._population.ids)
        return taken

    def _near_junction(self, rows: NDArray[np.intp], users: WorldState, snapshot: Snapshot) -> NDArray[np.bool_]:
        """Which of the vehicles in n `rows` move in a junction, at least with their rear, or may do so after one
        decision, (n,)."""
        lanes, front = [snapshot.lane[row] for row in rows.tolist()], snapshot.lane_position[rows]
        left = np.array([self._lane_ends.get(lane, -math.inf) for lane in lanes]) - front
        near = left < NEAR_JUNCTION + DECISION_INTERVAL * users.speed[rows]
        # Behind a sharp turn SUMO's vehicles are not yet in the direction of the lane.
        near |= front < users.length[rows] - REAR_TOLERANCE
        # Those that stand could be in the way of learned ones for ever.
        near &= users.speed[rows] > JUNCTION_STANDING_SPEED
        # On no lane: why these cannot be taken over is said later.
        return np.asarray(near & np.array([lane != "" for lane in lanes]))

    def _on_fast_lane(self, ids: tuple[str, ...], snapshot: Snapshot) -> NDArray[np.bool_]:
        """Which road users are on a lane where SUMO's vehicles are faster than learned ones can be, (n,)."""
        lane = dict(zip(snapshot.ids, snapshot.lane, strict=True))
        return np.array([lane.get(road_user, "") in self._fast for road_user in ids], np.bool_)


def fast_lanes(network: Network, max_speed: Floats) -> frozenset[str]:
    """Ids of car lanes with a limit above FAST_LANE_RATIO times the top speed of learned cars (`max_speed`: of each
    type, (3,) m/s): no vehicle is learned there, because all others would queue behind it. None where no cars are
    learned."""
    most = FAST_LANE_RATIO * float(max_speed[RoadUserType.CAR]) or np.inf
    return frozenset(
        lane.id
        for lane in network.lanes
        if lane.max_speed > most and lane.surface == Surface.ROAD and not lane.internal
    )


def drawn(ids: Sequence[str], types: NDArray[np.int8], shares: Floats, seed: int) -> NDArray[np.bool_]:
    """Which of n road users are to be taken over, (n,).

    `types`: RoadUserType, (n,); `shares`: by type, (3,). The draw depends on the seed and the id alone, so that the
    same road users are learned in every run, whatever happens in it, and a larger share adds to a smaller one.
    """
    return np.array([_position(i, seed) for i in ids], np.float64) < shares[types]


@lru_cache(maxsize=100_000)
def _position(road_user: str, seed: int) -> float:
    """A number in [0, 1) that is the id's own. Python's hash() would differ from process to process."""
    digest = hashlib.blake2b(f"{seed}:{road_user}".encode(), digest_size=8).digest()
    # 53 bits are what a float holds: all 64 could round up to 1.
    return (int.from_bytes(digest) >> 11) / 2.0**53
