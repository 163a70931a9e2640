"""The figure of speeds, accelerations and yaw rates, against a reference."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from slrl_sumo.metrics.distributions import EDGES, QUANTITIES, Kinematics, histogram, jensen_shannon_distance
from slrl_sumo.report.looks import Look
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES


def draw_motion(ours: Kinematics, theirs: Kinematics, name: str, look: Look) -> Figure:
    """A row for each type that was learned, a column for each quantity: learned road users filled, `theirs` (called
    `name`) as a line."""
    kinds = [k for k in range(len(TYPE_NAMES)) if len(ours["speed"][k])]
    figure = Figure(figsize=(13.0, 2.9 * len(kinds) + 0.6), layout="constrained")
    grid = figure.subplots(len(kinds), len(QUANTITIES), squeeze=False)
    for row, kind in enumerate(kinds):
        for column, (quantity, unit) in enumerate(QUANTITIES.items()):
            axes, edges = grid[row, column], EDGES[quantity][kind]
            mine, others = ours[quantity][kind], theirs[quantity][kind]
            shares = [100.0 * histogram(values, edges) for values in (mine, others)]
            axes.stairs(shares[0], edges, fill=True, color=look.types[kind], alpha=0.75)
            title = f"{TYPE_NAMES[kind]}: n = {len(mine)}"
            if len(others):
                axes.stairs(shares[1], edges, color=look.ink, lw=1.2)
                title += f" and {len(others)}"
                if len(mine):
                    title += f", distance {jensen_shannon_distance(a=mine, b=others, edges=edges):.2f}"
            axes.set_title(title, fontsize=9)
            axes.set_xlabel(f"{quantity.replace('_', ' ')} ({unit})")
            axes.set_ylabel("share of moments (%)")
            axes.xaxis.set_major_locator(MaxNLocator(5))
            axes.spines[["top", "right"]].set_visible(False)
            _cut_peak(axes, edges, shares)
    figure.suptitle(f"Filled: learned road users; line: {name}", x=0.01, ha="left", fontsize=11)
    return figure


def _cut_peak(axes: Axes, edges: Floats, shares: list[Floats]) -> None:
    """Cut a bin that would flatten the others, as that of standing road users, and write its height beside it."""
    highest = np.maximum(*shares)
    peak = int(np.argmax(highest))
    rest = float(np.delete(highest, peak).max())
    if highest[peak] <= 3.0 * rest or rest == 0.0:
        axes.set_ylim(bottom=0.0)
        return
    axes.set_ylim(0.0, 1.5 * rest)
    both = " and ".join(f"{share[peak]:.0f} %" for share in shares)
    axes.annotate(
        f"↑ {both}", (edges[peak + 1], 1.4 * rest), textcoords="offset points", xytext=(4, 0), fontsize=8, va="center"
    )
