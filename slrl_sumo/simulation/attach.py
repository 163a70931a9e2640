"""Learned road users in a simulation that another script has started."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Self

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.excluded import Excluded
from slrl_sumo.simulation.preparation import add_learned, load_models
from slrl_sumo.simulation.region import RegionSpec
from slrl_sumo.simulation.settings import LearnedSettings, constraint_names
from slrl_sumo.simulation.shares import Shares
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.session import AttachedSession


class Attached:
    """Learned road users in a running simulation; a context manager. Made by `attach`.

    Call `step` instead of `simulationStep`. Leaving the context, also by an exception, hands all taken-over road users
    and all held vehicles back to SUMO, removes the added road users, cancels the subscriptions, and leaves the
    simulation running. Road users that are off every lane are put on the nearest place of their route. If the script
    has closed the simulation or loaded another one, leaving has no effect.
    """

    def __init__(self, session: AttachedSession, cosimulation: CoSimulation) -> None:
        self._session, self._cosimulation = session, cosimulation
        self._started = self._left = False
        self._refused: dict[str, str] = {}
        self._one_at_a_time = Lock()

    @property
    def world(self) -> WorldState:
        """All road users at the last decision, the learned road users first."""
        return self._cosimulation.world

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the road users that are presently learned."""
        return self._cosimulation.population.world.ids

    @property
    def refused(self) -> dict[str, str]:
        """Road users that could not be moved and went back to SUMO, by id, with the reason.

        The script has removed them, or SUMO has refused a call.
        """
        return dict(self._refused)

    def step(self) -> WorldState:
        """Run a SUMO step, in which the learned road users move; return all road users after it, learned ones first.

        Road users that the script has removed or stopped are no longer learned. After calls of `simulationStep` between
        two steps, the learned road users continue from their positions in SUMO. Several threads may call this method;
        the calls wait for each other. Raises InputError if the context has been left, or another simulation or state
        was loaded; SumoError if the simulation was closed or SUMO fails.
        """
        with self._one_at_a_time, self._session.errors(), one_thread():
            if self._left:
                raise InputError("this context has been left; attach again, or call simulationStep")
            self._session.check()
            if not self._started:
                self._started = True
                return self._cosimulation.start().world
            step, decision = self._cosimulation.step()
            if decision is not None:
                self._refused.update(decision.refused)
            return step.world

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._one_at_a_time:
            self._left = True
            if error is None:
                self._leave()
                return
            # The error of the script tells more than a subsequent error.
            with suppress(Exception):
                self._leave()

    def _leave(self) -> None:
        with self._session.errors():
            if not self._session.attached:
                return
            try:
                self._cosimulation.release()
            finally:
                self._session.reader.forget()
                self._session.mark(attached=False)


def attach(
    api: SumoApi,
    *,
    agents: int | None = None,
    mix: Shares | None = None,
    takeover: Shares | None = None,
    region: str | RegionSpec | None = None,
    exclude: Excluded = (),
    bundle: str | Path = DEFAULT_BUNDLE,
    selector: str | None = None,
    guard: bool = False,
    without: Sequence[str] = (),
    seed: int = 1,
    background_yields: bool = True,
    threads: int = 1,
) -> Attached:
    """Put learned road users into a simulation that is already running; call it in a with statement.

        with slrl_sumo.attach(libsumo, takeover={"car": 0.3}) as learned:
            while libsumo.simulation.getMinExpectedNumber() > 0:
                learned.step()  # in place of libsumo.simulationStep()

    `api`: libsumo, traci, or a connection made by traci.connect or traci.getConnection. `agents`: number of road users
    to add, with the types in the shares `mix`. `takeover`: shares of the scenario's road users that are taken over
    inside `region`. `exclude`: road users that stay unchanged, such as an ego vehicle that the script drives. The other
    arguments are those of `slrl_sumo.run`. `step` returns all road users; everything else in the script works as
    before, including its subscriptions and PyTorch's thread count. Three vTypes (learned_car, learned_bicycle,
    learned_pedestrian) and the routes of added vehicles stay in SUMO afterwards.

    Start SUMO with --time-to-teleport -1 and --collision.action warn: its defaults remove road users that stand or
    touch. Raises InputError, before a road user is added or taken over, if an argument is wrong, if SUMO's step does
    not divide 0.4 s, and for a second attachment to the same simulation. docs/how-to/attach-to-a-script.md lists what a
    script may do meanwhile.
    """
    settings = LearnedSettings(
        agents=agents,
        mix=mix,
        takeover=takeover,
        region=region,
        exclude=exclude,
        bundle=bundle,
        selector=selector,
        guard=guard,
        without=constraint_names(without),
        seed=seed,
        background_yields=background_yields,
        threads=threads,
    )
    with one_thread():
        models = load_models(settings)
        session = AttachedSession(api)
        prepared = add_learned(session, settings, models, "attach")
    session.mark(attached=True)
    return Attached(session, prepared.cosimulation)
