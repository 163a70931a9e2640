"""A run of a comparison: a scenario with learned road users or with SUMO's models, and its measurements."""

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_builder import TrajectoryBuilder
from slrl_sumo.metrics.conflicts import Conflicts, pet_conflicts, ttc_conflicts
from slrl_sumo.metrics.distributions import EDGES, QUANTITIES, histogram, kinematics
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.metrics.traffic.signal_crossings import SignalCrossings
from slrl_sumo.metrics.traffic.trips import Trips
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.jumps import jumped
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.excluded import parse_excluded
from slrl_sumo.simulation.preparation import with_learned, without_learned
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.shares import parse_shares
from slrl_sumo.simulation.takeover import Takeover
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.emissions import POLLUTANTS, emission_rates
from slrl_sumo.sumo.road_users import emission_class
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SUMO, LEARNED = "sumo", "learned"
ARMS = (SUMO, LEARNED)
"""SUMO: no road user is learned. LEARNED: taken-over road users are learned."""

Record = dict[str, Any]
"""Measurements of a run, ready for JSON; see `run_comparison`."""


@dataclass(frozen=True)
class ComparedScenario:
    """Settings that all runs of a comparison share, named as in `slrl-sumo compare`."""

    scenario: str
    bundle: str
    decisions: int
    takeover: str = "car=1,bicycle=1,pedestrian=1"
    region: str | None = None
    exclude: str = ""
    selector: str = "greedy"
    guard: bool = False
    step_length: float | None = None


@dataclass(frozen=True, order=True)
class Run:
    """One run; runs of the same seed have the same demand."""

    seed: int
    arm: str


def run_comparison(common: ComparedScenario, run: Run) -> Record:
    """Do a run in this process. The record depends on the arguments alone.

    `trips`: by road user the fields of `trips.Trip`; `driving_stats`: of all road users, see `DrivingStats.record`;
    `signal_crossings`: by type; `conflicts`: by measure (ttc, pet) a list for each encounter with a vehicle, see
    `conflict_rows`; `emissions`: g of all vehicles, and m driven by the vehicles that emit; `histograms`: by quantity
    and type, the shares over `distributions.EDGES`; `learned`: counts of takeovers and their ends.
    Raises InputError where scenario or bundle cannot be used, SumoError where SUMO fails.
    """
    bundle = load_bundle(common.bundle, training=False)
    scenario = find_scenario(common.scenario)
    with one_thread(), SumoSession(scenario, seed=run.seed, step_length=common.step_length) as session:
        cosimulation = _arm(session, bundle, common, run)
        trips, signals = Trips(session.api, session.step_length), SignalCrossings(session.api, session.network)
        stats, emissions = DrivingStats(cosimulation.road_map), Emissions(session.api)
        builder = TrajectoryBuilder(source=f"{common.scenario}, {run.arm}, seed {run.seed}")
        crossings = []
        learned = dict.fromkeys(("taken_over", "handed_back", "returned_to_route", "lost", "steps"), 0)
        before: WorldState | None = None
        cosimulation.start()
        learned["taken_over"] += len(cosimulation.population.ids)
        for _ in range(common.decisions):
            decision = None
            while decision is None:
                step, decision = cosimulation.step()
                trips.update(step.world, session.time)
                crossings += signals.update(step.world, step.world.ids)
            world = step.world
            learned["steps"] += len(decision.surface)
            learned["taken_over"] += len(decision.taken_over)
            learned["handed_back"] += len(decision.handed_back)
            learned["returned_to_route"] += len(decision.returned_to_route)
            learned["lost"] += int(decision.lost.sum())
            stats.add(world, frozenset(world.ids))
            builder.append(world, jumped(before, world) if before is not None else ())
            emissions.add(cosimulation.world)
            before = world
    return {
        "notices": list(session.notices),
        "trips": {road_user: list(astuple(trip)) for road_user, trip in trips.all.items()},
        "driving_stats": stats.record(),
        "signal_crossings": {
            name: {
                "all": sum(c.type == kind for c in crossings),
                "red": sum(c.type == kind and c.aspect == "red" for c in crossings),
            }
            for kind, name in enumerate(TYPE_NAMES)
        },
        **motion_record(builder.build(), session.network.levels),
        "emissions": emissions.record(),
        "learned": learned,
    }


