"""One run of a situation: with SUMO's own models, or with learned road users."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.make_driver import GUARDED
from slrl_sumo.errors import SumoError
from slrl_sumo.metrics.encounters import ALL, EncounterCounts
from slrl_sumo.metrics.traffic.signal_crossings import SignalCrossings
from slrl_sumo.metrics.traffic.trips import Trips
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.preparation import with_learned, without_learned
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.takeover import Takeover
from slrl_sumo.studies.flow.behaviour import behaviour_figures
from slrl_sumo.studies.flow.figures import motion_figures, trip_figures
from slrl_sumo.studies.flow.fundamental_diagram import edge_states
from slrl_sumo.studies.flow.greens import Greens
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.studies.flow.trace import Trace, TraceBuilder, on_lanes
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SUMO = "sumo"
"""The arm in which SUMO's models drive all vehicles."""
Record = dict[str, Any]


@dataclass(frozen=True, order=True)
class Run:
    """One run; runs of the same situation and seed have the same demand."""

    situation: str
    arm: str
    """SUMO, or a selector, with the suffix GUARDED for runs with the guard."""
    seed: int


@dataclass(frozen=True)
class RecordedRun:
    """The data recorded by a run; see `figures`."""

    trace: Trace
    network: Network
    greens: dict[str, list[float]]
    record: Record


def run_case(bundle: str, share: float, run: Run) -> Record:
    """Do a run in this process. The record, ready for JSON, depends on the arguments alone.

    `bundle`: name or folder; `share`: see `learned_shares`. `trips`: departure and arrival (None: has not arrived), s,
    by road user; `figures`: see FIGURES; `under_way_by_minute`: vehicles in the network; `edge_states`: see there.
    Raises InputError where the bundle cannot be used, SumoError where SUMO or its programs fail.
    """
    situation = SITUATIONS[run.situation]
    with TemporaryDirectory(prefix="slrl_flow_") as name:
        try:
            config = situation.build(Path(name))
        except NetgenError as error:
            raise SumoError(f"{run.situation}: {error}") from None
        recorded = simulate(config, load_bundle(bundle, training=False), share, run, situation.seconds)
    on = on_lanes(recorded.trace, recorded.network.lanes)
    figures = recorded.record["figures"] | motion_figures(recorded.trace, on, recorded.greens, situation.desired)
    figures |= behaviour_figures(recorded.trace, on)
    return recorded.record | {"figures": figures, "edge_states": edge_states(recorded.trace, on)}


def learned_shares(bundle: ModelBundle, selector: str, share: float) -> Floats:
    """The share of each type to take over, (3,): `share` for types with models in `bundle`, for `lane` for all
    types."""
    return share * (np.ones(len(RoadUserType)) if selector == "lane" else bundle.types.astype(np.float64))


def simulate(config: Path, bundle: ModelBundle, share: float, run: Run, seconds: float) -> RecordedRun:
    """Run the scenario `config` for `seconds` s of simulated time."""
    learning, scenario = run.arm != SUMO, find_scenario(str(config))
    with one_thread(), SumoSession(scenario, seed=run.seed, step_length=DECISION_INTERVAL) as session:
        api, network = session.api, session.network
        cosimulation = _arm(session, bundle, share, run)
        trips, signals, greens = Trips(api, session.step_length), SignalCrossings(api, network), Greens(api)
        builder, encounters = TraceBuilder(), EncounterCounts(levels=network.levels)
        passed = red = 0
        counted: set[str] = set()
        cosimulation.start()
        while session.time < seconds:
            step, _ = cosimulation.step()
            world = step.world
            trips.update(world, session.time)
            crossings = signals.update(world, world.ids)
            passed, red = passed + len(crossings), red + sum(one.aspect == "red" for one in crossings)
            greens.update(world.time)
            # This also holds after a hand-back: the position is that of the model.
            counted.update(world.ids if not learning else (world.ids[row] for row in np.flatnonzero(world.learned)))
            encounters.add(world, np.array([name in counted for name in world.ids], np.bool_))
            builder.add(world)
    figures = trip_figures(trips.all, seconds)
    figures["collisions"] = round(1e3 * int(encounters.collisions[ALL]) / max(len(counted), 1), 3)
    figures["red_runs"] = round(1e3 * red / passed, 3) if passed else None
    record = {
        "seconds": seconds,
        "trips": {name: [trip.departed, trip.arrived] for name, trip in trips.all.items()},
        "under_way_by_minute": figures.pop("under_way_by_minute"),
        "figures": figures,
    }
    return RecordedRun(builder.build(), network, greens.begins, record)


def _arm(session: SumoSession, bundle: ModelBundle, share: float, run: Run) -> CoSimulation:
    """The simulation of a run, before its first step."""
    if run.arm == SUMO:
        return without_learned(session)
    selector, guard = run.arm.removesuffix(GUARDED), run.arm.endswith(GUARDED)
    everywhere = parse_region(None, session.network)
    takeover = Takeover(learned_shares(bundle, selector, share), everywhere, run.seed)
    return with_learned(session, selector, bundle, run.seed, takeover=takeover, constraints=Constraints(guard=guard))
