"""A whole run of learned road users in a scenario, from settings to a stream of decisions."""

import math
import shlex
from collections.abc import Generator

import numpy as np
import torch

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.driver import SELECTORS, Driver, ModelDriver, make_driver, usual_selector
from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.compiled import what_to_expect
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation, Takeover, fast_lanes
from slrl_sumo.simulation.events import Event, RunSettings, Started, Views
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.spawn import parse_mix, type_counts
from slrl_sumo.simulation.takeover import parse_shares
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession

MOST_AGENTS = 1_000_000


def run(settings: RunSettings, views_at: frozenset[int] = frozenset()) -> Generator[Event, None, None]:
    """Run learned road users in a scenario: yields one Started, then a Decision for every 0.4 s.

    Before the Decisions whose numbers (from 0) are in `views_at`, also yields the Views that the first learned road
    user of each type had in them.
    Raises InputError before SUMO has run where the settings are wrong, SumoError where SUMO gives up.
    """
    _check(settings)
    compiling = what_to_expect()
    scenario = with_options(find_scenario(settings.scenario), _words(settings.sumo_options))
    bundle = load_bundle(settings.bundle)
    # The models are so small that more threads only wait for each other.
    torch.set_num_threads(1)
    mix = None if settings.mix is None else parse_mix(settings.mix)
    shares = None if settings.takeover is None else parse_shares(settings.takeover)
    with SumoSession(
        scenario, seed=settings.seed, step_length=settings.step_length, keep_outputs=settings.sumo_outputs
    ) as session:
        begin = session.time
        decisions, notices = _decisions(settings, begin, session.end)
        takeover = None
        if shares is not None:
            takeover = Takeover(shares, parse_region(settings.region, session.network), settings.seed)
        selector = settings.selector or usual_selector(bundle)
        api, network = session.api, session.network
        constraints = Constraints(guard=settings.guard)
        driver = make_driver(selector, bundle, api, network, settings.seed, constraints=constraints)
        simulation = CoSimulation(session, driver, takeover=takeover, yielding=settings.yielding)
        if takeover is not None and (fast := len(fast_lanes(session.network, driver))):
            most = driver.max_speed[RoadUserType.CAR]
            lanes = "1 lane is" if fast == 1 else f"{fast} lanes are"
            notices.append(
                f"{lanes} for more than the {most:.1f} m/s that bundle '{bundle.name}' knows: there all stay SUMO's"
            )
        if settings.agents is not None:
            where = str(scenario.config)
            counts, mix_notices = type_counts(settings.agents, mix, simulation.points, where)
            notices += mix_notices
            simulation.spawn(counts, bundle.max_speed, settings.seed)
        yield Started(
            scenario=scenario.name,
            bundle=bundle.name,
            selector=selector,
            begin=begin,
            step_length=session.step_length,
            decisions=decisions,
            notices=(*session.notices, *notices),
            surfaces=simulation.surfaces,
            step=simulation.start(),
            mode_centres=bundle.mode_centres if selector != "lane" else None,
            compiling=compiling,
        )
        for number in range(decisions):
            before, learned = simulation.world, simulation.population.world
            decision = simulation.decide()
            if number in views_at and len(learned):
                yield _views(before, learned, simulation, driver)
            yield decision


def _views(world: WorldState, learned: WorldState, simulation: CoSimulation, driver: Driver) -> Views:
    """What the first learned road user of each type has just seen, in the preset of the selector."""
    _, watched = np.unique(learned.type, return_index=True)
    image = driver.images(watched) if isinstance(driver, ModelDriver) else None
    if image is None:
        image = observe(Scene(world, watched, simulation.road_map)).image
    assert image is not None
    return Views(learned.time, tuple(learned.ids[row] for row in watched), image)


def _check(settings: RunSettings) -> None:
    if settings.selector is not None and settings.selector not in SELECTORS:
        raise InputError(f"--selector {settings.selector}: there is none of that name; use {' or '.join(SELECTORS)}")
    if settings.agents is None and settings.takeover is None:
        raise InputError("nobody to learn: give --agents N, or --takeover car=0.3 to take over the scenario's own")
    if settings.agents is None and settings.mix is not None:
        raise InputError(f"--mix {settings.mix}: it shares out --agents, which is not given; add --agents N")
    if settings.takeover is None and settings.region is not None:
        raise InputError(
            f"--region {settings.region}: it limits --takeover, which is not given; add --takeover car=0.3"
        )
    if settings.agents is not None and settings.agents < 1:
        raise InputError(f"--agents {settings.agents}: at least one learned road user is needed")
    if settings.agents is not None and settings.agents > MOST_AGENTS:
        raise InputError(f"--agents {settings.agents}: no network holds so many; ask for fewer")
    if settings.until is not None and not math.isfinite(settings.until):
        raise InputError(f"--until {settings.until}: give a simulation time in seconds")
    if settings.steps is not None and settings.steps < 1:
        raise InputError(f"--steps {settings.steps}: at least one decision is needed")
    if not 0 <= settings.seed < 2**31:
        raise InputError(f"--seed {settings.seed}: give a whole number from 0 to 2147483647")


def _words(options: str) -> list[str]:
    try:
        return shlex.split(options)
    except ValueError as error:
        raise InputError(f"--sumo-options {options}: {str(error).lower()}") from None


def _decisions(settings: RunSettings, begin: float, end: float | None) -> tuple[int, list[str]]:
    if settings.steps is not None:
        return settings.steps, []
    if settings.until is not None:
        if settings.until <= begin:
            raise InputError(f"--until {settings.until:g}: the scenario begins at {begin:g} s; give a later time")
        return math.ceil((settings.until - begin) / DECISION_INTERVAL - 1e-9), []
    if end is not None and end > begin:
        return math.ceil((end - begin) / DECISION_INTERVAL - 1e-9), []
    return 150, ["the scenario has no end: running 150 decisions (60 s); --steps or --until sets another length"]