def _arm(session: SumoSession, bundle: ModelBundle, common: ComparedScenario, run: Run) -> CoSimulation:
    """The simulation of a run, before its first step."""
    if run.arm == SUMO:
        return without_learned(session)
    region = parse_region(common.region, session.network)
    return with_learned(
        session,
        common.selector,
        bundle,
        run.seed,
        takeover=Takeover(parse_shares(common.takeover), region, run.seed),
        exclude=parse_excluded(common.exclude),
        constraints=Constraints(guard=common.guard),
    )


def motion_record(tracks: Trajectories, levels: Levels = FLAT) -> Record:
    """`conflicts` and `histograms` of a run, from positions only; `levels`: of its network."""
    values = kinematics(tracks)
    return {
        "conflicts": {
            "ttc": conflict_rows(ttc_conflicts(tracks, levels=levels).with_vehicles(tracks), tracks),
            "pet": conflict_rows(pet_conflicts(tracks, levels=levels).with_vehicles(tracks), tracks),
        },
        "histograms": {
            quantity: {
                name: histogram(values[quantity][kind], EDGES[quantity][kind]).round(6).tolist()
                for kind, name in enumerate(TYPE_NAMES)
                if len(values[quantity][kind])
            }
            for quantity in QUANTITIES
        },
    }


def conflict_rows(found: Conflicts, tracks: Trajectories) -> list[list[Any]]:
    """Encounters as rows: both ids and types, time (s), x, y (m), value (s), closing speed (m/s), angle (rad)."""
    return [
        [
            *(tracks.ids[k] for k in (found.a[n], found.b[n])),
            *(TYPE_NAMES[tracks.type[k]] for k in (found.a[n], found.b[n])),
            *(round(float(getattr(found, name)[n]), 3) for name in ("time", "x", "y", "value", "closing", "angle")),
        ]
        for n in range(len(found))
    ]


class Emissions:
    """Emissions of vehicles by SUMO's models from their speeds every 0.4 s, learned and background alike.

    SUMO's own figures for a moved vehicle follow its speed, but with steps shorter than 0.4 s the speed jumps in the
    first step of a decision, and SUMO counts that acceleration. Both arms are therefore computed here in the same way.
    """

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._class: dict[str, str] = {}
        self._motion: dict[str, list[Floats]] = {}

    def add(self, world: WorldState) -> None:
        """Count one decision interval; `world`: all road users, with accelerations."""
        rows = np.flatnonzero(world.type != RoadUserType.PEDESTRIAN).tolist()
        for row in rows:
            vehicle = world.ids[row]
            if vehicle not in self._class:
                self._class[vehicle] = emission_class(self._api, vehicle)
            motion = self._motion.setdefault(self._class[vehicle], [])
            motion.append(np.array([world.speed[row], world.acceleration[row]]))

    def record(self) -> Record:
        """See `emitted`."""
        return emitted({name: np.array(motion) for name, motion in self._motion.items()})


def emitted(motion: Mapping[str, Floats]) -> Record:
    """g of each of POLLUTANTS, m driven by vehicles whose class emits, and the classes without data in SUMO.

    `motion`: by emission class, rows of speed (m/s) and acceleration (m/s²) over decision intervals, (n, 2)."""
    grams, metres, unknown = dict.fromkeys(POLLUTANTS, 0.0), 0.0, []
    for name, (speed, acceleration) in sorted((name, rows.T) for name, rows in motion.items()):
        rates = emission_rates(name, speed=speed, acceleration=acceleration)
        if rates is None:
            unknown.append(name)
            continue
        for pollutant, rate in rates.items():
            grams[pollutant] += float(rate.sum()) * DECISION_INTERVAL / 1000.0
        if rates["co2"].any():
            metres += float(speed.sum()) * DECISION_INTERVAL
    return {
        **{name: round(value, 3) for name, value in grams.items()},
        "metres": round(metres, 1),
        "unknown": unknown,
    }
