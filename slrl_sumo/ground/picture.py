"""The ground as a picture, and the colours of pictures."""

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
