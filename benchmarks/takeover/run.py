"""One run of the takeover study: learned road users, or the same road users moved by SUMO, and its measurements."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.games import WaitingSignals, scenario_or_game
from benchmarks.takeover.hand_back import HandBack
from benchmarks.takeover.lane_keeping import LaneKeeping
from benchmarks.takeover.paths_picture import choose_paths, draw_paths
from benchmarks.takeover.trip_outcomes import TakenTrip, TakenTrips, count_outcomes
from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.metrics.traffic.signal_crossings import SignalCrossing, SignalCrossings
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.preparation import with_learned, without_learned
from slrl_sumo.simulation.region import Region, parse_region
from slrl_sumo.simulation.takeover import HYSTERESIS, Takeover
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl

TIME_TO_LEAVE = 120.0
"""s; see `count_outcomes`."""


@dataclass(frozen=True)
class Case:
    """A run, named as the options of the study."""

    scenario: str
    selector: str
    """`sumo`: no road user is learned; road users that match the takeover are followed."""
    seed: int
    seconds: float
    tail: float
    region: str | None
    bundle: str
    guard: bool
    step_length: float | None
    """s; None: the scenario's."""


@dataclass(frozen=True)
class TimedRegion(Region):
    """A region that ends at a time: from then on no road user is inside, so that all are handed back."""

    clock: Callable[[], float] = lambda: 0.0
    """s."""
    until: float = 0.0

    def inside(self, x: Floats, y: Floats, margin: float = 0.0) -> np.ndarray:
        """See Region."""
        return super().inside(x, y, margin) & (self.clock() < self.until)


def auto_region(api: Any) -> str:
    """The junction where most lanes meet, with a radius of 60 m."""
    junctions = [j for j in api.junction.getIDList() if not j.startswith(":")]
    return f"junction:{max(junctions, key=lambda j: len(api.junction.getIncomingEdges(j)))},radius=60"


class Followed:
    """In `sumo`: the road users that a takeover would have taken, while they are in the region."""

    def __init__(self, session: SumoSession, region: Region, trips: TakenTrips) -> None:
        self.ids: frozenset[str] = frozenset()
        self._control = TakenOverControl(session.api, session.network)
        self._region, self._trips = region, trips

    def renew(self, world: WorldState, now: float) -> None:
        """Follow road users that enter, and release road users that leave, as `CoSimulation` does."""
        inside = self._region.inside(world.x, world.y)
        near = self._region.inside(world.x, world.y, HYSTERESIS)
        kept = {world.ids[i] for i in np.flatnonzero(near).tolist() if world.ids[i] in self.ids}
        for road_user in self.ids.intersection(world.ids) - kept:
            self._trips.give_back(road_user, now, returned_to_route=False, inside=False)
        rows = [i for i in np.flatnonzero(inside).tolist() if world.ids[i] not in kept]
        pedestrian = world.type[rows] == RoadUserType.PEDESTRIAN
        obstacles = self._control.obstacles([world.ids[i] for i in rows], pedestrian, models=False)
        for row in [row for row, why in zip(rows, obstacles, strict=True) if not why]:
            self._trips.take(world.ids[row], RoadUserType(world.type[row]), now)
            kept.add(world.ids[row])
        self.ids = frozenset(kept)


class CarPaths:
    """Lane keeping and paths of the counted cars; call `add` after every decision interval."""

    def __init__(self, session: SumoSession) -> None:
        self.lanes = LaneKeeping(session.network)
        self.paths: dict[str, list[tuple[float, float, float]]] = {}
        """x, y (m) and speed (m/s) of each car, once per interval."""

    def add(self, world: WorldState, counted: frozenset[str]) -> None:
        """`world`: all road users at the end of the interval."""
        is_car = world.type == RoadUserType.CAR
        cars = world.take(np.array([i for i in np.flatnonzero(is_car).tolist() if world.ids[i] in counted], np.intp))
        for car, *values in zip(cars.ids, cars.x.tolist(), cars.y.tolist(), cars.speed.tolist(), strict=True):
            self.paths.setdefault(car, []).append((values[0], values[1], values[2]))
        self.lanes.add(cars)


