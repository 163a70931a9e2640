"""The picture of a comparison."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from slrl_sumo.studies.compare.measures import MEASURES
from slrl_sumo.studies.compare.run import LEARNED, SUMO

ARM_COLOURS = {SUMO: "#999999", LEARNED: "#E69F00"}
"""Of Okabe and Ito's palette, which the colour-blind can tell apart; the types have other ones."""
PANELS = ("travel_time", "delay", "stops", "speed", "ttc", "pet", "collisions", "co2_per_km")


def draw_comparison(result: dict[str, Any]) -> Figure:
    """A panel for each of PANELS that is not 0: bars are means over the seeds, whiskers their 95 % confidence
    intervals, dots the seeds; lines join the dots of a seed."""
    rows = [row for row in result["rows"] if any(any(pair.values()) for pair in row["by_seed"].values())]
    shown = [name for name in PANELS if any(row["measure"] == name for row in rows)]
    columns = 4
    height = -(-len(shown) // columns)
    figure = Figure(figsize=(14.0, 3.4 * height + 0.8), layout="constrained")
    grid = figure.subplots(height, columns, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for axes, name in zip(grid.flat, shown, strict=False):
        _draw(axes, name, [row for row in result["rows"] if row["measure"] == name])
    handles, labels = grid.flat[0].get_legend_handles_labels()
    handles += [Line2D([], [], color="black", lw=1), Line2D([], [], color="black", marker="o", ms=3, lw=0)]
    labels += ["95 % confidence interval", "seed"]
    figure.legend(handles, labels, loc="outside lower left", ncols=4, frameon=False)
    seeds = result["seeds"]
    figure.suptitle(
        f"{result['scenario']}, {result['seconds']:g} s, {len(seeds)} seed{'s' * (len(seeds) > 1)}: "
        f"SUMO's own models and {result['bundle']}, {result['selector']}",
        x=0.01,
        ha="left",
        fontsize=12,
    )
    return figure


def _draw(axes: Axes, name: str, rows: list[dict[str, Any]]) -> None:
    measure = next(measure for measure in MEASURES if measure.name == name)
    places = np.arange(len(rows))
    for arm, shift, label in ((SUMO, -0.2, "SUMO's own models"), (LEARNED, 0.2, "learned")):
        means = np.array([row[arm] for row in rows])
        axes.bar(places + shift, means, 0.38, color=ARM_COLOURS[arm], label=label)
        for place, row in zip(places, rows, strict=True):
            if row[f"{arm}_low"] is not None:
                span = np.array([[row[arm] - row[f"{arm}_low"]], [row[f"{arm}_high"] - row[arm]]])
                axes.errorbar([place + shift], [row[arm]], span, color="black", capsize=3, lw=1)
    for place, row in zip(places, rows, strict=True):
        for values in row["by_seed"].values():
            axes.plot([place - 0.2, place + 0.2], [values[SUMO], values[LEARNED]], "o-", color="black", ms=2.5, lw=0.4)
    axes.set_xticks(places, [row["type"] for row in rows])
    axes.set_ylabel(f"{measure.title} ({'count' if measure.unit == '1' else measure.unit})")
    most = max(value for row in rows for values in row["by_seed"].values() for value in values.values())
    # With few seeds, an interval may be many times as long as the measured values: it may leave the panel.
    counted = measure.unit == "1"
    axes.set_ylim(0.0, max(1.4 * most, 1.0 if counted else 1e-3))
    if counted:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.spines[["top", "right"]].set_visible(False)
