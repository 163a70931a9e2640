"""A whole run of learned road users in a scenario, from settings to a stream of decisions."""

import math
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace

import numpy as np

from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.errors import InputError
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.compiled import what_to_expect
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.events import MOST_DECISIONS, Event, Started, Views
from slrl_sumo.simulation.preparation import add_learned, load_models
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.simulation.shares import parse_shares
from slrl_sumo.sumo.network.links import SignalChanges
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.session import SumoSession

OUTPUTS_OF_WALKS = ("tripinfo-output", "personinfo-output", "vehroute-output", "personroute-output")
"""SUMO's outputs with an element for each walk of a person."""
SHORT_RUN = 150
"""Number of decisions of a run without a limit from its settings, the scenario's end or its traffic."""


def run(
    settings: RunSettings, views_at: frozenset[int] = frozenset(), *, traced: bool = False
) -> Generator[Event, None, None]:
    """Run learned road users in a scenario: yields one Started, then a Decision for each 0.4 s.

    Before each Decision whose number (from 0) is in `views_at`, also yields the Views of the first learned road user of
    each type. `traced`: whether the steps go into a trace, see CoSimulation. Between two events, PyTorch's thread count
    is the caller's.
    Raises InputError, before SUMO runs, if the settings are wrong; SumoError if SUMO fails.
    """
    with closing(_run(settings, views_at, traced)) as events:
        while True:
            with one_thread():
                event = next(events, None)
            if event is None:
                return
            yield event


def _run(settings: RunSettings, views_at: frozenset[int], traced: bool) -> Generator[Event, None, None]:
    compiling = what_to_expect()
    scenario = settings.found()
    bundle = load_models(settings)
    with SumoSession(
        scenario,
        seed=settings.seed,
        step_length=settings.step_length,
        keep_outputs=settings.sumo_outputs,
        gui=settings.gui,
    ) as session:
        begin = session.time
        decisions = _decisions(settings, begin, session.end)
        prepared = add_learned(session, settings, bundle, str(scenario.config), traced=traced)
        cosimulation = prepared.cosimulation
        notices = _about_walks(settings, scenario)
        if decisions is None and session.expected <= len(cosimulation.population.spawned_ids):
            decisions = SHORT_RUN
            notices.append(
                f"the scenario has neither an end nor traffic: running {SHORT_RUN} decisions "
                f"({SHORT_RUN * DECISION_INTERVAL:g} s); --steps or --until sets another length"
            )
        elif decisions is None:
            notices.append(
                "the scenario has no end: the run goes on until its road users have left, at most "
                f"{MOST_DECISIONS * DECISION_INTERVAL / 3600:g} h; --steps or --until sets a length"
            )
        start, signals = cosimulation.start(), SignalChanges(session.api)
        yield Started(
            scenario=scenario.name,
            bundle=bundle.name,
            selector=prepared.selector,
            begin=begin,
            step_length=session.step_length,
            decisions=decisions,
            notices=(*session.notices, *notices, *prepared.notices),
            surfaces=cosimulation.surfaces,
            step=start,
            signals=signals(),
            mode_centres=bundle.mode_centres if prepared.selector != "lane" else None,
            modes_by=str(bundle.training.get("modes_by", "")),
            compiling=compiling,
        )
        for number in range(MOST_DECISIONS if decisions is None else decisions):
            if decisions is None and session.expected <= len(cosimulation.population.spawned_ids):
                return
            before, users = cosimulation.world, cosimulation.population.world
            decision = cosimulation.decide()
            if number in views_at and len(users):
                yield _views(before, users, cosimulation)
            yield replace(decision, signals=signals())


def _about_walks(settings: RunSettings, scenario: Scenario) -> list[str]:
    """Notice on SUMO's outputs for persons that are taken over.

    Their walk is replaced edge by edge: 19 persons had 97 walks, some with a time loss below 0.
    """
    written = [name for name in OUTPUTS_OF_WALKS if name in scenario.options]
    takes_persons = settings.takeover is not None and parse_shares(settings.takeover)[RoadUserType.PEDESTRIAN] > 0.0
    if not (settings.sumo_outputs and takes_persons and written):
        return []
    return [
        f"SUMO's own {', '.join(written)} cannot be used for persons that are taken over: they have a walk for each "
        "edge, with wrong lengths and times; --fcd has all their positions"
    ]


def _views(world: WorldState, learned: WorldState, cosimulation: CoSimulation) -> Views:
    """Ego images of the first learned road user of each type at the last decision, in the preset of the selector."""
    _, watched = np.unique(learned.type, return_index=True)
    driver = cosimulation.driver
    image = driver.images(watched) if isinstance(driver, ModelDriver) else None
    if image is None:
        image = observe(Scene(world, watched, cosimulation.road_map)).image
    assert image is not None
    return Views(learned.time, tuple(learned.ids[row] for row in watched), image)


def _decisions(settings: RunSettings, begin: float, end: float | None) -> int | None:
    """Number of decisions from the settings or the scenario; None if neither sets a limit."""
    if settings.steps is not None:
        return settings.steps
    if settings.until is not None:
        if settings.until <= begin:
            raise InputError(
                f"the scenario begins at {begin:g} s; give a later time", argument="until", value=settings.until
            )
        return math.ceil((settings.until - begin) / DECISION_INTERVAL - 1e-9)
    if end is not None and end > begin:
        return math.ceil((end - begin) / DECISION_INTERVAL - 1e-9)
    return None
