"""A run in the own process, decision by decision."""

from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.events import Decision, Event, Started
from slrl_sumo.simulation.excluded import Excluded
from slrl_sumo.simulation.region import RegionSpec
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings, constraint_names
from slrl_sumo.simulation.shares import Shares
from slrl_sumo.sumo.scenario import Scenario


class Simulation:
    """Learned road users in a scenario, run in this process: a context manager and an iterator over its decisions.

        with slrl_sumo.Simulation("my.sumocfg", takeover={"car": 1}) as simulation:
            for decision in simulation:
                print(simulation.world.time, len(decision.modes))

    The arguments are those of `slrl_sumo.run`. libsumo holds one simulation per process, and where SUMO crashes, this
    process dies with it: `slrl_sumo.run` is the safer way. Leaving the context closes SUMO.

    Entering raises InputError where an argument is wrong, an iteration raises SumoError where SUMO fails.
    """

    def __init__(
        self,
        scenario: str | Path | Scenario,
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
        steps: int | None = None,
        until: float | None = None,
        seed: int = 1,
        step_length: float | None = None,
        background_yields: bool = True,
        threads: int = 1,
        sumo_outputs: bool = False,
        sumo_options: str = "",
    ) -> None:
        self.settings = RunSettings(
            scenario,
            agents=agents,
            mix=mix,
            takeover=takeover,
            region=region,
            exclude=exclude,
            bundle=bundle,
            selector=selector,
            guard=guard,
            without=constraint_names(without),
            steps=steps,
            until=until,
            seed=seed,
            step_length=step_length,
            background_yields=background_yields,
            threads=threads,
            sumo_outputs=sumo_outputs,
            sumo_options=sumo_options,
        )
        self._events: Generator[Event, None, None] | None = None

    started: Started
    """What is known at the start: number of decisions, SUMO's step, notices, the ground. Set on entering."""
    world: WorldState
    """All road users after the last decision, learned ones first. Set on entering."""

    def __enter__(self) -> Self:
        events = run(self.settings)
        started = next(events)
        assert isinstance(started, Started)
        self._events, self.started, self.world = events, started, started.step.world
        return self

    def __iter__(self) -> Iterator[Decision]:
        return self

    def __next__(self) -> Decision:
        """The next decision of all learned road users, and SUMO's steps up to the one after it."""
        if self._events is None:
            raise InputError("the simulation is not open; call it in a with statement")
        decision = next(self._events)
        assert isinstance(decision, Decision)
        self.world = decision.steps[-1].world
        return decision

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._events is not None:
            self._events.close()
            self._events = None
