"""The table of the flow benchmark: figures by situation and arm, and their ratio to SUMO's."""

from collections.abc import Mapping
from statistics import fmean, median
from typing import Any

from slrl_sumo.studies.flow.figures import FIGURES
from slrl_sumo.studies.flow.run import SUMO, Record, Run


def rows(runs: Mapping[Run, Record]) -> list[dict[str, Any]]:
    """A row for each situation, figure and arm with a value.

    `value`: mean over the seeds; `ratio`: mean over the seeds of the value over SUMO's, where the figure has one and
    SUMO's is not 0; `by_seed`: the values.
    """
    found = []
    for situation in dict.fromkeys(run.situation for run in runs):
        mine = {run: record for run, record in runs.items() if run.situation == situation}
        for name, figure in FIGURES.items():
            for arm in dict.fromkeys(run.arm for run in mine):
                values = {run.seed: _value(name, run, mine) for run in mine if run.arm == arm}
                known = {seed: value for seed, value in values.items() if value is not None}
                if not known:
                    continue
                ratios = []
                for seed, value in known.items():
                    base = _base(name, Run(situation, arm, seed), mine)
                    if figure.ratio and base:
                        ratios.append(value / base)
                found.append(
                    {
                        "situation": situation,
                        "figure": name,
                        "arm": arm,
                        "unit": figure.unit,
                        "value": round(fmean(known.values()), 4),
                        "ratio": round(fmean(ratios), 4) if ratios and arm != SUMO else None,
                        "by_seed": {str(seed): value for seed, value in known.items()},
                    }
                )
    return found


def _value(name: str, run: Run, runs: Mapping[Run, Record]) -> float | None:
    if name == "travel_time":
        return _travel_time(run, run, runs)
    value: float | None = runs[run]["figures"].get(name)
    return value


def _base(name: str, run: Run, runs: Mapping[Run, Record]) -> float | None:
    """SUMO's value for the comparison with `run`."""
    plain = Run(run.situation, SUMO, run.seed)
    if plain not in runs:
        return None
    return _travel_time(plain, run, runs) if name == "travel_time" else _value(name, plain, runs)


def _travel_time(run: Run, beside: Run, runs: Mapping[Run, Record]) -> float | None:
    """Median over the vehicles of `run` that also finished in `beside` and in SUMO's run of the same seed."""
    plain = Run(run.situation, SUMO, run.seed)
    arrived = [
        {name for name, (_, end) in runs[one]["trips"].items() if end is not None}
        for one in (plain, run, beside)
        if one in runs
    ]
    same = set.intersection(*arrived)
    times = [end - begin for name, (begin, end) in runs[run]["trips"].items() if name in same]
    return round(median(times), 3) if times else None
