"""The summary of a run, typed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any, Self

from slrl_sumo.extras import require
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.events import Started
from slrl_sumo.simulation.settings import RunSettings


@dataclass(frozen=True)
class TypeSummary:
    """Learned road users of one type; means and shares are None where there was none.

    A collision or near miss (metrics.encounters) of two of them counts once. `survival_steps`: mean number of decisions
    before the first collision. `success_rate`: share that came to the end of its trip, of its takeover or of the run
    without a collision, without leaving its own surface by more than 1 m and without being lost.
    """

    count: int
    mean_speed_mps: float | None
    standing_share: float | None
    collisions: int
    near_misses: int
    survival_steps: float | None
    success_rate: float | None
    off_surface_share: float | None


@dataclass(frozen=True)
class RunSummary:
    """Counts and means over all decisions of a run, as `run --summary` writes them; units are in the names."""

    scenario: str
    seed: int
    bundle: str
    selector: str
    sumo_step_s: float
    begin_s: float
    end_s: float
    """Simulation time of the last whole step, which ends the trace."""
    interrupted: bool
    """Whether the run ended before its time."""
    ended_by: str | None
    """What ended it then: SIGINT, SIGTERM, SIGHUP, or the message on SUMO's death or a full disk."""
    decisions: int
    decision_interval_s: float
    wall_s: float
    real_time_factor: float | None
    agent_steps: int
    agent_steps_per_s: float | None
    lost: int
    refused: int
    wrapped_around: int
    taken_over: int
    left_to_sumo: dict[str, int]
    """Road users that `takeover` wanted in the region but could not take, by reason: `class bus`, `size`, `fast lane`,
    `stop ahead`, `no walk`, `no lane`, `refused`, `excluded` (docs/how-to/take-over-road-users.md)."""
    handed_back: int
    returned_to_route: int
    arrived: int
    """Road users of the scenario that reached their destination while learned, or after they were handed back."""
    under_way: int
    """Road users that are or were learned and are in the network at the end."""
    collisions: int
    near_misses: int
    yield_interventions: int
    constraints: dict[str, int]
    per_type: dict[str, TypeSummary]
    wraparounds: list[dict[str, Any]]
    losses: list[dict[str, Any]]
    refusals: list[dict[str, Any]]
    peak_memory_mib: int
    notices: list[str]
    options: dict[str, Any]
    """Every option of the run with its value, and the files it named: `run --config SUMMARY.json` repeats it."""

    @classmethod
    def of(
        cls,
        settings: RunSettings,
        started: Started,
        counters: RunCounters,
        *,
        end_s: float,
        ended_by: str | None,
        wall_s: float,
        peak_memory_mib: int,
        notices: Sequence[str],
        outputs: Mapping[str, Path | None],
    ) -> Self:
        """The summary of a run that is over; `ended_by` where it ended before its time; `notices`: of its end."""
        counted = counters.summary(wall_s, DECISION_INTERVAL)
        per_type = {name: TypeSummary(**values) for name, values in counted.pop("per_type").items()}
        return cls(
            scenario=started.scenario,
            seed=settings.seed,
            bundle=started.bundle,
            selector=started.selector,
            sumo_step_s=started.step_length,
            begin_s=started.begin,
            end_s=end_s,
            interrupted=ended_by is not None,
            ended_by=ended_by,
            **counted,
            per_type=per_type,
            peak_memory_mib=peak_memory_mib,
            notices=[*started.notices, *notices],
            options={
                **settings.options(),
                **{name: None if path is None else str(path) for name, path in outputs.items()},
            },
        )

    def to_dict(self) -> dict[str, Any]:
        """The content of the JSON file."""
        return asdict(self)

    def to_pandas(self) -> Any:
        """A row for each type with learned road users, as a pandas DataFrame. Raises InputError where pandas is
        missing."""
        require("pandas", "to_pandas")
        import pandas as pd

        present = {name: asdict(values) for name, values in self.per_type.items() if values.count}
        return pd.DataFrame.from_dict(present, orient="index").rename_axis("type")

    @property
    def title(self) -> str:
        """The run in one line."""
        return (
            f"{self.scenario}: {self.agent_steps} agent-steps in {self.wall_s:.1f} s "
            f"({self.real_time_factor or 0:.1f}x real time), {self.ends}, {self.lost} lost"
            f"{f'; ended at {self.end_s:g} s by: {self.ended_by}' if self.interrupted else ''}"
        )

    @property
    def ends(self) -> str:
        """Where the learned road users have come to, in words."""
        if self.taken_over:
            return f"{self.taken_over} taken over, {self.arrived} arrived, {self.under_way} under way"
        return f"{self.wrapped_around} wrapped around"

    @property
    def left_line(self) -> str:
        """The road users that no takeover could take, in one line; '' where there is none."""
        if not self.left_to_sumo:
            return ""
        count = sum(self.left_to_sumo.values())
        reasons = ", ".join(f"{reason} {number}" for reason, number in self.left_to_sumo.items())
        return f"{count} road {'user' if count == 1 else 'users'} of the takeover stayed SUMO's: {reasons}"

    @property
    def refusal_line(self) -> str:
        """The road users that could not be moved, in one line; '' where there is none."""
        if not self.refusals:
            return ""
        first = self.refusals[0]
        named = [f"{first['id']} at {first['time_s']:g} s ({first['reason']})", *(r["id"] for r in self.refusals[1:6])]
        many = "1 road user was" if self.refused == 1 else f"{self.refused} road users were"
        return (
            f"{many} given back to SUMO, or removed if added, because they could not be moved: "
            f"{', '.join(named)}{', …' * (self.refused > len(named))}"
        )

    def rows(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows of a table for people: a row for each type with learned road users."""
        present = [(name, values) for name, values in self.per_type.items() if values.count]
        return ["type", *COLUMNS], [
            [name, *(_cell(key, getattr(values, key)) for key in COLUMNS.values())] for name, values in present
        ]

    def _repr_html_(self) -> str:
        headings, rows = self.rows()
        head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
        body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
        return f"<table><caption>{escape(self.title)}</caption><tr>{head}</tr>{body}</table>"


COLUMNS = {
    "count": "count",
    "mean speed (m/s)": "mean_speed_mps",
    "standing": "standing_share",
    "collisions": "collisions",
    "near misses": "near_misses",
    "survival (steps)": "survival_steps",
    "success": "success_rate",
    "off surface": "off_surface_share",
}
"""Heading and field of TypeSummary."""


def _cell(field: str, value: float | None) -> str:
    if value is None:  # the run ended before its first decision
        return "–"
    if field in ("standing_share", "success_rate", "off_surface_share"):
        return f"{100 * value:.1f} %"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
