"""An episode of an evaluation, with learned, SUMO's or recorded road users, from the start to its outcome."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.make_driver import GUARDED
from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.outcomes import Outcomes, TypeOutcome
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, DEFAULT_LENGTH, DEFAULT_WIDTH
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.events import LEFT_SURFACE
from slrl_sumo.simulation.placement.insertion import boxes_of
from slrl_sumo.simulation.placement.spawn import draw_starts, starting_speeds, type_counts
from slrl_sumo.simulation.placement.wraparound import ENTRY_ROOM
from slrl_sumo.simulation.preparation import with_learned
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SUMO = "sumo"
"""Name of SUMO's models as selector: no road user is learned, and the scenario's road users are counted."""

WARM_UP = 60.0
"""Duration (s) of plain SUMO before an episode, so that the scenario's traffic is present at the first decision."""


@dataclass(frozen=True)
class EpisodeSettings:
    """Settings common to all episodes of an evaluation."""

    scenario: str
    bundle: str
    steps: int
    """Decisions."""


@dataclass(frozen=True, order=True)
class Episode:
    """One episode. Episodes of the same seed and number have the same background traffic."""

    selector: str
    agents: int
    """Number of learned road users; 0 with selector SUMO."""
    seed: int
    number: int

    @property
    def draw(self) -> int:
        """The seed of SUMO, of the places and of the choices."""
        return int(np.random.SeedSequence((self.seed, self.number)).generate_state(1)[0] >> 1)


def run_episode(settings: EpisodeSettings, episode: Episode) -> tuple[TypeOutcome, ...]:
    """Run an episode in this process. It depends on its arguments alone.

    Raises InputError where scenario or bundle cannot be used, SumoError where SUMO gives up.
    """
    bundle = load_bundle(settings.bundle, training=False)
    with one_thread(), SumoSession(find_scenario(settings.scenario), seed=episode.draw) as session:
        for _ in range(round(WARM_UP / DECISION_INTERVAL) * session.substeps):
            session.step()
        if episode.selector == SUMO:
            return _watch(session, settings.steps)
        return _drive(session, bundle, episode, settings.steps)


def recorded(recording: Trajectories, steps: int) -> Iterator[tuple[TypeOutcome, ...]]:
    """The road users of a recording, in successive spans of `steps` intervals; an incomplete last span is left out.

    Parked ones are not counted. Raises InputError where the recording holds no whole span.
    """
    if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
        raise InputError(f"--recording: its interval is {recording.dt} s, evaluation needs {DECISION_INTERVAL} s")
    frames = recording.frames
    if len(frames) <= steps:
        raise InputError(
            f"--recording: it has {max(len(frames) - 1, 0)} intervals, an episode {steps}; give --steps or a longer one"
        )
    parked = frozenset(name for name, still in zip(recording.ids, recording.parked.tolist(), strict=True) if still)
    # Joined recordings have pauses without road users. A span has the frames at both of its ends.
    after = recording.frame - frames.start
    for span in np.union1d(after // steps, (after - 1) // steps).tolist():
        first = frames.start + span * steps
        if span < 0 or first + steps >= frames.stop:
            continue
        world = recording.world(first)
        outcomes = Outcomes(world, _not_in(world, parked))
        for frame in range(first + 1, first + steps + 1):
            world = recording.world(frame)
            outcomes.add(world, _not_in(world, parked), None, None)
        result = outcomes.per_type()
        if result:
            yield result


def _watch(session: SumoSession, steps: int) -> tuple[TypeOutcome, ...]:
    """Count SUMO's road users while they are present."""
    roadmap = RoadMap(session.network.surfaces())
    world = background_world(session.reader.read(), session.time, frozenset())
    outcomes = Outcomes(world, np.ones(len(world), np.bool_))
    for _ in range(steps):
        for _ in range(session.substeps):
            session.step()
        world = background_world(session.reader.read(), session.time, frozenset())
        off_surface = ~OWN_SURFACE[world.type, roadmap.surface_at(world.x, world.y)]
        left_surface = roadmap.beyond_own_surface(world.type, world.x, world.y, LEFT_SURFACE)
        outcomes.add(world, np.ones(len(world), np.bool_), off_surface, left_surface)
    return outcomes.per_type()


def _drive(session: SumoSession, bundle: ModelBundle, episode: Episode, steps: int) -> tuple[TypeOutcome, ...]:
    """Count learned road users among SUMO's."""
    name, guard = episode.selector.removesuffix(GUARDED), episode.selector.endswith(GUARDED)
    cosimulation = with_learned(session, name, bundle, episode.draw, constraints=Constraints(guard=guard))
    _spawn(cosimulation, session, bundle, episode)
    start = cosimulation.start().world
    outcomes = Outcomes(start, start.learned)
    for _ in range(steps):
        decision = cosimulation.decide()
        world, n = decision.steps[-1].world, len(decision.surface)
        off_surface, left_surface = np.zeros((2, len(world)), np.bool_)
        off_surface[:n] = ~OWN_SURFACE[world.type[:n], decision.surface]
        left_surface[:n] = decision.left_surface
        outcomes.add(world, np.arange(len(world)) < n, off_surface, left_surface)
    return outcomes.per_type()


def _not_in(world: WorldState, ids: frozenset[str]) -> NDArray[np.bool_]:
    return np.array([name not in ids for name in world.ids], np.bool_)


def _spawn(cosimulation: CoSimulation, session: SumoSession, bundle: ModelBundle, episode: Episode) -> None:
    """Add the learned road users as a run does, but clear of the present traffic."""
    points = cosimulation.points
    counts, _ = type_counts(episode.agents, None, points, str(session.scenario.config), bundle)
    background = background_world(session.reader.read(), session.time, frozenset())
    rng = np.random.default_rng(episode.draw)
    try:
        starts = draw_starts(counts, _clear(points, background), rng)
    except InputError:  # too full for that; contacts at the start do not count as collisions
        starts = draw_starts(counts, points, rng)
    speed = starting_speeds(starts, bundle.max_speed, rng, boxes_of(background))
    cosimulation.population.spawn(*starts[:4], speed, session.time)


def _clear(points: tuple[LanePoints, ...], others: WorldState) -> tuple[LanePoints, ...]:
    """Places from which each type has room to stop before each of `others`, as for a wraparound."""
    radii = 0.5 * np.hypot(others.length, others.width)
    clear = []
    for kind, places in enumerate(points):
        radius = 0.5 * np.hypot(DEFAULT_LENGTH[kind], DEFAULT_WIDTH[kind])
        gap = np.hypot(places.x[:, None] - others.x, places.y[:, None] - others.y) - radii - radius
        clear.append(places.take(np.flatnonzero(gap.min(axis=1, initial=np.inf) >= ENTRY_ROOM[kind])))
    return tuple(clear)
