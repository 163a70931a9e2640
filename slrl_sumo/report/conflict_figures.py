"""The figure of conflicts: severity and place."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from slrl_sumo.ground.picture import GroundPicture
from slrl_sumo.metrics.conflicts import PET_LIMIT, Conflicts
from slrl_sumo.metrics.encounters import TTC_LIMIT
from slrl_sumo.report.looks import Look

GROUP_COLOURS = {"learned": "#E69F00", "mixed": "#56B4E9", "background": "#999999"}
"""Of Okabe and Ito's palette: both learned, one of the two, neither."""
GROUP_NAMES = {"learned": "two learned", "mixed": "learned and SUMO's", "background": "two of SUMO's"}


def draw_conflicts(
    ttc: Conflicts, pet: Conflicts, learned: NDArray[np.bool_], ground: GroundPicture, look: Look
) -> Figure:
    """Histograms of the smallest TTC and PET of each encounter, by group, and a map of the places."""
    figure = Figure(figsize=(15.0, 5.2), layout="constrained")
    left, middle, place = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.3))
    # Post-encroachment times are multiples of 0.1 s, in the middle of their bins.
    for axes, found, limit, name, edges in (
        (left, ttc, TTC_LIMIT, "time to collision", np.linspace(0.0, TTC_LIMIT, 16)),
        (middle, pet, PET_LIMIT, "post-encroachment time", np.linspace(-0.05, PET_LIMIT - 0.05, 11)),
    ):
        group = _groups(found, learned)
        axes.hist(
            [found.value[group == name] for name in GROUP_COLOURS],
            edges,
            stacked=True,
            color=list(GROUP_COLOURS.values()),
            label=[f"{GROUP_NAMES[name]} ({(group == name).sum()})" for name in GROUP_COLOURS],
        )
        axes.set_xlabel(f"smallest {name} (s)")
        axes.set_ylabel("encounters (count)")
        axes.set_title(f"encounters below {limit:g} s: {len(found)}", fontsize=10)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylim(0.0, max(1.35 * axes.get_ylim()[1], 1.35))
        axes.legend(fontsize=8, loc="upper right")
        axes.spines[["top", "right"]].set_visible(False)
    place.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest")
    for found, marker in ((ttc, "o"), (pet, "^")):
        group = _groups(found, learned)
        for name, colour in GROUP_COLOURS.items():
            x, y = found.x[group == name], found.y[group == name]
            place.plot(x, y, marker, color=colour, ms=6, mec=look.ink, mew=0.5, ls="")
    place.set_title("Places (circles: TTC, triangles: PET)", fontsize=10)
    place.set_xlabel("x (m)")
    place.set_ylabel("y (m)")
    return figure


def _groups(found: Conflicts, learned: NDArray[np.bool_]) -> NDArray[np.str_]:
    names = np.array(["background", "mixed", "learned"])
    return names[learned[found.a].astype(np.intp) + learned[found.b]]
