"""The simulation loop: learned road users and SUMO, decision by decision."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.driver import Driver, Moved
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.background.yielding import Yielding
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, SPAWNED_PREFIX, RoadUserType
from slrl_sumo.simulation.background_state import Differences, background_world, places_of
from slrl_sumo.simulation.events import LEFT_SURFACE, Decision, Step
from slrl_sumo.simulation.population import Population
from slrl_sumo.simulation.region import Region
from slrl_sumo.simulation.spawn import draw_starts, starting_points, starting_speeds
from slrl_sumo.simulation.takeover import drawn
from slrl_sumo.simulation.wraparound import left_scene, reinsert, start_anew
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.reader import Reader, Snapshot
from slrl_sumo.sumo.road_users import arrived_ids
from slrl_sumo.sumo.spawned import SpawnedControl
from slrl_sumo.sumo.taken_over import TakenOverControl

WALKING = 0.1
"""m/s: slower persons are not taken over."""
HYSTERESIS = 5.0
"""m that a road user may be outside the region before it is handed back."""

FAST_LANE = 1.2
"""Ratio of a lane's speed limit to the top speed of learned cars above which they do not use it."""
TURNING = 10.0
"""s for which SUMO drives a road user before a turn that its models cannot follow; it may be handed back again."""
FAST = "fast lane"
"""Why a road user stays SUMO's there."""
RIM = 8.0
"""m outside the network's bounding box that a road user of the scenario may be."""


class Simulation(Protocol):
    """What the loop needs of a running SUMO: a SumoSession, or the simulation of a user's script."""

    api: SumoApi
    network: Network
    step_length: float
    spawned: SpawnedControl
    reader: Reader

    @property
    def time(self) -> float:
        """Simulation time of the next step, s."""
        ...

    def step(self) -> None:
        """One SUMO step."""
        ...


@dataclass(frozen=True)
class Takeover:
    """Which road users of the scenario become learned: a share of each type, (3,), inside a region, drawn by seed."""

    shares: Floats
    region: Region
    seed: int
    most: float = np.inf
    """Road users that are learned at the same time; further ones stay SUMO's until there is room."""


@dataclass
class _Interval:
    """A decision interval that is under way."""

    states: list[WorldState]
    """Where the learned road users are after each of its SUMO steps."""
    moved: Moved
    wrapped_around: NDArray[np.bool_]
    steps: list[Step]
    arrived: set[str]
    interventions: int


