"""Settings of runs, checked on construction: plain values that can cross a process border. No SUMO, no PyTorch."""

import math
import operator
import os
import shlex
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slrl_sumo.errors import InputError, check_type, check_whole_number
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.simulation.excluded import Excluded, parse_excluded
from slrl_sumo.simulation.shares import Shares, parse_mix, parse_shares, shares_text
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from slrl_sumo.sumo.scenario.options import with_options

if TYPE_CHECKING:
    from slrl_sumo.simulation.region import RegionSpec  # scipy takes its time

MOST_AGENTS = 1_000_000
"""Greatest number of spawned road users; no network has room for more."""


def constraint_names(without: Sequence[str]) -> tuple[str, ...]:
    """The names in `without`. Raises InputError if `without` is not a sequence of texts."""
    if isinstance(without, str) or not isinstance(without, Sequence) or not all(isinstance(i, str) for i in without):
        raise InputError("give a list of names of constraints", argument="without", value=without)
    return tuple(without)


@dataclass(frozen=True, kw_only=True)
class LearnedSettings:
    """Which road users of a simulation are learned, and how they decide. Raises InputError for invalid settings."""

    agents: int | None = None
    """Number of road users to spawn; None: no spawned road users."""
    mix: Shares | None = None
    """Shares of the types among spawned road users; None: half cars, a fifth bicycles, the rest pedestrians."""
    takeover: Shares | None = None
    """Share of each type of the scenario's road users that is taken over; None: no takeover."""
    region: "str | RegionSpec | None" = None
    """Region in which road users are taken over; None: everywhere."""
    exclude: Excluded = ()
    """Ids of road users that are neither taken over nor held for learned road users, such as an ego vehicle of a
    script."""
    bundle: str | Path = DEFAULT_BUNDLE
    """Name of a shipped bundle, or folder of a bundle."""
    selector: str | None = None
    """prior, rule, greedy, sampled or lane; None: the bundle's default (see `agent.make_driver.usual_selector`)."""
    guard: bool = False
    """Exclude modes that lead into a conflict, unless all modes do (see agent.guard)."""
    without: tuple[str, ...] = ()
    """Constraints that are switched off, by their names in agent.constraints."""
    seed: int = 1
    """Seed of the starting places, the draw of the takeover and the choices, 0 to 2147483647."""
    background_yields: bool = True
    """Whether background vehicles and persons stop for learned road users."""
    threads: int = 1
    """Number of threads over which the road users of a decision are distributed; results do not depend on it."""

    def __post_init__(self) -> None:
        check_type("bundle", self.bundle, (str, Path), "the name or the folder of a bundle")
        check_type("selector", self.selector, (str, type(None)), "the name of a selector")
        check_type("guard", self.guard, (bool,), "True or False")
        check_type("background_yields", self.background_yields, (bool,), "True or False")
        if self.agents is None and self.takeover is None:
            raise InputError(
                "no learned road user: give `agents=N`, or `takeover='car=0.3'` to take over the scenario's own"
            )
        if self.agents is None and self.mix is not None:
            raise InputError(
                "the shares are those of `agents`, which is not given; add `agents=N`", argument="mix", value=self.mix
            )
        if self.takeover is None and self.region is not None:
            raise InputError(
                "it limits `takeover`, which is not given; add `takeover='car=0.3'`",
                argument="region",
                value=self.region,
            )
        if self.agents is not None:
            check_whole_number("agents", self.agents, 1, MOST_AGENTS)
        check_whole_number("seed", self.seed, 0, 2**31 - 1)
        check_whole_number("threads", self.threads, 1, 1024)
        if self.mix is not None:
            parse_mix(self.mix)
        if self.takeover is not None:
            parse_shares(self.takeover)
        parse_excluded(self.exclude)


@dataclass(frozen=True)
class RunSettings(LearnedSettings):
    """A run in a scenario."""

    scenario: str | Path | Scenario
    """Name of a shipped scenario, folder, .sumocfg file, or a loaded scenario."""
    _: KW_ONLY
    steps: int | None = None
    """Number of decisions of 0.4 s; None: until `until`, else until the scenario's end, else until its road users have
    left."""
    until: float | None = None
    """Simulation time to stop at, s."""
    step_length: float | None = None
    """SUMO's step, s, which must divide 0.4 s; None: the scenario's step if it divides 0.4 s, else 0.4 s."""
    sumo_outputs: bool = False
    """Whether the scenario writes its output files."""
    sumo_options: str = ""
    """Options for SUMO itself, as on its command line."""
    gui: bool = False
    """Whether SUMO opens the window of sumo-gui, which shows the run and can stop it; needs a display."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_type("scenario", self.scenario, (str, Path, Scenario), "the name, folder or .sumocfg of a scenario")
        check_type("until", self.until, (int, float, type(None)), "a simulation time in seconds")
        check_type("step_length", self.step_length, (int, float, type(None)), "a time in seconds")
        check_type("sumo_outputs", self.sumo_outputs, (bool,), "True or False")
        check_type("sumo_options", self.sumo_options, (str,), "options as on SUMO's command line, as one text")
        check_type("gui", self.gui, (bool,), "True or False")
        if self.gui and not os.environ.get("DISPLAY"):
            raise InputError(
                "there is no display (DISPLAY is not set); run it on a desktop, or through xvfb-run", argument="gui"
            )
        if self.steps is not None and self.until is not None:
            raise InputError("`steps` and `until` were both given; give one of them")
        if self.steps is not None:
            check_whole_number("steps", self.steps, 1, 10**9)
        if self.until is not None and not math.isfinite(self.until):
            raise InputError("give a simulation time in seconds", argument="until", value=self.until)

    def found(self) -> Scenario:
        """The scenario with `sumo_options`. Raises InputError for an unknown scenario or invalid options."""
        scenario = self.scenario if isinstance(self.scenario, Scenario) else find_scenario(str(self.scenario))
        try:
            words = shlex.split(self.sumo_options)
        except ValueError as error:
            raise InputError(str(error).lower(), argument="sumo_options", value=self.sumo_options) from None
        return with_options(scenario, words)

    def options(self) -> dict[str, Any]:
        """All settings as values for JSON and TOML: `slrl_sumo.run(**options)` repeats the run."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name in ("mix", "takeover"):
            if values[name] is not None:
                values[name] = shares_text(values[name])
        numbers = ("agents", "steps", "seed", "threads")
        values |= {name: operator.index(values[name]) for name in numbers if values[name] is not None}
        texts = {name: str(values[name]) for name in ("scenario", "bundle", "region") if values[name] is not None}
        lists = {"exclude": list(parse_excluded(self.exclude)), "without": list(self.without)}
        return {**values, **texts, **lists, "scenario": self.where}

    @property
    def where(self) -> str:
        """Name of the scenario in messages."""
        return str(self.scenario.config if isinstance(self.scenario, Scenario) else self.scenario)
