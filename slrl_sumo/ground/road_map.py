"""The ground of a scene as pixels, in tiles that are painted when a road user comes near."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.shape_index import index_by_tile, piece_boxes
from slrl_sumo.ground.surfaces import OWN_SURFACE, Area, Ribbon, Shape, Surface, SurfaceShapes, paint
from slrl_sumo.ground.tiles import Ids, Tiles
from slrl_sumo.scene.geometry import Floats

__all__ = ["Area", "Ribbon", "RoadMap", "Surface", "SurfaceShapes"]

CORE = 128.0
"""Side of the square that one tile covers, in m."""
TILE_MARGIN = 48.0
"""m painted around the core of a tile: the ego view (33.5 m) of any position in the core lies within one tile."""
TILE_MEMORY = 128 * 2**20
"""Bytes: 334 tiles."""
CIRCLE = np.arange(16.0) * (np.pi / 8.0)
"""Directions (rad) in which a surface near a point is searched."""
SCENE_MARGIN = 10.0
"""Distance (m) from all surfaces beyond which road users have left the scene."""
NEAR_CELL = 2.0
"""Cell size (m) of the occupancy grid; larger if the scene would need more than MAX_CELLS cells."""
MAX_CELLS = 16 * 2**20


class RoadMap:
    """Surface ids of a whole network as pixels (rows grow northwards), in square tiles of bounded total memory.

    Tiles are painted on demand and the least recently used ones are dropped: a map takes time only where road users
    are, and at most `memory_limit` bytes (at least one tile is kept).
    """

    def __init__(
        self,
        shapes: SurfaceShapes,
        *,
        resolution: float = 4.0,
        core: float = CORE,
        margin: float = TILE_MARGIN,
        memory_limit: int = TILE_MEMORY,
    ) -> None:
        """`resolution` in px/m; `core` and `margin` of a tile in m; `memory_limit` in bytes."""
        self.shapes = shapes
        self.resolution = resolution
        self.core = core
        self.margin = margin
        self.memory_limit = memory_limit
        boxes = piece_boxes(shapes.shapes, core)
        self.bounds: tuple[float, float, float, float] = boxes.bounds
        """(x0, y0, x1, y1) of all shapes in m; zeros without shapes."""
        self._tiles = Tiles(
            shapes,
            index_by_tile(boxes, core, margin),
            resolution=resolution,
            core=core,
            margin=margin,
            memory_limit=memory_limit,
        )
        self._near_cell, self._near = _occupancy(shapes.shapes, self.bounds)

    @property
    def resident_bytes(self) -> int:
        """Memory of the present painted tiles."""
        return self._tiles.resident_bytes

    def surface_at(self, x: Floats, y: Floats) -> Ids:
        """Surface under each point (m), (n,); NONE outside everything."""
        return self._tiles.at(x, y)

    def beyond_own_surface(
        self, kind: NDArray[np.int8], x: Floats, y: Floats, margin: float, circle: Floats = CIRCLE
    ) -> NDArray[np.bool_]:
        """Whether each point (m) is more than `margin` m off the own surfaces of a road user of this type, (n,).

        `kind`: RoadUserType, (n,). The own surface is looked for at the point and on a circle of that radius, in the
        directions `circle` (rad).
        """
        beyond = ~OWN_SURFACE[kind, self.surface_at(x, y)]
        rows = np.flatnonzero(beyond)
        if len(rows):
            around = x[rows, None] + margin * np.cos(circle), y[rows, None] + margin * np.sin(circle)
            found = self.surface_at(*(places.ravel() for places in around)).reshape(len(rows), -1)
            beyond[rows] = ~OWN_SURFACE[kind[rows, None], found].any(axis=1)
        return beyond

    def near_surface(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Whether any surface lies near each point (m), (n,): True up to 10 m, False beyond 20 m.

        In between it depends on the grid; that range grows on scenes above about 50 km².
        """
        rows, cols = self._near.shape
        reach = _near_reach(self._near_cell)
        col = np.floor((x - self.bounds[0] + reach) / self._near_cell)
        row = np.floor((y - self.bounds[1] + reach) / self._near_cell)
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        near = np.zeros(len(x), np.bool_)
        near[inside] = self._near[row[inside].astype(np.intp), col[inside].astype(np.intp)] > 0
        return near

    def ego_surfaces(
        self,
        x: Floats,
        y: Floats,
        heading: Floats,
        *,
        behind: float,
        ahead: float,
        side: float,
        resolution: float,
    ) -> Ids:
        """Crops of the ground around each road user, (n, rows, cols) Surface ids.

        The view reaches `behind`, `ahead` and to each `side` (m) of positions `x`, `y` (m). `heading` (rad) points to
        the right of the crop; row 0 is the far left. `resolution` in px/m; the nearest pixel counts. Raises ValueError
        if the view may reach beyond the margin of a tile.
        """
        if math.hypot(max(behind, ahead), side) + 1.0 > self.margin:
            raise ValueError(f"the ego view reaches beyond the tile margin of {self.margin} m")
        rows, cols = round(2 * side * resolution), round((behind + ahead) * resolution)
        crops = np.empty((len(x), rows, cols), np.uint8)
        self._tiles.views(x, y, heading, (0.5 / resolution - behind, side - 0.5 / resolution), 1.0 / resolution, crops)
        return crops


def _near_reach(cell: float) -> float:
    """m by which the mark of a shape on the occupancy grid exceeds it, and the grid exceeds the bounds.

    SCENE_MARGIN, and two cells for the positions of the point and of the border within their cells.
    """
    return SCENE_MARGIN + 2 * cell


def _occupancy(shapes: Sequence[Shape], bounds: tuple[float, float, float, float]) -> tuple[float, Ids]:
    """Cell size (m) and the grid of cells near some surface; its corner lies `_near_reach` outside the bounds."""
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    cell = max(NEAR_CELL, math.sqrt((width + 4 * SCENE_MARGIN) * (height + 4 * SCENE_MARGIN) / MAX_CELLS))
    reach = _near_reach(cell)
    size = (math.ceil((height + 2 * reach) / cell), math.ceil((width + 2 * reach) / cell))
    grid = np.zeros(size, np.uint8)
    paint(grid, shapes, bounds[0] - reach, bounds[1] - reach, 1 / cell, value=1)
    radius = math.ceil(reach / cell)
    offset = np.arange(-radius, radius + 1)
    disc = (np.square(offset)[:, None] + np.square(offset) <= radius**2).astype(np.uint8)
    cv2.dilate(grid, disc, dst=grid)
    return cell, grid
