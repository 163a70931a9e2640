"""Tables of a comparison: measures by arm, and their difference with its confidence interval over seeds."""

import math
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean
from typing import Any

import numpy as np
from scipy.stats import t as student

from slrl_sumo.metrics.distributions import QUANTITIES, divergence
from slrl_sumo.metrics.traffic.trips import Trip
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.compare.measures import MEASURES, Measure, SeedRun
from slrl_sumo.studies.compare.run import ARMS, Record, Run
from slrl_sumo.studies.compare.verdicts import verdict

CONFIDENCE = 0.95


def columns(arms: Iterable[str] = ARMS) -> tuple[str, ...]:
    """Of results.csv: means over the seeds, and the limits of their confidence intervals."""
    figures = (f"{what}{part}" for what in (*arms, "difference") for part in ("", "_low", "_high"))
    return "measure", "type", "unit", "seeds", *figures, "verdict", "definition"


def rows(
    runs: Mapping[Run, Record], arms: tuple[str, str] = ARMS, measures: Sequence[Measure] = MEASURES
) -> list[dict[str, Any]]:
    """A row for each measure and type, over seeds that have both runs.

    `sumo`, `learned` (or other `arms`): means over seeds; `difference`: mean of learned - sumo, seed by seed; each
    with `_low` and `_high`, the limits of the confidence interval (95 %, Student's t; None with one seed). `by_seed`:
    the values. Seeds without a value in both arms do not count; measures without any are left out. `verdict`: what
    the interval says.
    """
    seeds = sorted({run.seed for run in runs})
    parties = {seed: _party([runs[Run(seed, arm)] for arm in arms]) for seed in seeds}
    found = []
    for measure in measures:
        for kind in measure.types:
            values = {seed: [measure.value(one, kind) for one in parties[seed]] for seed in seeds}
            pairs = {s: (a, b) for s, (a, b) in values.items() if a is not None and b is not None}
            if not pairs:
                continue
            ours, theirs = ([pair[k] for pair in pairs.values()] for k in (1, 0))
            row: dict[str, Any] = {
                "measure": measure.name,
                "type": kind,
                "unit": measure.unit,
                "seeds": len(pairs),
                **_interval(arms[0], theirs),
                **_interval(arms[1], ours),
                **_interval("difference", [b - a for a, b in pairs.values()]),
                "definition": measure.definition,
                "by_seed": {str(s): dict(zip(arms, pair, strict=True)) for s, pair in pairs.items()},
            }
            found.append(row | {"verdict": verdict(row, arms[0])})
    return found


def distances(runs: Mapping[Run, Record], arms: tuple[str, str] = ARMS) -> list[dict[str, Any]]:
    """Jensen-Shannon distance of the distributions of motion in the two arms, by type and quantity, with interval."""
    found, seeds = [], sorted({run.seed for run in runs})
    for kind in TYPE_NAMES:
        for quantity in QUANTITIES:
            both = [[runs[Run(s, arm)]["histograms"][quantity].get(kind) for arm in arms] for s in seeds]
            known = [(np.array(a), np.array(b)) for a, b in both if a is not None and b is not None]
            values = [math.sqrt(divergence(a, b)) for a, b in known]
            if values:
                found.append(
                    {"type": kind, "quantity": quantity, "seeds": len(values), **_interval("distance", values)}
                )
    return found


def confidence_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Limits of the CONFIDENCE interval of the mean by Student's t; None for fewer than two values."""
    n = len(values)
    if n < 2:
        return None
    half = float(student.ppf(0.5 + 0.5 * CONFIDENCE, n - 1)) * float(np.std(values, ddof=1)) / n**0.5
    return fmean(values) - half, fmean(values) + half


def _interval(name: str, values: Sequence[float]) -> dict[str, float | None]:
    limits = confidence_interval(values)
    low, high = limits if limits is not None else (None, None)
    return {name: fmean(values), f"{name}_low": low, f"{name}_high": high}


def _party(records: Sequence[Record]) -> list[SeedRun]:
    trips = [{i: Trip(*values) for i, values in record["trips"].items()} for record in records]
    same = frozenset.intersection(*(frozenset(i for i, t in some.items() if t.arrived is not None) for some in trips))
    return [SeedRun(record, some, same) for record, some in zip(records, trips, strict=True)]
