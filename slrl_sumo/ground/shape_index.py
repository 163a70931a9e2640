"""Index of the shapes that each tile of the ground has to paint."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import Area, Ribbon, Shape
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import MAX_POSITION

MAX_PIECES = 1_000_000
"""Shapes times tiles in which they show; a city of 20 by 30 km covers 36,600 tiles."""


@dataclass(frozen=True, eq=False)
class PieceBoxes:
    """Bounding boxes of shapes: one per area, one per piece of a ribbon; sorted by shape."""

    shape: NDArray[np.intp]
    """Index of the shape, (m,)."""
    low: Floats
    """South-west corner in m, (m, 2)."""
    high: Floats
    """North-east corner in m, (m, 2)."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) of all boxes in m; zeros without boxes."""
        if not len(self.shape):
            return 0.0, 0.0, 0.0, 0.0
        (x0, y0), (x1, y1) = self.low.min(axis=0), self.high.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


def piece_boxes(shapes: Sequence[Shape], longest: float) -> PieceBoxes:
    """The boxes of all shapes.

    Ribbons are cut into pieces of at most `longest` m along x and y, so that a diagonal of kilometres is not in every
    tile of its bounding box.
    """
    kept = [k for k, shape in enumerate(shapes) if len(shape.points)]
    if not kept:
        return PieceBoxes(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 2)))
    points = np.concatenate([shapes[k].points for k in kept])
    if not np.abs(points).max() <= MAX_POSITION:  # also where it is NaN
        raise InputError(f"the ground has points farther than {MAX_POSITION:g} m from the origin, or without position")
    size = np.array([len(shapes[k].points) for k in kept])
    start = np.cumsum(size) - size
    half = np.array([shape.width / 2 if isinstance(shape, Ribbon) else 0.0 for shape in shapes])
    is_area = np.array([isinstance(shape, Area) for shape in shapes])
    owner = np.repeat(kept, size)

    segment = np.flatnonzero((owner[1:] == owner[:-1]) & ~is_area[owner[1:]])
    a, b = points[segment], points[segment + 1]
    count = np.maximum(1, np.ceil(np.abs(b - a).max(axis=1, initial=0.0) / longest)).astype(np.intp)
    _check_count(float(count.sum()))
    which, nth = _repeated(count)
    step = (b - a)[which] / count[which, None]
    p, q = a[which] + step * nth[:, None], a[which] + step * (nth[:, None] + 1)
    of = owner[segment][which]
    reach = half[of, None]

    areas = is_area[kept]
    shape = np.concatenate([of, np.array(kept)[areas]])
    low = np.concatenate([np.minimum(p, q) - reach, np.minimum.reduceat(points, start)[areas]])
    high = np.concatenate([np.maximum(p, q) + reach, np.maximum.reduceat(points, start)[areas]])
    order = np.argsort(shape, kind="stable")
    return PieceBoxes(shape[order], low[order], high[order])


def _check_count(pieces: float) -> None:
    if pieces > MAX_PIECES:
        raise InputError(
            f"the ground is so large that it needs {pieces:.1e} tiles, {MAX_PIECES:.0e} are possible; check "
            "coordinates and widths"
        )


def _repeated(count: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For counts (2, 3): which = (0, 0, 1, 1, 1) and nth = (0, 1, 0, 1, 2)."""
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - (np.cumsum(count) - count)[which]


def index_by_tile(boxes: PieceBoxes, core: float, margin: float) -> dict[tuple[int, int], NDArray[np.intp]]:
    """Shapes (ascending, thus in paint order) that may show in each tile; tiles without shapes are omitted.

    Tile (i, j) covers the square of side `core` (m) from (i, j) * core on and shows `margin` (m) around it.
    """
    if not len(boxes.shape):
        return {}
    reach = margin + 1.0  # a little more than the tile shows, for OpenCV's borders
    first = np.floor((boxes.low - reach) / core).astype(np.int64)
    span = np.floor((boxes.high + reach) / core).astype(np.int64) - first + 1
    _check_count(float(span.prod(axis=1, dtype=np.float64).sum()))
    which, nth = _repeated(span.prod(axis=1))
    column, row = first[which, 0] + nth % span[which, 0], first[which, 1] + nth // span[which, 0]
    order = np.lexsort((column, row))  # stable: shapes stay in ascending order
    column, row, shape = column[order], row[order], boxes.shape[which][order]
    new_tile = np.ones(len(shape), np.bool_)
    new_tile[1:] = (np.diff(column) != 0) | (np.diff(row) != 0)
    kept = new_tile.copy()
    kept[1:] |= np.diff(shape) != 0
    column, row, shape, new_tile = column[kept], row[kept], shape[kept], new_tile[kept]
    starts = np.flatnonzero(new_tile)
    keys = zip(column[starts].tolist(), row[starts].tolist(), strict=True)
    return dict(zip(keys, np.split(shape, starts[1:]), strict=True))
