"""Pictures of a run: where everybody went, and what some road users saw."""

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.simulation.events import Decision, Event, Started, Views
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.surfaces import Surface, SurfaceShapes, paint
from slrl_sumo.world.types import TYPE_NAMES

TYPE_COLOURS = ("#D55E00", "#0072B2", "#009E73")
"""Car, bicycle, pedestrian: Okabe and Ito's palette, which the colour-blind can tell apart."""
SURFACE_GREYS = {
    Surface.NONE: (250, 250, 247),
    Surface.ROAD: (205, 205, 205),
    Surface.SIDEWALK: (235, 228, 205),
    Surface.CROSSING: (222, 222, 222),
    Surface.CYCLEWAY: (214, 206, 206),
}
LARGEST_PICTURE = 1600
"""px along the longer side of a map."""


class ReportBuilder:
    """Collects what the pictures need while a run goes on, then writes them."""

    def __init__(self, started: Started) -> None:
        self._started = started
        self._kinds: dict[str, int] = {}
        self._paths: dict[str, list[tuple[float, float]]] = {}
        self._views: list[Views] = []
        self._seconds = 0.0
        world = started.step.world
        self._extend(world, int(world.learned.sum()), np.zeros(len(world), np.bool_))

    def add(self, event: Event) -> None:
        """Take the positions of a decision, or images of what some road users see."""
        if isinstance(event, Views):
            self._views.append(event)
        elif isinstance(event, Decision):
            step = event.steps[-1]
            self._seconds = step.time - self._started.begin
            self._extend(step.world, len(event.surface), event.looped)

    def _extend(self, world: WorldState, count: int, looped: NDArray[np.bool_]) -> None:
        for row in range(count):
            path = self._paths.setdefault(world.ids[row], [])
            self._kinds[world.ids[row]] = int(world.type[row])
            # A jump to the other side is not a way that somebody went: the line is cut there.
            if looped[row]:
                path.append((np.nan, np.nan))
            path.append((float(world.x[row]), float(world.y[row])))

    def write(self, folder: Path) -> None:
        """Write paths.png and, if views were taken, ego_images.png into `folder`, which is created."""
        try:
            folder.mkdir(exist_ok=True)
            self._draw_paths().savefig(folder / "paths.png", dpi=110)
            if self._views:
                self._draw_views().savefig(folder / "ego_images.png", dpi=110)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written ({error.strerror}); name another folder") from None

    def _draw_paths(self) -> Figure:
        ground, extent = draw_ground(self._started.surfaces)
        width, height = extent[1] - extent[0], extent[3] - extent[2]
        scale = 11.0 / max(width, height)
        figure = Figure(figsize=(max(width * scale, 5.0) + 1, max(height * scale, 4.0) + 1), layout="constrained")
        axes = figure.subplots()
        axes.imshow(ground, origin="lower", extent=extent, interpolation="nearest")
        for kind, name in enumerate(TYPE_NAMES):
            paths = [np.array(path) for user, path in self._paths.items() if self._kinds[user] == kind]
            if not paths:
                continue
            lines = LineCollection(paths, colors=TYPE_COLOURS[kind], linewidths=0.8, alpha=0.8)
            lines.set_label(f"{name} ({len(paths)})")
            axes.add_collection(lines)
            ends = np.array([path[-1] for path in paths])
            axes.plot(ends[:, 0], ends[:, 1], "o", color=TYPE_COLOURS[kind], ms=3.5, mec="black", mew=0.4)
        axes.set_title(
            f"{self._started.scenario}: paths of learned road users in {self._seconds:.0f} s (dots: their ends)"
        )
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
        if self._paths:
            axes.legend(loc="upper right")
        return figure

    def _draw_views(self) -> Figure:
        rows = max(len(views.ids) for views in self._views)
        figure = Figure(figsize=(4.2 * len(self._views), 2.6 * rows), layout="constrained")
        grid = figure.subplots(rows, len(self._views), squeeze=False)
        for axes in grid.flat:
            axes.set_visible(False)
        for column, views in enumerate(self._views):
            for row, road_user in enumerate(views.ids):
                axes = grid[row, column]
                axes.set_visible(True)
                # The image's first row is the left side; 8 m behind to 32 m ahead.
                axes.imshow(views.images[row], extent=(-8, 32, -10, 10), interpolation="nearest")
                axes.set_title(f"{road_user} at {views.time:.1f} s", fontsize=9)
                axes.set_xlabel("ahead (m)", fontsize=8)
                axes.set_ylabel("left (m)", fontsize=8)
        return figure


def draw_ground(shapes: SurfaceShapes) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """The surfaces as a picture (rows, cols, 3), row 0 in the south, and its extent (left, right, bottom, top) in m."""
    points = np.concatenate([shape.points for shape in shapes.shapes])
    (x0, y0), (x1, y1) = points.min(axis=0) - 5.0, points.max(axis=0) + 5.0
    resolution = min(4.0, LARGEST_PICTURE / max(x1 - x0, y1 - y0))
    canvas = np.zeros((int((y1 - y0) * resolution) + 1, int((x1 - x0) * resolution) + 1), np.uint8)
    paint(canvas, shapes.shapes, x0, y0, resolution)
    palette = np.array([SURFACE_GREYS[surface] for surface in Surface], np.uint8)
    extent = (x0, x0 + canvas.shape[1] / resolution, y0, y0 + canvas.shape[0] / resolution)
    return palette[canvas], extent
