"""The simulation loop: learned road users and SUMO, decision by decision."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.driver import Driver, Moved
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.background.yielding import Yielding
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.background_state import Differences, background_world, places_of
from slrl_sumo.simulation.events import LEFT_SURFACE, Decision, Step
from slrl_sumo.simulation.placement.spawn import draw_starts, starting_points, starting_speeds
from slrl_sumo.simulation.placement.wraparound import left_scene, reinsert, start_anew
from slrl_sumo.simulation.population import Population
from slrl_sumo.simulation.takeover import Handover, Takeover
from slrl_sumo.simulation.trace_places import TracePlaces
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.reader import Reader, Snapshot
from slrl_sumo.sumo.road_users import arrived_ids
from slrl_sumo.sumo.spawned import SpawnedControl
from slrl_sumo.sumo.taken_over import TakenOverControl


class Session(Protocol):
    """The interface of a running SUMO to CoSimulation: a SumoSession, or the AttachedSession of a user's script."""

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
        """Run a SUMO step."""
        ...


@dataclass
class _Interval:
    """The present decision interval."""

    states: list[WorldState]
    """States of the learned road users after each SUMO step of the interval."""
    moved: Moved
    wrapped_around: NDArray[np.bool_]
    steps: list[Step]
    arrived: set[str]
    interventions: int


