"""Learned road users in a running simulation: what `run` and `attach` have in common."""

from dataclasses import dataclass

from slrl_sumo.agent.constraints import constraints_of
from slrl_sumo.agent.driver import SELECTORS, TRAINED, Driver, make_driver, unknown_selector, usual_selector
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import usual_selector_of
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation, Simulation
from slrl_sumo.simulation.excluded import parse_excluded
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.settings import LearnedSettings
from slrl_sumo.simulation.shares import parse_mix, parse_shares, served_shares
from slrl_sumo.simulation.spawn import type_counts
from slrl_sumo.simulation.takeover import Takeover, fast_lanes


def load_models(settings: LearnedSettings) -> ModelBundle:
    """The bundle of the settings. Raises InputError where it cannot be loaded, and for an unknown selector."""
    if settings.selector is not None and settings.selector not in SELECTORS:
        raise unknown_selector(settings.selector)
    selector = settings.selector or usual_selector_of(settings.bundle)
    return load_bundle(settings.bundle, policy=selector in TRAINED, training=False)


@dataclass(frozen=True)
class Learned:
    """Learned road users in a simulation, before the first step."""

    loop: CoSimulation
    driver: Driver
    selector: str
    notices: tuple[str, ...]
    """What was decided for the user, one line each."""


def add_learned(
    simulation: Simulation, settings: LearnedSettings, bundle: ModelBundle, where: str, *, traced: bool = False
) -> Learned:
    """Add the road users that `settings` asks for to a simulation, and prepare the takeover of others.

    `where` names the simulation in messages; `traced`: see CoSimulation. Raises InputError before a road user is added
    where the settings do not suit the network or the bundle.
    """
    notices: list[str] = []
    takeover = None
    selector = settings.selector or usual_selector(bundle)
    models = None if selector == "lane" else bundle
    if settings.takeover is not None:
        region = parse_region(settings.region, simulation.network)
        shares = parse_shares(settings.takeover) if models is None else served_shares(settings.takeover, models)
        takeover = Takeover(shares, region, settings.seed)
    driver = make_driver(
        selector,
        bundle,
        simulation.api,
        simulation.network,
        settings.seed,
        constraints=constraints_of(settings.guard, settings.without),
        threads=settings.threads,
    )
    loop = CoSimulation(
        simulation,
        driver,
        takeover=takeover,
        yielding=settings.background_yields,
        exclude=parse_excluded(settings.exclude),
        traced=traced,
    )
    if takeover is not None and (fast := len(fast_lanes(simulation.network, driver.max_speed))):
        notices.append(
            f"{'1 lane has a limit' if fast == 1 else f'{fast} lanes have limits'} far above the top speed of bundle "
            f"'{bundle.name}' ({driver.max_speed[RoadUserType.CAR]:.1f} m/s): vehicles there stay SUMO's"
        )
    if settings.agents is not None:
        mix = None if settings.mix is None else parse_mix(settings.mix)
        counts, mix_notices = type_counts(settings.agents, mix, loop.points, where, models)
        notices += mix_notices
        loop.spawn(counts, bundle.max_speed, settings.seed)
    return Learned(loop, driver, selector, tuple(notices))
