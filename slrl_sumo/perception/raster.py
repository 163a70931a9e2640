"""What a road user sees: the image of the ground and of the others around it (paper, section 3.1 and Fig. 2)."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.world.geometry import Floats, cos_sin, to_ego
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.route import HERE, RouteAhead
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import RoadUserType

EGO_ROWS = 20
EGO_COLS = 40
BEHIND, AHEAD, SIDE = 8.0, 32.0, 10.0
"""What the image shows around the road user, in m; one pixel is one metre."""

FINE = 2
"""Pixels per metre while drawing; averaged 2 x 2 in the end, which smooths the edges."""
ROWS, COLS = EGO_ROWS * FINE, EGO_COLS * FINE
THICKNESS = np.array([2, 3, 5, 7])
"""Line thicknesses that differ in OpenCV; 4 px draws what 3 px does. 1 px is left out: too faint for pedestrians."""
DRAWN_WIDTH = np.array([2.9, 4.7, 6.6, 8.3])
"""How wide OpenCV really draws lines of these thicknesses, in px (mean over directions and sub-pixel places)."""
CUT = 4.5
"""Lines are cut this many rows outside their view, from where the thickest one just does not show."""
GAP = 10
"""Rows above and below every view: more than CUT and half the thickest line. So nobody shows in the next view, and
OpenCV never clips at the ends of the canvas: an image does not depend on its place in the batch."""
STRIDE = GAP + ROWS
MIN_LENGTH = 1.0
"""Boxes are drawn at least this long (m), so that pedestrians are seen."""
SHIFT = 4
"""Fractional bits of the coordinates given to OpenCV: 1/16 px."""
VIEWS_AT_ONCE = 1024
"""Views on one canvas, to bound the memory (16 MB)."""

PAINT = 8
"""Canvas value of road user type 0; the values below are those of Surface."""
PAPER_PALETTE: NDArray[np.uint8] = np.zeros((256, 1, 3), np.uint8)
"""RGB of each canvas value. The paper knows neither crossings nor cycle lanes: both are road."""
PAPER_PALETTE[[1, 3, 4]] = 255, 255, 255
PAPER_PALETTE[2] = 255, 255, 0
PAPER_PALETTE[PAINT + RoadUserType.CAR] = 255, 0, 0
PAPER_PALETTE[PAINT + RoadUserType.BICYCLE] = 0, 0, 255
PAPER_PALETTE[PAINT + RoadUserType.PEDESTRIAN] = 0, 255, 0
PATH = 7
"""Canvas value of the path ahead."""
EXTENDED_PALETTE = PAPER_PALETTE.copy()
"""The same, with colours for crossings (grey), cycle lanes (cyan) and the path (magenta)."""
EXTENDED_PALETTE[3] = 160, 160, 160
EXTENDED_PALETTE[4] = 0, 255, 255
EXTENDED_PALETTE[PATH] = 255, 0, 255
PATH_THICKNESS = 2
"""px: a metre."""


def ego_images(
    world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap, route: RouteAhead | None = None
) -> NDArray[np.uint8]:
    """The images of the road users `rows` of `world`, (len(rows), EGO_ROWS, EGO_COLS, 3) RGB.

    The ego is at a fixed place, 8 m from the left border and half-way up, and looks right; row 0 is the far left.
    Ground in its colours, black outside. Everybody is a line along its heading, as long and about as wide as its box
    (at least 1 m): cars red, cyclists blue, pedestrians green, later ones on top. The ego itself is drawn too.
    With their `route` the path ahead lies under the road users, and crossings and cycle lanes have their own colours.
    """
    images = np.empty((len(rows), EGO_ROWS, EGO_COLS, 3), np.uint8)
    if len(rows) == 0:
        return images
    reach = (np.maximum(world.length, MIN_LENGTH) + DRAWN_WIDTH[-1] / FINE) / 2
    everyone = cKDTree(np.stack([world.x, world.y], axis=1))
    for start in range(0, len(rows), VIEWS_AT_ONCE):
        chunk = rows[start : start + VIEWS_AT_ONCE]
        # Views below one another, a gap before each and after the last.
        canvas = np.zeros((len(chunk) * STRIDE + GAP, COLS), np.uint8)
        roadmap.ego_surfaces(
            world.x[chunk],
            world.y[chunk],
            world.heading[chunk],
            behind=BEHIND,
            ahead=AHEAD,
            side=SIDE,
            resolution=FINE,
            out=_views(canvas),
        )
        if route is not None:
            _draw_paths(canvas, world, chunk, route.take(np.arange(start, start + len(chunk))))
        _draw_road_users(canvas, world, chunk, everyone, reach)
        colours = cv2.applyColorMap(canvas, PAPER_PALETTE if route is None else EXTENDED_PALETTE)
        size = EGO_COLS, len(canvas) // FINE
        small = np.asarray(cv2.resize(colours, size, interpolation=cv2.INTER_AREA), np.uint8)
        images[start : start + len(chunk)] = _views(small, FINE)
    return images


def _views(canvas: NDArray[np.uint8], shrunk: int = 1) -> NDArray[np.uint8]:
    """The views on a canvas that was made smaller by `shrunk`, (n, rows, cols, ...), sharing its memory."""
    gap, stride = GAP // shrunk, STRIDE // shrunk
    return canvas[:-gap].reshape(-1, stride, *canvas.shape[1:])[:, gap:]


def _draw_paths(canvas: NDArray[np.uint8], world: WorldState, rows: NDArray[np.intp], route: RouteAhead) -> None:
    """Draw the paths of the road users `rows` that have a route, each into its own view of the canvas."""
    known = np.flatnonzero(route.known)
    ego = rows[known]
    dx, dy = route.x[known, HERE:] - world.x[ego, None], route.y[known, HERE:] - world.y[ego, None]
    x, y = to_ego(dx, dy, world.heading[ego, None])
    # A path that leaves the view goes on beside it, in the gap.
    y = np.clip(y, -SIDE - 1.5, SIDE + 1.5)
    points = np.stack([(x + BEHIND) * FINE - 0.5, (SIDE - y) * FINE - 0.5], axis=-1)
    corners = np.rint(points * (1 << SHIFT)).astype(np.int32)
    corners[:, :, 1] += ((GAP + known * STRIDE) << SHIFT).astype(np.int32)[:, None]
    cv2.polylines(canvas, list(corners), False, PATH, PATH_THICKNESS, cv2.LINE_8, SHIFT)


def _draw_road_users(
    canvas: NDArray[np.uint8], world: WorldState, rows: NDArray[np.intp], everyone: cKDTree, reach: Floats
) -> None:
    """Draw all that the road users `rows` see, each into its own view of the canvas."""
    cos, sin = cos_sin(world.heading)
    # Search round the middle of the views, not round the egos: a third of the area.
    middle = (AHEAD - BEHIND) / 2
    centres = np.stack([world.x[rows] + middle * cos[rows], world.y[rows] + middle * sin[rows]], axis=1)
    radius = np.hypot((AHEAD + BEHIND) / 2, SIDE) + reach.max()
    pairs = cKDTree(centres).sparse_distance_matrix(everyone, radius, output_type="ndarray")
    view, seen = pairs["i"], pairs["j"]
    ego = rows[view]
    x, y = to_ego(world.x[seen] - world.x[ego], world.y[seen] - world.y[ego], world.heading[ego])
    visible = (np.abs(x - middle) < (AHEAD + BEHIND) / 2 + reach[seen]) & (np.abs(y) < SIDE + reach[seen])
    view, seen, ego, x, y = view[visible], seen[visible], ego[visible], x[visible], y[visible]

    nearest = np.searchsorted((DRAWN_WIDTH[1:] + DRAWN_WIDTH[:-1]) / 2, world.width[seen] * FINE)
    thickness = THICKNESS[nearest]
    # Thick lines have round caps, which add half the thickness at both ends.
    half = np.maximum((np.maximum(world.length[seen], MIN_LENGTH) * FINE - thickness) / 2, 0.0)
    turn_cos = cos[seen] * cos[ego] + sin[seen] * sin[ego]
    turn_sin = sin[seen] * cos[ego] - cos[seen] * sin[ego]
    col, row = (x + BEHIND) * FINE - 0.5, (SIDE - y) * FINE - 0.5
    step_col, step_row = half * turn_cos, -half * turn_sin

    # Where, from -1 to 1 along itself, a line enters and leaves the rows within which it is drawn.
    slope = np.where(np.abs(step_row) < 1e-9, 1e-9, step_row)
    ends = np.stack([(-0.5 - CUT - row) / slope, (ROWS - 0.5 + CUT - row) / slope])
    first, last = np.clip(ends.min(axis=0), -1, 1), np.clip(ends.max(axis=0), -1, 1)
    lines = np.empty((len(view), 2, 2))
    for k, at in enumerate((first, last)):
        lines[:, k, 0] = col + at * step_col
        lines[:, k, 1] = row + at * step_row
    corners = np.rint(lines * (1 << SHIFT)).astype(np.int32)
    corners[:, :, 1] += ((GAP + view * STRIDE) << SHIFT).astype(np.int32)[:, None]

    kind = world.type[seen]
    for user in RoadUserType:  # cars first: whoever is vulnerable is never hidden
        for width in np.unique(thickness[kind == user]).tolist():
            chosen = corners[(kind == user) & (thickness == width) & (first < last)]
            cv2.polylines(canvas, list(chosen), False, PAINT + int(user), width, cv2.LINE_8, SHIFT)


def ego_picture(image: NDArray[np.uint8], scale: int = 10) -> NDArray[np.uint8]:
    """One ego image enlarged for people, (rows * scale, cols * scale, 3): every pixel becomes a square."""
    return image.repeat(scale, axis=0).repeat(scale, axis=1)
