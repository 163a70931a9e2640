"""Comparison with SUMO's models as a function, and its result for notebooks."""

import warnings
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slrl_sumo.errors import check_type, check_whole_number
from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import Output, claimed
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE, find_bundle
from slrl_sumo.simulation.excluded import Excluded
from slrl_sumo.simulation.shares import Shares, shares_text
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import named_files

if TYPE_CHECKING:
    from slrl_sumo.simulation.region import RegionSpec  # scipy takes its time

COMPARISON_FILES = ("results.*", "comparison.*", "runs.jsonl", "conflicts.csv")
"""What a comparison writes into its folder."""
ALL_TYPES: Shares = {"car": 1, "bicycle": 1, "pedestrian": 1}
COLUMNS = ("measure", "type", "unit", "sumo", "learned", "difference", "difference_low", "difference_high", "verdict")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Result of a comparison of learned road users with SUMO's models; shown as a table in a notebook."""

    folder: Path
    """With comparison.html, results.json, results.csv, conflicts.csv and comparison.png."""
    result: dict[str, Any] = field(repr=False)
    """The content of results.json."""

    @property
    def page(self) -> Path:
        """The page for a browser."""
        return self.folder / "comparison.html"

    def to_pandas(self) -> Any:
        """A row for each measure and type: means over the seeds, their difference, its 95 % interval, what it says,
        and the definition. Raises InputError where pandas is missing."""
        require("pandas", "to_pandas")
        import pandas as pd

        return pd.DataFrame(self.result["rows"])[[*COLUMNS, "seeds", "definition"]]

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(column.replace('_', ' '))}</th>" for column in COLUMNS)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(_cell(row[column]))}</td>' for column in COLUMNS)}</tr>"
            for row in self.result["rows"]
        )
        title = f"{self.result['scenario']}, {self.result['seconds']:g} s, {len(self.result['seeds'])} seeds"
        return f"<table><caption>{escape(title)}</caption><tr>{head}</tr>{body}</table>"


def compare(
    scenario: str | Path,
    *,
    out: str | Path,
    bundle: str | Path = DEFAULT_BUNDLE,
    takeover: Shares = ALL_TYPES,
    region: "str | RegionSpec | None" = None,
    exclude: Excluded = (),
    selector: str | None = None,
    guard: bool = False,
    steps: int | None = None,
    seconds: float | None = None,
    seed: int = 1,
    seeds: int = 5,
    step_length: float | None = None,
    workers: int | None = None,
) -> Comparison:
    """Run a scenario with SUMO's own models and with learned ones, for `seeds` seeds from `seed` on, and measure the
    differences, as `slrl-sumo compare` does; finished runs in the folder `out` are not repeated.

        slrl_sumo.compare("signalised", out="out/compare", seeds=10, seconds=300).to_pandas()

    `takeover`, `region`, `exclude`, `bundle`, `selector`, `guard`, `step_length`: as in `run`. `steps` (decisions of
    0.4 s) or `seconds`: length of a run; without both to the scenario's end. `workers`: simulations at the same time.

    Raises InputError where an argument is wrong, matplotlib is missing or a file cannot be written, SumoError where no
    seed has both its runs.
    """
    require("matplotlib", "compare")
    from slrl_sumo.jobs.pool import Backend
    from slrl_sumo.studies.compare.comparison import ComparisonSettings
    from slrl_sumo.studies.compare.comparison import compare as measure
    from slrl_sumo.studies.compare.report import write_comparison

    check_type("scenario", scenario, (str, Path), "the name, folder or .sumocfg of a scenario")
    check_whole_number("seeds", seeds, 1, 10_000)
    folder = Path(out)
    settings = ComparisonSettings(
        scenario=str(scenario),
        bundle=str(bundle),
        takeover=shares_text(takeover),
        region=None if region is None else str(region),
        exclude=exclude,
        selector=selector,
        guard=guard,
        steps=steps,
        seconds=seconds,
        seed=seed,
        seeds=seeds,
        step_length=step_length,
        backend=Backend(workers),
    )
    inputs = [*named_files(find_scenario(str(scenario))), find_bundle(bundle)]
    with claimed([Output("out", folder, COMPARISON_FILES)], inputs):
        result, runs = measure(settings, folder)
        write_comparison(result, runs, folder)
    for one in result["left_out"]:
        warnings.warn(f"left out: {one['arm']}, seed {one['seed']}: {one['reason']}", stacklevel=2)
    return Comparison(folder, result)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
