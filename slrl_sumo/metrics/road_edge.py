"""Distances of road users from the edge of their own surfaces."""

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import OWN_SURFACE, SurfaceShapes, paint
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

FINEST = 4.0
"""Finest resolution, px/m."""
MOST_PIXELS = 16 * 2**20
GROUND_MARGIN = 10.0
"""Extent (m) of the ground around the positions; edges farther away count as at this distance."""


def edge_distance(*, shapes: SurfaceShapes, x: Floats, y: Floats, kind: NDArray[np.int8]) -> Floats:
    """Signed distance of centres to the nearest edge of their type's own surfaces, m, (n,): negative on them.

    `x`, `y`: m; `kind`: RoadUserType, (n,). Own surfaces: see `ground.surfaces.OWN_SURFACE`; road and crossings for
    cars, all surfaces for other types. The sign is that of the distance to the road edge of Waymo Sim Agents. The error
    is about a pixel: 0.25 m, more if the positions span more than 1 km².
    """
    distance = np.zeros(len(x))
    if not len(x):
        return distance
    x0, y0, x1, y1 = x.min() - GROUND_MARGIN, y.min() - GROUND_MARGIN, x.max() + GROUND_MARGIN, y.max() + GROUND_MARGIN
    resolution = min(FINEST, float(np.sqrt(MOST_PIXELS / ((x1 - x0) * (y1 - y0)))))
    canvas = np.zeros((int((y1 - y0) * resolution) + 1, int((x1 - x0) * resolution) + 1), np.uint8)
    paint(canvas, shapes.shapes, x0, y0, resolution)
    row, col = ((y - y0) * resolution).astype(np.intp), ((x - x0) * resolution).astype(np.intp)
    for road_user_type in RoadUserType:
        mine = np.flatnonzero(kind == road_user_type)
        if not len(mine):
            continue
        own = OWN_SURFACE[road_user_type][canvas].astype(np.uint8)
        pixels = _outside(1 - own)[row[mine], col[mine]] - _outside(own)[row[mine], col[mine]]
        distance[mine] = pixels / resolution
    return distance


def _outside(mask: NDArray[np.uint8]) -> Floats:
    """Distance (px) of the centre of each pixel of `mask` to the border of the other pixels; 0 outside the mask."""
    if mask.all():  # no border: the largest distance
        return np.full(mask.shape, GROUND_MARGIN * FINEST)
    apart = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float64)
    return np.where(mask > 0, apart - 0.5, 0.0)
