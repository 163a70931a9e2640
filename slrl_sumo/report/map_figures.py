"""Maps of a run: paths, density and speed, and the space-time diagram of its busiest path."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.picture import GroundPicture
from slrl_sumo.metrics.traffic.corridor import along, busiest
from slrl_sumo.report.looks import Look
from slrl_sumo.scene.types import TYPE_NAMES

DENSITY_CELL = 2.0
"""Side (m) of a cell of the density map; larger if a side would have more than MOST_CELLS cells."""
MOST_CELLS = 400


INTERVAL_PARTS = 10
"""Of the path of an interval, for the density."""


def draw_paths(
    scenario: str, tracks: Trajectories, learned: NDArray[np.bool_], ground: GroundPicture, look: Look
) -> Figure:
    """Paths of the learned road users."""
    figure = Figure(figsize=ground.fitting(11.0, (5.0, 4.0)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest")
    for kind, name in enumerate(TYPE_NAMES):
        mine = np.flatnonzero(learned & (tracks.type == kind)).tolist()
        paths = [np.column_stack([tracks.x[rows], tracks.y[rows]]) for rows in (_rows(tracks, k) for k in mine)]
        if not paths:
            continue
        lines = LineCollection(paths, colors=look.types[kind], linewidths=0.8, alpha=0.8)
        users = {tracks.ids[k].partition("#")[0] for k in mine}
        lines.set_label(f"{name} ({len(users)})")
        axes.add_collection(lines)
        ends = np.array([path[-1] for path in paths])
        axes.plot(ends[:, 0], ends[:, 1], "o", color=look.types[kind], ms=3.5, mec=look.ink, mew=0.4)
    seconds = max(len(tracks.frames) - 1, 0) * tracks.dt
    axes.set_title(f"{scenario}: paths of learned road users in {seconds:.0f} s (dots: their ends)")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    if learned.any():
        axes.legend(loc="upper right")
    return figure


def draw_density(tracks: Trajectories, ground: GroundPicture) -> Figure:
    """Mean density and mean speed of all road users, learned and background, by place."""
    extent = ground.extent
    side = max(DENSITY_CELL, max(extent[1] - extent[0], extent[3] - extent[2]) / MOST_CELLS)
    edges = [np.arange(extent[k], extent[k + 1] + side, side) for k in (0, 2)]
    # A car moves by 6 m in an interval: it also passed the cells in between.
    begin = np.flatnonzero(np.diff(tracks.track) == 0)
    shares = (np.arange(INTERVAL_PARTS) + 0.5)[:, None] / INTERVAL_PARTS
    x, y = ((v[begin] + shares * (v[begin + 1] - v[begin])).ravel() for v in (tracks.x, tracks.y))
    count = np.histogram2d(x, y, edges)[0] / INTERVAL_PARTS
    speed = np.histogram2d(x, y, edges, weights=np.tile(tracks.speed[begin + 1], INTERVAL_PARTS))[0] / INTERVAL_PARTS
    density = 1000.0 * count / (max(len(tracks.frames) - 1, 1) * side**2)
    height = 6.2 * (extent[3] - extent[2]) / (extent[1] - extent[0])
    figure = Figure(figsize=(15.0, min(max(height, 2.5), 12.0) + 0.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    used = count > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = speed / count
    panels = (
        (left, np.where(used, density, np.nan), "road users per 1000 m², mean over the run", LogNorm(), "cividis"),
        (right, np.where(used, mean, np.nan), "mean speed (m/s)", None, "viridis"),
    )
    for axes, values, label, norm, colours in panels:
        axes.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest", alpha=0.6)
        mesh = axes.pcolormesh(*edges, values.T, norm=norm, cmap=colours)
        figure.colorbar(mesh, ax=axes, label=label, shrink=0.8)
        axes.set_aspect("equal")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    left.set_title(f"Density (cells of {side:.1f} m)", fontsize=10)
    right.set_title("Mean speed, standing road users included", fontsize=10)
    return figure


def draw_space_time(
    tracks: Trajectories, learned: NDArray[np.bool_], ground: GroundPicture, look: Look
) -> Figure | None:
    """All road users along the busiest path, over time, and a map of that path; None where there is none.

    Flat lines stand, steep ones are fast; where a line begins or ends in the middle, a road user
    turned into or off the path.
    """
    corridor = busiest(tracks)
    if corridor is None:
        return None
    place = along(corridor, tracks)
    time = tracks.t0 + tracks.frame * tracks.dt
    figure = Figure(figsize=(15.0, 6.0), layout="constrained")
    axes, beside = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    for k in range(len(tracks.ids)):
        rows = _rows(tracks, k)
        if np.isnan(place[rows]).all():
            continue
        kind = int(tracks.type[k])
        style = {"color": look.types[kind], "lw": 1.1} if learned[k] else {"color": look.own, "lw": 0.7}
        dashes = ("-", "--", ":")[kind]
        axes.plot(time[rows], place[rows], dashes, **style)
    axes.set_xlabel("simulation time (s)")
    axes.set_ylabel("along the path (m)")
    axes.set_ylim(0.0, len(corridor.points))
    handles = [Line2D([], [], color=look.types[k], ls=("-", "--", ":")[k]) for k in range(len(TYPE_NAMES))]
    handles.append(Line2D([], [], color=look.own))
    axes.legend(handles, [*(f"learned {name}" for name in TYPE_NAMES), "SUMO's own"], fontsize=8, loc="upper left")
    axes.set_title("Road users along the busiest path", fontsize=10)
    _draw_way(beside, corridor.points, ground, look)
    return figure


def _draw_way(axes: Axes, points: NDArray[np.float64], ground: GroundPicture, look: Look) -> None:
    axes.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest")
    axes.plot(points[:, 0], points[:, 1], color=look.ink, lw=2.0)
    axes.plot(*points[0], "o", color=look.ink, ms=6)
    axes.annotate("0 m", points[0], textcoords="offset points", xytext=(6, 6), fontsize=9)
    axes.annotate(f"{len(points)} m", points[-1], textcoords="offset points", xytext=(6, 6), fontsize=9)
    axes.set_title("The busiest path", fontsize=10)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _rows(tracks: Trajectories, track: int) -> slice:
    return slice(int(tracks.starts[track]), int(tracks.starts[track + 1]))
