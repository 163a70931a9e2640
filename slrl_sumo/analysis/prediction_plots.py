"""Pictures of prediction errors and of modes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from slrl_sumo.learning.modes import assign
from slrl_sumo.learning.windows import Windows
from slrl_sumo.world.geometry import Floats
from slrl_sumo.world.types import DECISION_INTERVAL, TYPE_NAMES

SELECTOR_COLOURS = {"constant-velocity": "#555555", "prior": "#0072B2", "oracle": "#009E73"}
"""Okabe and Ito's palette, which the colour-blind can tell apart."""

PATHS = 1500
"""Trajectories in a picture of modes; more would only be ink."""


def draw_errors(rows: Sequence[dict[str, Any]]) -> Figure:
    """Mean displacement error over the steps, per type and selector, in the manner of the paper's Fig. 4 and 5.

    Dashed: the best of the samples, where a selector draws.
    """
    kinds = [kind for kind in TYPE_NAMES if any(row["type"] == kind for row in rows)]
    figure = Figure(figsize=(4.2 * len(kinds), 3.8), layout="constrained")
    for axes, kind in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        for name in dict.fromkeys(row["selector"] for row in rows):
            mine = [row for row in rows if row["selector"] == name and row["type"] == kind]
            steps, error, best = (np.array([row[key] for row in mine]) for key in ("step", "fde_m", "min_fde_m"))
            colour = SELECTOR_COLOURS.get(name, "#D55E00")
            axes.plot(steps, error, "o-", ms=3, color=colour, label=name)
            if (best < error).any():
                axes.plot(steps, best, "--", color=colour, label=f"{name}, best of samples")
        last = max((row for row in rows if row["type"] == kind), key=lambda row: row["step"])
        axes.set_title(f"{kind} (n = {last['n']} at the last step)", fontsize=10)
        axes.set_xlabel(f"step ({DECISION_INTERVAL} s)")
        axes.set_ylabel("displacement error (m)")
        axes.set_ylim(bottom=0)
        axes.set_xticks(range(0, last["step"] + 1, 2))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    return figure


def draw_modes(windows: Windows, centres: dict[str, Floats], seed: int = 0) -> Figure:
    """The paths of one type's windows in the ego frame, coloured by mode, as in the paper's Fig. 1.

    `centres`: (modes, 2) m by name of the clustering; one picture each, and below it how many windows each mode has.
    """
    random = np.random.default_rng(seed)
    some = random.permutation(len(windows))[:PATHS]
    paths = np.concatenate([np.zeros((len(some), 1, 2)), windows.path[some]], axis=1)
    figure = Figure(figsize=(6.4 * len(centres), 8.0), layout="constrained")
    above, below = figure.subplots(2, len(centres), squeeze=False, height_ratios=(3, 1))
    for axes, counts, (name, middle) in zip(above, below, centres.items(), strict=True):
        mode = assign(windows.destination, middle)
        # Neighbouring modes have neighbouring numbers: jumping through the map keeps their colours apart.
        colours = np.asarray(colormaps["tab20"](np.arange(len(middle)) * 7 % 20))
        axes.add_collection(LineCollection(list(paths), colors=colours[mode[some]], linewidths=0.5, alpha=0.6))
        axes.scatter(*middle.T, c=colours, s=45, edgecolors="black", zorder=3)
        axes.set_aspect("equal", adjustable="datalim")
        axes.autoscale_view()
        axes.set_title(f"{name}: {len(middle)} modes of the position after 4.8 s")
        axes.set_xlabel("ahead (m)")
        axes.set_ylabel("left (m)")
        counts.bar(np.arange(len(middle)), np.bincount(mode, minlength=len(middle)), color=colours)
        counts.set_xlabel("mode")
        counts.set_xticks(range(len(middle)))
        counts.set_ylabel("windows")
    return figure
