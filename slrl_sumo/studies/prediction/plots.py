"""Pictures of prediction errors and of modes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slrl_sumo.learning.supervised.windows import Windows
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES

SELECTOR_COLOURS = {
    "constant-velocity": "#555555",
    "prior": "#0072B2",
    "step-oracle": "#009E73",
    "mode-oracle": "#56B4E9",
}
"""Okabe and Ito's palette, which the colour-blind can tell apart."""

PATHS = 1000
"""Trajectories in a picture of modes; more add nothing."""


def draw_errors(rows: Sequence[dict[str, Any]]) -> Figure:
    """Mean displacement error over the steps, per type and selector, as in the paper's Fig. 4 and 5.

    Dashed: the best of the samples, where a selector has several.
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


def draw_modes(windows: Windows, modes: dict[str, NDArray[np.int64]], count: int, seed: int = 0) -> Figure:
    """The paths of one type's windows in the ego frame, coloured by mode, as in the paper's Fig. 1.

    `modes`: (N,) in 0..count-1 by name of the way they were found; one picture each with the mean destination of each
    mode, and below it how many windows each has.
    """
    random = np.random.default_rng(seed)
    some = random.permutation(len(windows))[:PATHS]
    paths = np.concatenate([np.zeros((len(some), 1, 2)), windows.path[some]], axis=1)
    # One in a hundred may lie outside: one mislabelled cyclist would compress the picture of all pedestrians.
    low, high = np.percentile(paths.reshape(-1, 2), (0.5, 99.5), axis=0)
    margin = 0.05 * (high - low).max() + 0.5
    figure = Figure(figsize=(5.6 * len(modes), 5.6), layout="constrained")
    above, below = figure.subplots(2, len(modes), squeeze=False, height_ratios=(2, 1))
    for axes, bars, (name, mode) in zip(above, below, modes.items(), strict=True):
        counts = np.bincount(mode, minlength=count)
        total = np.stack([np.bincount(mode, windows.destination[:, i], count) for i in (0, 1)], -1)
        middle = total / np.maximum(counts, 1)[:, None]
        # Neighbouring modes have neighbouring numbers: jumping through the map keeps their colours apart.
        colours = np.asarray(colormaps["tab20"](np.arange(count) * 7 % 20))
        axes.add_collection(LineCollection(list(paths), colors=colours[mode[some]], linewidths=0.5, alpha=0.6))
        axes.scatter(*middle.T, c=colours, s=45, edgecolors="black", zorder=3)
        axes.set_aspect("equal")
        axes.set_xlim(low[0] - margin, high[0] + margin)
        axes.set_ylim(low[1] - margin, high[1] + margin)
        axes.set_title(f"{name}: {count} modes")
        axes.set_xlabel("ahead (m)")
        axes.set_ylabel("left (m)")
        bars.bar(np.arange(count), counts, color=colours)
        bars.set_xlabel("mode")
        bars.set_xticks(range(count))
        bars.set_ylabel("windows")
    return figure
