"""Figures of the modes and ego images of learned road users."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slrl_sumo.report.looks import Look
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.events import Views

LABELS = {
    "accelerations": (
        "acceleration (share of the recorded)",
        "lateral acceleration to the left\n(root of the share of the recorded)",
    ),
    "curved": ("root of the distance after 4.8 s (√m)", "curvature to the left, weighted (1)"),
}
"""Of both axes for modes of vehicles, by what they are clusters of; others are clusters of places."""


def draw_modes(counts: NDArray[np.int64], centres: Floats, modes_by: str, look: Look) -> Figure:
    """For each type with decisions: what each mode is a cluster of, and how often it was chosen.

    `counts`: (3, modes); `centres`: (3, modes, 2) and `modes_by`: see Started.
    """
    relative = ", less most of the way\nat the present speed" * (modes_by in ("relative", "paths"))
    places = f"ahead after 4.8 s{relative} (m)", "to the left after 4.8 s (m)"
    kinds = np.flatnonzero(counts.any(axis=1)).tolist()
    figure = Figure(figsize=(4.4 * len(kinds) + 0.4, 6.6), layout="constrained")
    grid = figure.subplots(2, len(kinds), squeeze=False, height_ratios=(1.5, 1.0))
    for column, kind in enumerate(kinds):
        share = 100.0 * counts[kind] / counts[kind].sum()
        x, y = centres[kind].T
        axes = grid[0, column]
        axes.scatter(x, y, 4.0 + 22.0 * share, color=look.types[kind], alpha=0.6, edgecolor=look.ink, linewidth=0.4)
        for mode in np.argsort(-share)[:5].tolist():
            axes.annotate(str(mode), (x[mode], y[mode]), fontsize=8, ha="center", va="center")
        axes.plot(0.0, 0.0, marker=">", color=look.ink, ms=7)
        axes.set_title(f"{TYPE_NAMES[kind]}: {counts[kind].sum()} decisions", fontsize=10)
        along, aside = places if kind == RoadUserType.PEDESTRIAN else LABELS.get(modes_by, places)
        axes.set_xlabel(along)
        axes.set_ylabel(aside)
        axes.margins(0.15)
        bars = grid[1, column]
        bars.bar(np.arange(len(share)), share, color=look.types[kind])
        bars.set_xlabel("mode (number)")
        bars.set_ylabel("share of decisions (%)")
        bars.set_xticks(np.arange(0, len(share), 2))
        bars.spines[["top", "right"]].set_visible(False)
    return figure


def draw_views(views: Sequence[Views]) -> Figure:
    """Ego images of some road users, a column for each time."""
    rows = max(len(view.ids) for view in views)
    figure = Figure(figsize=(4.2 * len(views), 2.6 * rows), layout="constrained")
    grid = figure.subplots(rows, len(views), squeeze=False)
    for axes in grid.flat:
        axes.set_visible(False)
    for column, view in enumerate(views):
        for row, road_user in enumerate(view.ids):
            axes = grid[row, column]
            axes.set_visible(True)
            # The first row of the image is the left side; the image reaches from 8 m behind to 32 m ahead.
            axes.imshow(view.images[row], extent=(-8, 32, -10, 10), interpolation="nearest")
            axes.set_title(f"{road_user} at {view.time:.1f} s", fontsize=9)
            axes.set_xlabel("ahead (m)", fontsize=8)
            axes.set_ylabel("left (m)", fontsize=8)
    return figure