def run_case(pictures: Path | None, case: Case) -> dict[str, Any]:
    """Do a run in this process. `pictures`: folder for a picture of ten cars' paths."""
    plain, bundle, scenario = case.selector == "sumo", load_bundle(case.bundle), scenario_or_game(case.scenario)
    with one_thread(), SumoSession(scenario, seed=case.seed, step_length=case.step_length) as session:
        api, end = session.api, session.time + case.seconds
        text = auto_region(api) if case.region == "auto" else case.region
        region = parse_region(text, session.network)
        timed = TimedRegion(**vars(region), clock=lambda: session.time, until=end)
        if plain:
            cosimulation = without_learned(session)
        else:
            rule, constraints = Takeover(np.ones(len(TYPE_NAMES)), timed, case.seed), Constraints(guard=case.guard)
            cosimulation = with_learned(
                session, case.selector, bundle, case.seed, takeover=rule, constraints=constraints
            )
        trips, signals = TakenTrips(api, session.step_length), SignalCrossings(api, session.network)
        waiting, hand_back = WaitingSignals(api, session.time), HandBack(api, session.step_length)
        stats, cars = DrivingStats(cosimulation.road_map), CarPaths(session)
        followed = Followed(session, region, trips)
        crossings: list[SignalCrossing] = []
        costs: list[float] = []
        learned: list[int] = []
        handed_back = 0
        own: frozenset[str] = frozenset()

        def take() -> frozenset[str]:
            """Record the road users that are learned, or followed, from now on."""
            if plain:
                followed.renew(cosimulation.world, session.time)
                return followed.ids
            world = cosimulation.population.world
            for row in [i for i, road_user in enumerate(world.ids) if road_user not in own]:
                trips.take(world.ids[row], RoadUserType(world.type[row]), session.time)
            return frozenset(world.ids)

        cosimulation.start()
        own = take()
        while session.time < end or (session.time < end + case.tail and trips.under_way):
            counting = session.time < end
            waiting.update(session.time)
            moved = frozenset(cosimulation.population.ids)
            cost, decision = 0.0, None
            while decision is None:
                clock = time.perf_counter()
                step, decision = cosimulation.step()
                cost += time.perf_counter() - clock
                trips.update(step.world, session.time)
                hand_back.update(step.world, moved, session.time)
                if counting:
                    crossings += signals.update(step.world, own)
            handed_back += len(decision.handed_back)
            if not counting:
                continue
            costs.append(cost)
            learned.append(len(own))
            lost = {step.world.ids[row] for row in np.flatnonzero(decision.lost)}
            present = own.difference(decision.arrived, lost)
            stats.add(step.world, present)
            cars.add(step.world, present)
            if session.time >= end:
                trips.close()
            _give_back(trips, decision, cosimulation.world, timed, session.time)
            own = take() if session.time < end else own
        not_returned = len(cosimulation.population.world)
        if pictures is not None:
            name = f"{Path(case.scenario).stem}-{case.selector}{'-guard' * case.guard}.png"
            title = f"{case.scenario}, {case.selector}, seed {case.seed}"
            draw_paths(session.network, choose_paths(cars.paths, case.seed), title, pictures / name)
    driving = stats.record()
    driving["car"] |= cars.lanes.record()
    steps, wall = sum(learned), sum(costs)
    return {
        "region_used": text,
        "handed_back": handed_back,
        "not_handed_back": not_returned,
        "trip_outcomes": _outcomes(trips, end),
        "signal_crossings": {name: _aspects(crossings, RoadUserType(kind)) for kind, name in enumerate(TYPE_NAMES)},
        "red_light_violations": [[round(c.time, 2), c.road_user, c.lane] for c in crossings if c.aspect == "red"],
        "driving_stats": driving,
        "hand_back": hand_back.record(),
        "throughput": {
            "decisions": len(costs),
            "wall_s": round(wall, 3),
            "agent_steps_per_s": round(steps / wall, 1) if wall else None,
            "ms_per_decision": round(1e3 * float(np.median(costs)), 3) if costs else None,
            "mean_learned": round(steps / max(len(learned), 1), 2),
        },
        "users": {road_user: _user(trip) for road_user, trip in trips.all.items()},
    }


def _give_back(trips: TakenTrips, decision: Decision, world: WorldState, region: Region, now: float) -> None:
    rows = np.array([i for i, road_user in enumerate(world.ids) if road_user in set(decision.handed_back)], np.intp)
    inside = region.inside(world.x[rows], world.y[rows], HYSTERESIS).tolist()
    for row, near in zip(rows.tolist(), inside, strict=True):
        road_user = world.ids[row]
        trips.give_back(road_user, now, returned_to_route=road_user in decision.returned_to_route, inside=near)


def _outcomes(trips: TakenTrips, end: float) -> dict[str, Any]:
    under_way = Counter(trips.all[road_user].type for road_user in trips.under_way)
    counts = {}
    for kind, name in enumerate(TYPE_NAMES):
        of_type = [trip for trip in trips.all.values() if trip.type == kind]
        counts[name] = asdict(count_outcomes(of_type, end, TIME_TO_LEAVE, under_way[RoadUserType(kind)]))
    return counts | {"all": asdict(count_outcomes(trips.all.values(), end, TIME_TO_LEAVE, under_way.total()))}


def _aspects(crossings: list[SignalCrossing], kind: RoadUserType) -> dict[str, int]:
    aspects = Counter(crossing.aspect for crossing in crossings if crossing.type == kind)
    return {"all": aspects.total(), "red": aspects["red"], "yellow": aspects["yellow"]}


def _user(trip: TakenTrip) -> dict[str, Any]:
    return {
        "type": TYPE_NAMES[trip.type],
        "fate": trip.fate,
        "after": trip.after,
        "left": trip.fate in ("left", "arrived"),
        "inside_s": round(trip.inside_s, 2),
    }