class CoSimulation:
    """Learned road users in a running simulation.

    Call `spawn` (or not), then `start` once, then `step` for every SUMO step or `decide` for every 0.4 s, and `release`
    at the end. `population`: the learned road users; `world`: all road users as they are now; `surfaces` and
    `road_map`: the ground; `points`: the places per type where road users may start.
    """

    def __init__(
        self,
        simulation: Simulation,
        driver: Driver,
        *,
        takeover: Takeover | None = None,
        yielding: bool = True,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        self.surfaces = simulation.network.surfaces()
        self.road_map = RoadMap(self.surfaces)
        self._simulation, self._driver, self._takeover = simulation, driver, takeover
        self._substeps = round(DECISION_INTERVAL / simulation.step_length)
        self._taken_over_control = TakenOverControl(simulation.api, simulation.network)
        self.population = Population(simulation.spawned, self._taken_over_control)
        self.points = starting_points(simulation.network)
        self._yielding = Yielding(simulation.api, simulation.network, simulation.step_length) if yielding else None
        self._differences = Differences()
        self._snapshot: Snapshot | None = None
        self._interval: _Interval | None = None
        self._taken_at_start: tuple[str, ...] = ()
        self._left: dict[str, str] = {}
        """Road users in the network that a takeover wants but cannot take, and why."""
        self._finished: set[str] = set()
        self._turning: dict[str, float] = {}
        """Until when (s) SUMO keeps road users that cannot follow a turn."""
        self._handed_back: set[str] = set()
        """Road users of the scenario that were learned before, and have not arrived."""
        self._refusals = [simulation.spawned.refusals, self._taken_over_control.refusals, driver.refusals]
        self._refusals += [] if self._yielding is None else [self._yielding.refusals]
        self._refused: dict[str, str] = {}
        self._time: float | None = None
        self._fast = fast_lanes(simulation.network, driver.max_speed)
        self._stopwatch = stopwatch or Stopwatch()
        self.world = self.population.world

    @property
    def held(self) -> frozenset[str]:
        """Ids of the background vehicles that are held for learned road users now."""
        return frozenset() if self._yielding is None else self._yielding.held

    def spawn(self, counts: NDArray[np.int64], max_speed: Floats, seed: int) -> None:
        """Add road users: `counts` per type, (3,), at legal places drawn by `seed`; `max_speed` per type, m/s, (3,)."""
        rng = np.random.default_rng(seed)
        starts = draw_starts(counts, self.points, rng)
        self.population.spawn(*starts[:4], starting_speeds(starts, max_speed, rng), self._simulation.time)
        self._drop_refused()

    def start(self) -> Step:
        """One SUMO step, after which spawned road users stand at their places and the first ones are taken over."""
        users = self.population.world
        step = self._play(users)
        no_rows = np.zeros(len(users), np.bool_)
        self._taken_at_start = self._close(
            _Interval([users], Moved(users, None, {}), no_rows, [step], set(), 0)
        ).taken_over
        self._left = {}  # so that the first decision names them
        return step

    def decide(self) -> Decision:
        """One decision of every learned road user and all SUMO steps of its interval."""
        while True:
            _, decision = self.step()
            if decision is not None:
                return decision

    def step(self) -> tuple[Step, Decision | None]:
        """One SUMO step; with the last one of an interval comes the whole Decision.

        Where SUMO was stepped by others since the last call, a new interval begins with where it has the road users.
        """
        if self._simulation.time != self._time:
            self._resume()
        interval = self._interval or self._decide()
        before = self._yielding.interventions if self._yielding is not None else 0
        step = self._play(interval.states[len(interval.steps)], interval.moved.context)
        interval.steps.append(step)
        interval.arrived |= arrived_ids(self._simulation.api)
        if self._yielding is not None:
            interval.interventions += self._yielding.interventions - before
        self._interval = interval
        if len(interval.steps) < self._substeps:
            return step, None
        self._interval = None
        decision = self._close(interval)
        self._refused = {}
        return step, decision

    def start_anew(self, rows: NDArray[np.intp], max_speed: Floats, rng: np.random.Generator) -> None:
        """Put spawned road users `rows` to new places as `spawn` does; between two decisions."""
        learned = self.population.world
        background = self.world.take(np.arange(len(learned), len(self.world)))
        self.population.world = start_anew(learned, rows, background, self.points, max_speed, rng)
        self.world = self.population.world.join(background)

    def release(self) -> None:
        """Hand everything that belongs to the scenario back to SUMO, and remove the spawned road users."""
        if self._yielding is not None:
            self._yielding.release()
        self._taken_over_control.release()
        self._drop_refused()
        spawned = self.population.world.take(np.flatnonzero(~self.population.taken_over))
        self._simulation.spawned.remove(spawned.ids)

    def _decide(self) -> _Interval:
        learned = self.population.world
        moved = Moved(learned, None, {})
        if len(learned):
            moved = self._driver.drive(self.world, len(learned), self.road_map)
            self._drop_refused()
        following = moved.users
        wrapped_around = ~self.population.taken_over
        if wrapped_around.any():
            wrapped_around &= left_scene(following, self.road_map, self._simulation.network.exits)
        if wrapped_around.any():
            background = self.world.take(np.arange(len(learned), len(self.world)))
            following = reinsert(following, wrapped_around, background, self.points, self.road_map)
        shares = np.arange(1, self._substeps + 1) / self._substeps
        states = [between(learned, following, share, wrapped_around) for share in shares]
        self._stopwatch.lap("advance")
        return _Interval(states, moved, wrapped_around, [], set(), 0)

    def _play(self, users: WorldState, context: RouteContext | None = None) -> Step:
        """One SUMO step, after which the learned road users are at the places of `users`."""
        time = self._simulation.time
        if self._yielding is not None and self._snapshot is not None:
            self._yielding.apply(self._snapshot, users, context)
        self.population.move(users)
        self._drop_refused()
        self._stopwatch.lap("apply")
        self._simulation.step()
        self._time = self._simulation.time
        self._stopwatch.lap("sumo")
        self._snapshot = self._simulation.reader.read()
        self.population.check(users, frozenset(self._snapshot.ids))
        background = background_world(self._snapshot, self._simulation.time, self.population.ids)
        places = places_of(users, self.population.sumo_types, background, self._snapshot)
        self._stopwatch.lap("read")
        return Step(time, replace(users, time=time).join(background), places)

    def _close(self, interval: _Interval) -> Decision:
        """The end of an interval: drop removed road users, hand back, take over, and assemble the world."""
        assert self._snapshot is not None
        users = replace(interval.states[-1], time=self._simulation.time)
        surface = self.road_map.surface_at(users.x, users.y)
        left_surface = self.road_map.beyond_own_surface(users.type, users.x, users.y, LEFT_SURFACE)
        gone = self.population.settle(users)
        arrived = np.zeros(len(users), np.bool_)
        if not interval.arrived.isdisjoint(users.ids):
            arrived[:] = [road_user in interval.arrived for road_user in users.ids]
        returned = self._return_to_route()
        handed_back = returned + self._hand_back()
        background = background_world(self._snapshot, self._simulation.time, frozenset())
        told = self._left
        taken_over = self._taken_at_start + self._take_over(self._differences.complete(background), handed_back)
        self._taken_at_start = ()
        arrived_learned = tuple(users.ids[row] for row in np.flatnonzero(gone & arrived))
        self._driver.forget(tuple(set(users.ids) - self.population.ids))
        arrived_later = tuple(sorted(self._handed_back & interval.arrived))
        self._handed_back.update(handed_back, self._refused.keys() & set(users.ids))
        self._handed_back.difference_update(arrived_later, self.population.ids)
        self._stopwatch.lap("read")
        return Decision(
            steps=tuple(interval.steps),
            modes=interval.moved.modes,
            constraints={name: int(changed.sum()) for name, changed in interval.moved.changed.items()},
            surface=surface,
            left_surface=left_surface,
            wrapped_around=interval.wrapped_around,
            lost=gone & ~arrived,
            arrived=arrived_learned + arrived_later,
            under_way=len(self.population.ids) + len(self._handed_back.intersection(self._snapshot.ids)),
            taken_over=taken_over,
            handed_back=handed_back,
            returned_to_route=returned,
            interventions=interval.interventions,
            left_to_sumo=tuple(item for item in self._left.items() if item not in told.items()),
            refused=tuple(self._refused.items()),
        )

    def _drop_refused(self) -> None:
        """Road users for which SUMO has refused a call are its own again, and stay that."""
        for refusals in self._refusals:
            if reasons := refusals.take():
                self.population.drop(reasons)
                self._finished.update(reasons)
                self._refused = reasons | self._refused

    def _resume(self) -> None:
        self._interval, self._differences = None, Differences()
        self._snapshot, self._time = self._simulation.reader.read(), self._simulation.time
        present = self._differences.complete(background_world(self._snapshot, self._time, frozenset()))
        self._driver.forget(self.population.resume(present))
        self._assemble(present)

    def _return_to_route(self) -> tuple[str, ...]:
        """Taken-over road users that have left the scene do not wrap around: SUMO puts them back on their route."""
        if not self.population.taken_over.any():
            return ()
        learned = self.population.world
        # Walks lead around the ends of streets, on the rim of the network.
        gone = left_scene(learned, self.road_map, rim=RIM) | self._driver.off_route(learned.ids)
        returned = self.population.hand_back(gone, off_route=True)
        # They would leave it again: from here on SUMO drives them.
        self._finished.update(returned)
        return returned

    def _hand_back(self) -> tuple[str, ...]:
        if self._takeover is None or not self.population.taken_over.any():
            return ()
        learned = self.population.world
        ending = self._driver.near_end(learned.ids)
        leaving = ending | ~self._takeover.region.inside(learned.x, learned.y, HYSTERESIS)
        leaving |= self.population.unsupported()
        if self._fast:
            leaving |= self._on_fast_lane(learned.ids)
        turning = self._driver.cannot_follow(learned.ids)
        leaving |= turning
        ending_ids = {learned.ids[row] for row in np.flatnonzero(ending)}
        back = self.population.hand_back(leaving)
        # A road user that is about to arrive is not taken over again.
        self._finished.update(ending_ids.intersection(back))
        until = self._simulation.time + TURNING
        self._turning = {user: end for user, end in self._turning.items() if end > self._simulation.time}
        self._turning |= {learned.ids[row]: until for row in np.flatnonzero(turning)}
        return back

    def _on_fast_lane(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which road users are on a lane where SUMO's vehicles are faster than learned ones can be, (n,)."""
        assert self._snapshot is not None
        lane = dict(zip(self._snapshot.ids, self._snapshot.lane, strict=True))
        return np.array([lane.get(road_user, "") in self._fast for road_user in ids], np.bool_)

    def _take_over(self, users: WorldState, handed_back: tuple[str, ...]) -> tuple[str, ...]:
        """Take over `users` in the region, and set `world`."""
        learned_before = self.population.ids
        taken: tuple[str, ...] = ()
        if self._takeover is not None and self._snapshot is not None:
            rule = self._takeover
            turning = {user for user, end in self._turning.items() if end > self._simulation.time}
            skip = learned_before.union(handed_back, self._finished, turning)
            wanted = drawn(users.ids, users.type, rule.shares, rule.seed)
            wanted &= rule.region.inside(users.x, users.y)
            # Ids of spawned road users are those of road users without a route.
            own = SPAWNED_PREFIX
            wanted &= np.array([i not in skip and not i.startswith(own) for i in users.ids], np.bool_)
            # SUMO sets the heading of a person with its first step: until then it may face the other way.
            wanted &= (users.type != RoadUserType.PEDESTRIAN) | (users.speed > WALKING)
            room = int(min(rule.most - len(learned_before), len(users)))
            rows = np.flatnonzero(wanted) if room > 0 else np.zeros(0, np.intp)
            ids = tuple(users.ids[row] for row in rows)
            obstacles = self._taken_over_control.obstacles(
                ids, self._snapshot.person[rows], models=self._driver.has_models
            )
            if self._fast:
                fast = self._on_fast_lane(ids).tolist()
                obstacles = tuple(why or FAST * on for why, on in zip(obstacles, fast, strict=True))
            # Where one was learned before, it is counted as handed back.
            self._left = {
                user: why for user, why in zip(ids, obstacles, strict=True) if why and user not in self._handed_back
            }
            rows = rows[np.array([not why for why in obstacles], np.bool_)][:room]
            taken = tuple(users.ids[row] for row in rows)
            if taken:
                if self._yielding is not None:
                    self._yielding.release(taken)
                self.population.take_over(users.take(rows), tuple(self._snapshot.sumo_type[row] for row in rows))
                taken = tuple(i for i in taken if i in self.population.ids)
        self._assemble(users)
        return taken

    def _assemble(self, users: WorldState) -> None:
        """Set `world`: the learned road users first, then all other `users`."""
        others = np.array([i for i, user in enumerate(users.ids) if user not in self.population.ids], np.intp)
        self.world = self.population.world.join(users.take(others))


def fast_lanes(network: Network, max_speed: Floats) -> frozenset[str]:
    """Ids of car lanes with a limit above FAST_LANE times the top speed of learned cars (`max_speed`: of each type,
    (3,) m/s): no vehicle is learned there, because all others would queue behind it. None where no cars are learned."""
    most = FAST_LANE * float(max_speed[RoadUserType.CAR]) or np.inf
    return frozenset(
        lane.id
        for lane in network.lanes
        if lane.max_speed > most and lane.surface == Surface.ROAD and not lane.internal
    )


def between(a: WorldState, b: WorldState, share: float, jumped: NDArray[np.bool_]) -> WorldState:
    """Road users on straight lines from `a` to `b`, at `share` in (0, 1]; those that `jumped`, (n,), are at `b`."""

    def mix(p: Floats, q: Floats) -> Floats:
        return np.where(jumped, q, p + share * (q - p))

    turn = wrap_angle(b.heading - a.heading)
    return replace(
        b,
        x=mix(a.x, b.x),
        y=mix(a.y, b.y),
        heading=np.where(jumped, b.heading, wrap_angle(a.heading + share * turn)),
    )
