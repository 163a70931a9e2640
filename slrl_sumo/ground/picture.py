"""The ground as a picture, and the colours of pictures."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface, SurfaceShapes, paint

TYPE_COLOURS = ("#D55E00", "#0072B2", "#009E73")
"""Car, bicycle, pedestrian: the palette of Okabe and Ito, distinguishable with colour blindness."""
SURFACE_GREYS = {
    Surface.NONE: (250, 250, 247),
    Surface.ROAD: (205, 205, 205),
    Surface.SIDEWALK: (235, 228, 205),
    Surface.CROSSING: (222, 222, 222),
    Surface.CYCLEWAY: (214, 206, 206),
}
LARGEST_PICTURE = 1600
"""px along the longer side of a map."""


class GroundPicture(NamedTuple):
    """Surfaces as pixels."""

    pixels: NDArray[np.uint8]
    """(rows, cols, 3), row 0 in the south."""
    extent: tuple[float, float, float, float]
    """left, right, bottom, top in m."""

    def fitting(self, longer: float, least: tuple[float, float]) -> tuple[float, float]:
        """Size of a figure in inches for the picture with `longer` inches along its longer side, and its labels."""
        width, height = self.extent[1] - self.extent[0], self.extent[3] - self.extent[2]
        scale = longer / max(width, height)
        return max(width * scale, least[0]) + 1, max(height * scale, least[1]) + 1


def draw_ground(shapes: SurfaceShapes, greys: Mapping[Surface, tuple[int, int, int]] = SURFACE_GREYS) -> GroundPicture:
    """The surfaces as a picture."""
    points = np.concatenate([shape.points for shape in shapes.shapes])
    (x0, y0), (x1, y1) = points.min(axis=0) - 5.0, points.max(axis=0) + 5.0
    resolution = min(4.0, LARGEST_PICTURE / max(x1 - x0, y1 - y0))
    canvas = np.zeros((int((y1 - y0) * resolution) + 1, int((x1 - x0) * resolution) + 1), np.uint8)
    paint(canvas, shapes.shapes, x0, y0, resolution)
    palette = np.array([greys[surface] for surface in Surface], np.uint8)
    extent = (x0, x0 + canvas.shape[1] / resolution, y0, y0 + canvas.shape[0] / resolution)
    return GroundPicture(palette[canvas], extent)