class CoSimulation:
    """Learned road users in a running simulation.

    Call `spawn` (optional), then `start` once, then `step` for each SUMO step or `decide` for each 0.4 s, and `release`
    at the end. `population`: the learned road users. `world`: all road users now. `surfaces` and `road_map`: the
    ground. `points`: the starting points of each type. `driver`: moves the learned road users. Ids in `exclude` are
    neither taken over nor held. `traced`: whether the places in the steps go into a trace; if not, spawned persons have
    no places, and taken-over persons those of SUMO.
    """

    def __init__(
        self,
        session: Session,
        driver: Driver,
        *,
        takeover: Takeover | None = None,
        yielding: bool = True,
        exclude: Collection[str] = (),
        stopwatch: Stopwatch | None = None,
        traced: bool = False,
    ) -> None:
        self.surfaces = session.network.surfaces()
        self.road_map = RoadMap(self.surfaces)
        self._session, self.driver = session, driver
        self._substeps = round(DECISION_INTERVAL / session.step_length)
        self._taken_over_control = TakenOverControl(session.api, session.network)
        self.population = Population(session.spawned, self._taken_over_control)
        self._handover = Handover(
            takeover,
            self.population,
            self._taken_over_control,
            driver,
            session.network,
            self.road_map,
            frozenset(exclude),
        )
        self.points = starting_points(session.network)
        self._yielding = Yielding(session.api, session.network, session.step_length, exclude) if yielding else None
        self._differences = Differences()
        self._snapshot: Snapshot | None = None
        self._interval: _Interval | None = None
        self._taken_at_start: tuple[str, ...] = ()
        self._refusals = [session.spawned.refusals, self._taken_over_control.refusals, driver.refusals]
        self._refusals += [] if self._yielding is None else [self._yielding.refusals]
        self._refused: dict[str, str] = {}
        self._trace_places = TracePlaces(session.api, session.network) if traced else None
        self._takes_over = takeover is not None
        self._time: float | None = None
        self._stopwatch = stopwatch or Stopwatch()
        self.world = self.population.world

    @property
    def held(self) -> frozenset[str]:
        """Ids of the background road users that are presently held for learned road users."""
        return frozenset() if self._yielding is None else self._yielding.held

    def spawn(self, counts: NDArray[np.int64], max_speed: Floats, seed: int) -> None:
        """Add road users: `counts` per type, (3,), at legal places drawn by `seed`; `max_speed` per type, m/s, (3,)."""
        rng = np.random.default_rng(seed)
        starts = draw_starts(counts, self.points, rng)
        self.population.spawn(*starts[:4], starting_speeds(starts, max_speed, rng), self._session.time)
        self._drop_refused()

    def start(self) -> Step:
        """Run a SUMO step: spawned road users are at their starting places, and the first ones are taken over."""
        users = self.population.world
        step = self._step_sumo(users)
        no_rows = np.zeros(len(users), np.bool_)
        self._taken_at_start = self._close(
            _Interval([users], Moved(users, None, {}), no_rows, [step], set(), 0)
        ).taken_over
        self._handover.left = {}  # so that the first decision reports them
        return step

    def decide(self) -> Decision:
        """Run one decision of all learned road users, and all SUMO steps of the interval."""
        while True:
            _, decision = self.step()
            if decision is not None:
                return decision

    def step(self) -> tuple[Step, Decision | None]:
        """Run a SUMO step; the last step of an interval also returns the Decision.

        If the caller has stepped SUMO since the last call, a new interval begins at the road users' positions in SUMO.
        """
        if self._session.time != self._time:
            self._resume()
        interval = self._interval or self._decide()
        before = self._yielding.interventions if self._yielding is not None else 0
        step = self._step_sumo(interval.states[len(interval.steps)], interval.moved.context)
        interval.steps.append(step)
        interval.arrived |= arrived_ids(self._session.api)
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
        """Move the spawned road users `rows` to new starting places, as `spawn` does; call it between two decisions."""
        learned = self.population.world
        background = self.world.take(np.arange(len(learned), len(self.world)))
        self.population.world = start_anew(learned, rows, background, self.points, max_speed, rng)
        self.world = self.population.world.join(background)

    def release(self) -> None:
        """Hand all road users of the scenario back to SUMO, and remove the spawned road users."""
        if self._yielding is not None:
            self._yielding.release()
        self._taken_over_control.release()
        self._drop_refused()
        spawned = self.population.world.take(np.flatnonzero(~self.population.taken_over))
        self._session.spawned.remove(spawned.ids)

    def _decide(self) -> _Interval:
        learned = self.population.world
        moved = Moved(learned, None, {})
        if len(learned):
            moved = self.driver.drive(self.world, len(learned), self.road_map)
            self._drop_refused()
        following = moved.users
        wrapped_around = ~self.population.taken_over
        if wrapped_around.any():
            wrapped_around &= left_scene(following, self.road_map, self._session.network.exits)
        if wrapped_around.any():
            background = self.world.take(np.arange(len(learned), len(self.world)))
            following = reinsert(following, wrapped_around, background, self.points, self.road_map)
        shares = np.arange(1, self._substeps + 1) / self._substeps
        states = [between(learned, following, share, wrapped_around) for share in shares]
        self._stopwatch.lap("advance")
        return _Interval(states, moved, wrapped_around, [], set(), 0)

    def _step_sumo(self, users: WorldState, context: RouteContext | None = None) -> Step:
        """Run a SUMO step, after which the learned road users have the states `users`."""
        time = self._session.time
        if self._yielding is not None and self._snapshot is not None:
            self._yielding.apply(self._snapshot, users, context)
        self.population.move(users)
        self._drop_refused()
        self._stopwatch.lap("apply")
        self._session.step()
        self._time = self._session.time
        self._stopwatch.lap("sumo")
        self._snapshot = self._session.reader.read(self._known)
        self.population.check(users, self._snapshot.present)
        background = background_world(self._snapshot, self._session.time, self.population.ids)
        places = places_of(users, self.population.sumo_types, background, self._snapshot)
        world = replace(users, time=time).join(background)
        if self._trace_places is not None:
            places = self._trace_places.complete(places, world)
        self._stopwatch.lap("read")
        return Step(time, world, places)

    def _close(self, interval: _Interval) -> Decision:
        """End an interval: drop removed road users, hand back, take over, and assemble the world."""
        assert self._snapshot is not None
        users = replace(interval.states[-1], time=self._session.time)
        surface = self.road_map.surface_at(users.x, users.y)
        left_surface = self.road_map.beyond_own_surface(users.type, users.x, users.y, LEFT_SURFACE)
        gone = self.population.settle(users)
        arrived = np.zeros(len(users), np.bool_)
        if not interval.arrived.isdisjoint(users.ids):
            arrived[:] = [road_user in interval.arrived for road_user in users.ids]
        time = self._session.time
        returned = self._handover.return_to_route()
        handed_back = returned + self._handover.hand_back(self._snapshot, time)
        background = background_world(self._snapshot, self._session.time, frozenset())
        left_before, present = self._handover.left, self._differences.complete(background)
        taken_over = self._taken_at_start
        taken_over += self._handover.take_over(present, self._snapshot, handed_back, time, self._yielding)
        self._assemble(present)
        self._taken_at_start = ()
        arrived_learned = tuple(users.ids[row] for row in np.flatnonzero(gone & arrived))
        self.driver.forget(tuple(set(users.ids) - self.population.ids))
        outstanding = self._handover.handed_back
        arrived_later = tuple(sorted(outstanding & interval.arrived))
        outstanding.update(handed_back, self._refused.keys() & set(users.ids))
        outstanding.difference_update(arrived_later, self.population.ids)
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
            under_way=len(self.population.ids) + len(outstanding.intersection(self._snapshot.ids)),
            taken_over=taken_over,
            handed_back=handed_back,
            returned_to_route=returned,
            interventions=interval.interventions,
            left_to_sumo=tuple(item for item in self._handover.left.items() if item not in left_before.items()),
            refused=tuple(self._refused.items()),
        )

    @property
    def _known(self) -> frozenset[str]:
        """Ids of the spawned road users, whose states need not be read; none in runs with takeovers, which compare
        SUMO's persons with spawned ones."""
        return frozenset() if self._takes_over else self.population.spawned_ids

    def _drop_refused(self) -> None:
        """Return road users for which SUMO has refused a call to SUMO, permanently."""
        for refusals in self._refusals:
            if reasons := refusals.take():
                self.population.drop(reasons)
                self._handover.finished.update(reasons)
                self._refused = reasons | self._refused

    def _resume(self) -> None:
        self._interval, self._differences = None, Differences()
        self._snapshot, self._time = self._session.reader.read(), self._session.time
        present = self._differences.complete(background_world(self._snapshot, self._time, frozenset()))
        self.driver.forget(self.population.resume(present))
        self._assemble(present)

    def _assemble(self, users: WorldState) -> None:
        """Set `world`: the learned road users first, then all other `users`."""
        others = np.array([i for i, user in enumerate(users.ids) if user not in self.population.ids], np.intp)
        self.world = self.population.world.join(users.take(others))


def between(a: WorldState, b: WorldState, share: float, jumped: NDArray[np.bool_]) -> WorldState:
    """Road users on straight lines from `a` to `b`, at `share` in (0, 1]; road users that `jumped`, (n,), are at
    `b`."""

    def mix(p: Floats, q: Floats) -> Floats:
        return np.where(jumped, q, p + share * (q - p))

    turn = wrap_angle(b.heading - a.heading)
    return replace(
        b,
        x=mix(a.x, b.x),
        y=mix(a.y, b.y),
        heading=np.where(jumped, b.heading, wrap_angle(a.heading + share * turn)),
    )
