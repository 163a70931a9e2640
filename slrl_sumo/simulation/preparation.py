"""Preparation of learned road users in a running simulation, common to `run`, `attach` and the studies."""

from collections.abc import Collection
from dataclasses import dataclass

from slrl_sumo.agent.constraints import Constraints, constraints_of
from slrl_sumo.agent.lane_baseline.lane_driver import LaneDriver
from slrl_sumo.agent.make_driver import SELECTORS, TRAINED, make_driver, unknown_selector, usual_selector
from slrl_sumo.agent.stopwatch import Stopwatch
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import usual_selector_of
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.cosimulation import CoSimulation, Session
from slrl_sumo.simulation.excluded import parse_excluded
from slrl_sumo.simulation.placement.spawn import type_counts
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.settings import LearnedSettings
from slrl_sumo.simulation.shares import parse_mix, parse_shares, served_shares
from slrl_sumo.simulation.takeover import Takeover, fast_lanes


def load_models(settings: LearnedSettings) -> ModelBundle:
    """The bundle of the settings. Raises InputError if the bundle cannot be loaded, and for an unknown selector."""
    if settings.selector is not None and settings.selector not in SELECTORS:
        raise unknown_selector(settings.selector)
    selector = settings.selector or usual_selector_of(settings.bundle)
    return load_bundle(settings.bundle, policy=selector in TRAINED, training=False)


def with_learned(
    session: Session,
    selector: str,
    bundle: ModelBundle,
    seed: int,
    *,
    takeover: Takeover | None = None,
    constraints: Constraints | None = None,
    yielding: bool = True,
    exclude: Collection[str] = (),
    threads: int = 1,
    stopwatch: Stopwatch | None = None,
    traced: bool = False,
) -> CoSimulation:
    """A simulation whose learned road users choose their modes by `selector`, one of SELECTORS, with `seed`.

    `constraints`: None for the default constraints. `threads`: number of threads over which road users are distributed.
    The other arguments are those of CoSimulation. Raises InputError for an unknown selector, if the bundle has no
    policy for it, and for a guard with `lane`.
    """
    driver = make_driver(
        selector,
        bundle,
        session.api,
        session.network,
        seed,
        constraints=constraints,
        stopwatch=stopwatch,
        threads=threads,
    )
    return CoSimulation(
        session,
        driver,
        takeover=takeover,
        yielding=yielding,
        exclude=exclude,
        stopwatch=stopwatch,
        traced=traced,
    )


def without_learned(session: Session) -> CoSimulation:
    """A simulation in which SUMO drives all road users, without yielding; its driver has no road users to move.

    It is the SUMO arm of a comparison, measured in the same way as the learned arm.
    """
    return CoSimulation(session, LaneDriver(session.api, session.network), yielding=False)


@dataclass(frozen=True)
class PreparedRun:
    """Learned road users in a simulation, before the first step."""

    cosimulation: CoSimulation
    selector: str
    notices: tuple[str, ...]
    """Choices by default, one line each."""


def add_learned(
    session: Session, settings: LearnedSettings, bundle: ModelBundle, where: str, *, traced: bool = False
) -> PreparedRun:
    """Add the spawned road users of `settings` to a simulation, and prepare the takeover of other road users.

    `where`: name of the simulation in messages. `traced`: see CoSimulation. Raises InputError, before a road user is
    added, if the settings do not match the network or the bundle.
    """
    notices: list[str] = []
    takeover = None
    selector = settings.selector or usual_selector(bundle)
    models = None if selector == "lane" else bundle
    if settings.takeover is not None:
        region = parse_region(settings.region, session.network)
        shares = parse_shares(settings.takeover) if models is None else served_shares(settings.takeover, models)
        takeover = Takeover(shares, region, settings.seed)
    cosimulation = with_learned(
        session,
        selector,
        bundle,
        settings.seed,
        takeover=takeover,
        constraints=constraints_of(settings.guard, settings.without),
        yielding=settings.background_yields,
        exclude=parse_excluded(settings.exclude),
        threads=settings.threads,
        traced=traced,
    )
    if takeover is not None and (fast := len(fast_lanes(session.network, cosimulation.driver.max_speed))):
        notices.append(
            f"{'1 lane has a limit' if fast == 1 else f'{fast} lanes have limits'} far above the top speed of bundle "
            f"'{bundle.name}' ({cosimulation.driver.max_speed[RoadUserType.CAR]:.1f} m/s): vehicles there stay SUMO's"
        )
    if settings.agents is not None:
        mix = None if settings.mix is None else parse_mix(settings.mix)
        counts, mix_notices = type_counts(settings.agents, mix, cosimulation.points, where, models)
        notices += mix_notices
        cosimulation.spawn(counts, bundle.max_speed, settings.seed)
    return PreparedRun(cosimulation, selector, tuple(notices))
