"""Shapes of roads and pavements, and their painting into pixels."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.types import RoadUserType

SHIFT = 6
"""Fractional bits of the coordinates given to OpenCV: 1/64 px."""
ARC_STEPS = 5
"""Straight pieces of a round joint; at usual turns of lane centre lines one would nearly suffice."""


class Surface(IntEnum):
    """Kind of ground; the value of a pixel."""

    NONE = 0
    ROAD = 1
    SIDEWALK = 2
    CROSSING = 3
    CYCLEWAY = 4


OWN_SURFACE = np.zeros((len(RoadUserType), len(Surface)), np.bool_)
"""Which Surface belongs to which RoadUserType (paper, section 3.3): cars use roads, the others both."""
OWN_SURFACE[RoadUserType.CAR, [Surface.ROAD, Surface.CROSSING]] = True
OWN_SURFACE[RoadUserType.BICYCLE, [Surface.ROAD, Surface.CROSSING, Surface.CYCLEWAY, Surface.SIDEWALK]] = True
OWN_SURFACE[RoadUserType.PEDESTRIAN, [Surface.ROAD, Surface.CROSSING, Surface.CYCLEWAY, Surface.SIDEWALK]] = True


@dataclass(frozen=True, eq=False)
class Ribbon:
    """A lane: a centre line with a width. Ends are straight, joints round."""

    surface: Surface
    points: Floats
    """Centre line, (k, 2) in m. Fewer than two different points paint nothing."""
    width: float
    """m."""


@dataclass(frozen=True, eq=False)
class Area:
    """A filled polygon."""

    surface: Surface
    points: Floats
    """Corners, (k, 2) in m, closed implicitly, even-odd where crossing. Fewer than three points paint nothing."""


Shape = Ribbon | Area


@dataclass(frozen=True, eq=False)
class SurfaceShapes:
    """The ground of a scene in paint order: later shapes cover earlier ones. Frame: m, x east, y north."""

    shapes: tuple[Shape, ...]
    levels: Levels = FLAT
    """Where its streets cross on different levels."""


def paint(
    canvas: NDArray[np.uint8],
    shapes: Sequence[Shape],
    x0: float,
    y0: float,
    resolution: float,
    value: int | None = None,
) -> None:
    """Paint shapes into `canvas` (rows, cols), in the given order, with their Surface (or all with `value`).

    The centre of pixel (r, c) lies at x0 + (c + 0.5) / resolution, y0 + (r + 0.5) / resolution (m; resolution in px/m):
    rows grow northwards. A pixel is painted if its centre is covered; along the border OpenCV also paints pixels whose
    centre is up to half a pixel outside, so that neighbouring lanes never leave a gap.
    """
    import cv2  # 16 MiB, which the process that counts and writes does not need

    origin = np.array([x0, y0])

    def to_pixels(points: Floats) -> NDArray[np.int32]:
        pixels: Floats = ((points - origin) * resolution - 0.5) * (1 << SHIFT)
        return np.rint(pixels).astype(np.int32)

    ribbons = [i for i, shape in enumerate(shapes) if isinstance(shape, Ribbon)]
    quads, sectors = _ribbon_polygons([shape for shape in shapes if isinstance(shape, Ribbon)])
    pieces: dict[int, list[NDArray[np.int32]]] = {i: [] for i in ribbons}
    for owners, polygons in (quads, sectors):
        for owner, polygon in zip(owners.tolist(), to_pixels(polygons), strict=True):
            pieces[ribbons[owner]].append(polygon)
    for i, shape in enumerate(shapes):
        colour = int(shape.surface) if value is None else value
        if isinstance(shape, Ribbon):
            # One call per piece: fillPoly on all of them would leave holes where two overlap.
            for polygon in pieces[i]:
                cv2.fillConvexPoly(canvas, polygon, colour, cv2.LINE_8, SHIFT)
        elif len(shape.points) >= 3:
            cv2.fillPoly(canvas, [to_pixels(shape.points)], colour, cv2.LINE_8, SHIFT)


Polygons = tuple[NDArray[np.intp], Floats]
"""Index of the ribbon of each polygon, (m,), and corners, (m, corners, 2) in m."""


def _ribbon_polygons(ribbons: Sequence[Ribbon]) -> tuple[Polygons, Polygons]:
    """The convex pieces of all ribbons: a quad per segment and a sector per joint, on the outer side of the turn."""
    if not ribbons:
        none = np.zeros(0, np.intp)
        return (none, np.zeros((0, 4, 2))), (none, np.zeros((0, ARC_STEPS + 2, 2)))
    owner = np.repeat(np.arange(len(ribbons)), [len(r.points) for r in ribbons])
    points = np.concatenate([np.asarray(r.points, np.float64).reshape(-1, 2) for r in ribbons])
    # Without repeated points, each segment has a direction.
    fresh = np.ones(len(points), np.bool_)
    fresh[1:] = (owner[1:] != owner[:-1]) | (np.abs(np.diff(points, axis=0)).max(axis=1, initial=0.0) > 1e-6)
    owner, points = owner[fresh], points[fresh]
    half = 0.5 * np.array([r.width for r in ribbons])

    start = np.flatnonzero((owner[1:] == owner[:-1]) & (half[owner[1:]] > 0))
    along = points[start + 1] - points[start]
    bearing = np.arctan2(along[:, 1], along[:, 0])
    of = owner[start]
    across = half[of, None] * np.stack([-np.sin(bearing), np.cos(bearing)], axis=1)
    a, b = points[start], points[start + 1]
    quads = np.stack([a - across, b - across, b + across, a + across], axis=1)

    # Joints: consecutive segments of one ribbon. A sector, not a full circle, because a circle near the end of a
    # ribbon would stick out of it.
    joint = np.flatnonzero(of[1:] == of[:-1])
    turn = wrap_angle(bearing[joint + 1] - bearing[joint])
    joint, turn = joint[np.abs(turn) > 1e-3], turn[np.abs(turn) > 1e-3]
    outward = bearing[joint] - np.sign(turn) * 0.5 * np.pi
    angles = outward[:, None] + turn[:, None] * np.linspace(0.0, 1.0, ARC_STEPS + 1)
    centre = points[start[joint] + 1]
    rim = centre[:, None] + half[of[joint], None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
    sectors = np.concatenate([centre[:, None], rim], axis=1)
    return (of, quads), (of[joint], sectors)
