"""Picture of the paths of some cars over the lanes, coloured by speed."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from slrl_sumo.ground.picture import draw_ground
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES

MOST = 10
"""Cars in a picture."""
LEAST_STEPS = 25
"""Shortest path of a car, decisions, where enough cars have one."""
WINDOW = 70.0
"""Half the side of the close-up, m."""
AROUND = 8.0
CENTRE_LINE, RIM = "#ffffff", "#9a9a9a"


def choose_paths(paths: Mapping[str, Sequence[tuple[float, float, float]]], seed: int) -> dict[str, Floats]:
    """Ten cars drawn by `seed` among those with a path of some length, by id: x, y (m) and speed (m/s), (k, 3)."""
    ids = sorted(car for car, path in paths.items() if len(path) >= LEAST_STEPS) or sorted(paths)
    drawn = np.random.default_rng(seed).permutation(len(ids))[:MOST]
    return {ids[i]: np.array(paths[ids[i]], np.float64) for i in sorted(drawn.tolist())}


def draw_paths(network: Network, paths: Mapping[str, Floats], title: str, file: Path) -> None:
    """Write a PNG: the whole path of each car, and a close-up of the place with the most positions.

    `paths`: by id, rows of x, y (m) and speed (m/s), (k, 3), one per 0.4 s, each drawn as a dot. Without paths no file
    is written.
    """
    if not paths:
        return
    points = np.concatenate(list(paths.values()))
    low, high = points[:, :2].min(axis=0) - AROUND, points[:, :2].max(axis=0) + AROUND
    high = np.maximum(high, low + 2.0 * AROUND)
    middle = _busiest(points[:, :2])
    fastest = max(float(points[:, 2].max()), 1.0)
    width, height = high - low
    figure = Figure(figsize=(20.0, 10.5), layout="constrained")
    grid = figure.subplots(1, 2, width_ratios=(min(max(width / height, 0.5), 1.0), 1.0))
    for axes in grid:
        _draw_lanes(axes, network)
    _draw_cars(grid[0], paths, fastest, dot=5.0)
    lines = _draw_cars(grid[1], paths, fastest, dot=14.0)
    grid[0].set_xlim(low[0], high[0])
    grid[0].set_ylim(low[1], high[1])
    grid[1].set_xlim(middle[0] - WINDOW, middle[0] + WINDOW)
    grid[1].set_ylim(middle[1] - WINDOW, middle[1] + WINDOW)
    frame = Rectangle(
        (middle[0] - WINDOW, middle[1] - WINDOW), 2 * WINDOW, 2 * WINDOW, fill=False, ec="black", lw=0.8, ls=":"
    )
    grid[0].add_patch(frame)
    grid[0].set_title(f"{title}: {len(paths)} cars (triangle: start, cross: end)")
    grid[1].set_title("the place with most positions; a dot every 0.4 s")
    for axes in grid:
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    figure.colorbar(lines, ax=grid[1], label="speed (m/s)", shrink=0.7)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)


def _draw_lanes(axes: Axes, network: Network) -> None:
    ground, extent = draw_ground(network.surfaces())
    axes.imshow(ground, origin="lower", extent=extent, interpolation="nearest")
    lanes = [lane for lane in network.lanes if lane.allowed & MOTOR_CLASSES and len(lane.shape) > 1]
    inside, outside = ([lane for lane in lanes if lane.internal is internal] for internal in (True, False))
    axes.add_collection(LineCollection([lane.shape for lane in inside], colors=CENTRE_LINE, lw=0.5, ls=":"))
    axes.add_collection(LineCollection([lane.shape for lane in outside], colors=CENTRE_LINE, lw=0.9))
    rims = [beside(lane.shape, side * 0.5 * lane.width) for lane in outside for side in (-1.0, 1.0)]
    axes.add_collection(LineCollection(rims, colors=RIM, lw=0.6))
    axes.set_aspect("equal")


def _draw_cars(axes: Axes, paths: Mapping[str, Floats], fastest: float, dot: float) -> LineCollection:
    pieces = np.concatenate([np.stack([p[:-1, :2], p[1:, :2]], axis=1) for p in paths.values()])
    speeds = np.concatenate([p[1:, 2] for p in paths.values()])
    lines = LineCollection(list(pieces), cmap="viridis", lw=1.1, alpha=0.9)
    lines.set_array(speeds)
    lines.set_clim(0.0, fastest)
    axes.add_collection(lines)
    points = np.concatenate(list(paths.values()))
    axes.scatter(points[:, 0], points[:, 1], c=points[:, 2], s=dot, cmap="viridis", vmin=0.0, vmax=fastest, zorder=3)
    for path in paths.values():
        axes.plot(*path[0, :2], "^", color="white", mec="black", ms=6, zorder=4)
        axes.plot(*path[-1, :2], "x", color="#D55E00", ms=7, mew=2, zorder=4)
    return lines


def _busiest(points: Floats) -> Floats:
    """The point (2,) with the most different places of `points` (k, 2) in its window; standing counts once."""
    places = np.unique(np.round(points / 2.0), axis=0) * 2.0
    # A few hundred places are enough to choose from.
    choice = places[:: max(1, len(places) // 300)]
    near = (np.abs(choice[:, None] - places[None]) <= WINDOW).all(axis=2).sum(axis=1)
    best = choice[near == near.max()]
    return np.asarray(best.mean(axis=0) if len(best) == 1 else best[len(best) // 2])


def beside(line: Floats, offset: float) -> Floats:
    """The polyline `line` (k, 2) shifted `offset` m to its left."""
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return np.column_stack([line[:, 0] - offset * along[:, 1], line[:, 1] + offset * along[:, 0]])
