"""One run of a comparison: a scenario with learned road users, or with SUMO's own models alone, and what came of it."""

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import torch

from slrl_sumo.agent.driver import make_driver
from slrl_sumo.formats.trajectories import Trajectories, TrajectoryBuilder
from slrl_sumo.metrics.conflicts import Conflicts, pet_conflicts, ttc_conflicts
from slrl_sumo.metrics.distributions import EDGES, QUANTITIES, histogram, kinematics
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.metrics.signal_crossings import Passages
from slrl_sumo.metrics.trips import Trips
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.contacts import colliding_pairs
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation, Takeover
from slrl_sumo.simulation.record import jumped
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.takeover import parse_shares
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.emissions import POLLUTANTS, emission_rates
from slrl_sumo.sumo.road_users import emission_class
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SUMO, LEARNED = "sumo", "learned"
ARMS = (SUMO, LEARNED)
"""Nobody is learned; those that were taken over are."""

Record = dict[str, Any]
"""What came of a run, ready for JSON; see `play`."""


@dataclass(frozen=True)
class ComparedScenario:
    """What all runs of a comparison have in common; the words are those of `slrl-sumo compare`."""

    scenario: str
    bundle: str
    decisions: int
    takeover: str = "car=1,bicycle=1,pedestrian=1"
    region: str | None = None
    selector: str = "greedy"
    guard: bool = False
    step_length: float | None = None


@dataclass(frozen=True, order=True)
class Run:
    """One run: those of the same seed have the same demand."""

    seed: int
    arm: str


def play(common: ComparedScenario, run: Run) -> Record:
    """Do a run in this process. It depends on its arguments alone.

    `trips`: by road user the fields of `trips.Trip`; `conduct`: of everybody, see `conduct.DrivingStats`; `collisions`:
    pairs whose centres came closer than 0.5 m; `passages`: of signals, by type; `conflicts`: by measure (ttc, pet) a
    list for each encounter with a vehicle, see `conflict_rows`; `emissions`: g of all vehicles, and m that those
    drove which emit; `histograms`: by quantity and type, the shares over `distributions.EDGES`; `learned`:
    how many came and went.
    Raises InputError where scenario or bundle cannot be used, SumoError where SUMO gives up.
    """
    # The models are so small that more threads only wait for each other.
    torch.set_num_threads(1)
    bundle = load_bundle(common.bundle)
    learning = run.arm == LEARNED
    with SumoSession(find_scenario(common.scenario), seed=run.seed, step_length=common.step_length) as session:
        api, network = session.api, session.network
        takeover = None
        if learning:
            region = parse_region(common.region, network)
            takeover = Takeover(parse_shares(common.takeover), region, run.seed)
        driver = make_driver(common.selector, bundle, api, network, run.seed, guard=common.guard)
        loop = CoSimulation(session, driver, takeover=takeover, yielding=learning)
        trips, passages = Trips(api, session.step_length), Passages(api, network)
        conduct, exhaust = DrivingStats(loop.roadmap, network), Exhaust(api)
        builder = TrajectoryBuilder(source=f"{common.scenario}, {run.arm}, seed {run.seed}")
        collided: set[tuple[str, str]] = set()
        seen = []
        comings = dict.fromkeys(("taken_over", "handed_back", "strayed", "lost"), 0)
        learned_steps = 0
        before: WorldState | None = None
        loop.start()
        comings["taken_over"] += len(loop.population.ids)
        for _ in range(common.decisions):
            decision = None
            while decision is None:
                step, decision = loop.step()
                trips.look(step.world, session.time)
                seen += passages.look(step.world, frozenset(step.world.ids))
            world = step.world
            learned_steps += len(decision.surface)
            comings["taken_over"] += len(decision.taken_over)
            comings["handed_back"] += len(decision.handed_back)
            comings["strayed"] += len(decision.strayed)
            comings["lost"] += int(decision.lost.sum())
            conduct.add(world, frozenset(world.ids))
            collided |= {tuple(sorted((world.ids[i], world.ids[j]))) for i, j in colliding_pairs(world).tolist()}
            builder.append(world, jumped(before, world) if before is not None else ())
            exhaust.add(loop.world)
            before = world
    tracks = builder.build()
    counted = kinematics(tracks)
    return {
        "notices": list(session.notices),
        "trips": {road_user: list(astuple(trip)) for road_user, trip in trips.all.items()},
        "conduct": conduct.record(),
        "collisions": len(collided),
        "passages": {
            name: {
                "passages": sum(p.type == kind for p in seen),
                "red": sum(p.type == kind and p.aspect == "red" for p in seen),
            }
            for kind, name in enumerate(TYPE_NAMES)
        },
        "conflicts": {
            "ttc": conflict_rows(ttc_conflicts(tracks).with_vehicles(tracks), tracks),
            "pet": conflict_rows(pet_conflicts(tracks).with_vehicles(tracks), tracks),
        },
        "emissions": exhaust.record(),
        "histograms": {
            quantity: {
                name: histogram(counted[quantity][kind], EDGES[quantity][kind]).round(6).tolist()
                for kind, name in enumerate(TYPE_NAMES)
                if len(counted[quantity][kind])
            }
            for quantity in QUANTITIES
        },
        "learned": comings | {"steps": learned_steps},
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


class Exhaust:
    """What vehicles emit, by SUMO's models and from their speeds every 0.4 s, whoever moves them.

    SUMO's own figures for a moved vehicle are those of its speed, but in steps shorter than 0.4 s it sees the speed
    leap in the first step of a decision, and counts that acceleration. So both arms are computed in the same way.
    """

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._class: dict[str, str] = {}
        self._motion: dict[str, list[Floats]] = {}

    def add(self, world: WorldState) -> None:
        """Everybody, with accelerations, every 0.4 s."""
        rows = np.flatnonzero(world.type != RoadUserType.PEDESTRIAN).tolist()
        for row in rows:
            vehicle = world.ids[row]
            if vehicle not in self._class:
                self._class[vehicle] = emission_class(self._api, vehicle)
            motion = self._motion.setdefault(self._class[vehicle], [])
            motion.append(np.array([world.speed[row], world.acceleration[row]]))

    def record(self) -> Record:
        """g of each of POLLUTANTS, the m that vehicles drove whose class emits, and the classes that SUMO lacks."""
        grams, metres, unknown = dict.fromkeys(POLLUTANTS, 0.0), 0.0, []
        for name, motion in sorted(self._motion.items()):
            speed, acceleration = np.array(motion).T
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
