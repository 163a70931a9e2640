"""A whole run of learned road users in a scenario, from settings to a stream of decisions."""

import math
from collections.abc import Generator

import numpy as np
import torch

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.selector import PriorSelector
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.events import Event, RunSettings, Started, Views
from slrl_sumo.simulation.spawn import parse_mix, starting_points, type_counts
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.world.types import DECISION_INTERVAL

SELECTORS = ("prior",)


def run(settings: RunSettings, views_at: frozenset[int] = frozenset()) -> Generator[Event, None, None]:
    """Run learned road users in a scenario: yields one Started, then a Decision for every 0.4 s.

    Before the decisions whose numbers (from 0) are in `views_at`, also yields the Views of the first learned road user
    of each type. Raises InputError before SUMO has run where the settings are wrong, SumoError where SUMO gives up.
    """
    _check(settings)
    scenario = find_scenario(settings.scenario)
    bundle = load_bundle(settings.bundle)
    # The models are so small that more threads only wait for each other.
    torch.set_num_threads(1)
    mix = None if settings.mix is None else parse_mix(settings.mix)
    selector = PriorSelector(bundle, settings.seed)
    with SumoSession(
        scenario, seed=settings.seed, step_length=settings.step_length, keep_outputs=settings.sumo_outputs
    ) as session:
        begin = session.time
        decisions, time_notices = _decisions(settings, begin, session.end)
        counts, mix_notices = type_counts(settings.agents, mix, starting_points(session.network), str(scenario.config))
        simulation = CoSimulation(session, bundle, selector, counts, settings.seed)
        yield Started(
            scenario=scenario.name,
            bundle=bundle.name,
            selector=settings.selector,
            begin=begin,
            step_length=session.step_length,
            decisions=decisions,
            notices=(*session.notices, *mix_notices, *time_notices),
            surfaces=simulation.surfaces,
            step=simulation.start(),
        )
        _, watched = np.unique(simulation.learned.type, return_index=True)
        for number in range(decisions):
            if number in views_at:
                observation = simulation.observe(watched, with_image=True)
                assert observation.image is not None
                ids = tuple(simulation.learned.ids[row] for row in watched)
                yield Views(simulation.learned.time, ids, observation.image)
            yield simulation.decide()


def _check(settings: RunSettings) -> None:
    if settings.selector not in SELECTORS:
        raise InputError(f"--selector {settings.selector}: this bundle has none; use {', '.join(SELECTORS)}")
    if settings.agents < 1:
        raise InputError(f"--agents {settings.agents}: at least one learned road user is needed")
    if settings.steps is not None and settings.steps < 1:
        raise InputError(f"--steps {settings.steps}: at least one decision is needed")
    if not 0 <= settings.seed < 2**31:
        raise InputError(f"--seed {settings.seed}: give a whole number from 0 to 2147483647")


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
