"""Pictures of the flow benchmark: a panel for each situation, a colour for each arm."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.studies.flow.run import Record, Run

COLOURS = ("#999999", "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#D55E00")
"""Of Okabe and Ito's palette, which the colour-blind can tell apart; the first is SUMO's."""
PANEL_COLUMNS = 3

Curve = Callable[[Axes, Floats, str, str], None]
"""Draws values in a colour under a label."""


def draw_fundamental_diagram(runs: Mapping[Run, Record]) -> Figure:
    """Flow against density, per lane: a dot for each edge and minute of all seeds."""

    def dots(axes: Axes, states: Floats, colour: str, arm: str) -> None:
        density, flow = states.reshape(-1, 2).T
        axes.plot(density, flow, "o", ms=3, alpha=0.5, mew=0.0, color=colour, label=arm)
        axes.set_xlim(0.0, 150.0)

    return _panels(runs, "edge_states", dots, "density (veh/km)", "flow (veh/h)")


def draw_under_way(runs: Mapping[Run, Record]) -> Figure:
    """Vehicles in the network over time: a line for each seed."""

    def line(axes: Axes, counts: Floats, colour: str, arm: str) -> None:
        axes.plot(60.0 * np.arange(1, len(counts) + 1), counts, color=colour, label=arm)

    return _panels(runs, "under_way_by_minute", line, "time (s)", "vehicles in the network")


def _panels(runs: Mapping[Run, Record], key: str, draw: Curve, x: str, y: str) -> Figure:
    situations = list(dict.fromkeys(run.situation for run in runs))
    arms = list(dict.fromkeys(run.arm for run in runs))
    height = -(-len(situations) // PANEL_COLUMNS)
    figure = Figure(figsize=(13.0, 3.4 * height + 0.6), layout="constrained")
    grid = figure.subplots(height, PANEL_COLUMNS, squeeze=False)
    for axes in grid.flat[len(situations) :]:
        axes.set_visible(False)
    panels = dict(zip(situations, grid.flat, strict=False))
    for run, record in runs.items():
        colour = COLOURS[arms.index(run.arm) % len(COLOURS)]
        draw(panels[run.situation], np.array(record[key], np.float64), colour, run.arm)
    handles: dict[str, Artist] = {}
    for situation, axes in panels.items():
        axes.set_title(situation, loc="left", fontsize=10)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        axes.spines[["top", "right"]].set_visible(False)
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), loc="outside upper left", ncols=7, frameon=False)
    return figure
