"""Learned road users in a simulation that a user's own script has started."""

from contextlib import suppress
from types import TracebackType
from typing import Self

import torch

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.driver import SELECTORS, make_driver, usual_selector
from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.cosimulation import CoSimulation, Takeover
from slrl_sumo.simulation.events import DEFAULT_BUNDLE
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.spawn import parse_mix, type_counts
from slrl_sumo.simulation.takeover import parse_shares
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.session import AttachedSession


class Attached:
    """Learned road users in a running simulation; a context manager. Made by `attach`.

    Call `step` instead of `simulationStep`. Leaving the context, also by an exception, gives back every road user that
    was taken over and every vehicle that was held, removes those that were added, cancels the subscriptions, and leaves
    the simulation running. Road users that have strayed from every lane are put on the nearest place of their route.
    """

    def __init__(self, simulation: AttachedSession, loop: CoSimulation) -> None:
        self._simulation, self._loop = simulation, loop
        self._started = self._left = False

    @property
    def world(self) -> WorldState:
        """All road users as they were at the last decision, the learned ones first."""
        return self._loop.world

    @property
    def ids(self) -> tuple[str, ...]:
        """Road users that are learned now."""
        return self._loop.population.world.ids

    def step(self) -> WorldState:
        """One SUMO step, in which the learned road users move. Returns all road users after it, learned ones first."""
        if self._left:
            raise InputError("this context has been left; attach again, or call simulationStep")
        if not self._started:
            self._started = True
            return self._loop.start().world
        step, _ = self._loop.step()
        return step.world

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._left = True
        if error is None:
            self._leave()
            return
        # Where SUMO has gone there is nothing to restore, and the error says more.
        with suppress(Exception):
            self._leave()

    def _leave(self) -> None:
        self._loop.release()
        self._simulation.reader.forget()
        self._simulation.mark(attached=False)


def attach(
    api: SumoApi,
    *,
    agents: int | None = None,
    mix: str | None = None,
    takeover: str | None = None,
    region: str | None = None,
    bundle: str = DEFAULT_BUNDLE,
    selector: str | None = None,
    seed: int = 1,
    yielding: bool = True,
    guard: bool = False,
) -> Attached:
    """Put learned road users into a simulation that is running already; call it in a with statement.

        with slrl_sumo.attach(libsumo, takeover="car=0.3") as learned:
            while libsumo.simulation.getMinExpectedNumber() > 0:
                learned.step()  # in place of libsumo.simulationStep()

    `api`: libsumo, traci, or a connection made by traci.connect or traci.getConnection. The other words are those of
    `slrl-sumo run`: `agents` road users are added (shared out by `mix`), the shares `takeover` of the scenario's own
    are taken over inside `region`; with `guard` modes that lead into a conflict are not chosen. `step` returns all road
    users; everything else in the script works as before, its subscriptions included. Three vTypes (learned_car,
    learned_bicycle, learned_pedestrian) and the routes of added vehicles stay in SUMO afterwards.

    Start SUMO with --time-to-teleport -1 and --collision.action warn: its defaults remove road users that stand or
    touch. Raises InputError where something is wrong, before anybody is added or taken over: one of the words, a step
    that does not divide 0.4 s, or a second attachment to the same simulation.
    """
    if agents is None and takeover is None:
        raise InputError("nobody to learn: give agents=N, or takeover='car=0.3'")
    if selector is not None and selector not in SELECTORS:
        raise InputError(f"selector={selector!r}: there is none of that name; use {' or '.join(SELECTORS)}")
    mixed = None if mix is None else parse_mix(mix)
    shares = None if takeover is None else parse_shares(takeover)
    models = load_bundle(bundle)
    # The models are so small that more threads only wait for each other.
    torch.set_num_threads(1)
    simulation = AttachedSession(api)
    rule = None if shares is None else Takeover(shares, parse_region(region, simulation.network), seed)
    rules = Constraints(guard=guard)
    driver = make_driver(selector or usual_selector(models), models, api, simulation.network, seed, constraints=rules)
    loop = CoSimulation(simulation, driver, takeover=rule, yielding=yielding)
    if agents is not None:
        counts, _ = type_counts(agents, mixed, loop.points, "attach")
        loop.spawn(counts, models.max_speed, seed)
    simulation.mark(attached=True)
    return Attached(simulation, loop)
