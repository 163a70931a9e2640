"""What a road user sees: the image of the ground and of the others around it (paper, section 3.1 and Fig. 2)."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.line_raster import CHANNEL, draw_views
from slrl_sumo.scene.geometry import cos_sin
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

EGO_ROWS = 20
EGO_COLS = 40
BEHIND, AHEAD, SIDE = 8.0, 32.0, 10.0
"""What the image shows around the road user, in m; one pixel is one metre."""

FINE = 2
"""Pixels per metre while drawing; averaged 2 x 2 in the end, which smooths the edges."""
THICKNESS = np.array([2, 3, 5, 7])
"""Line thicknesses that differ; 4 px draws what 3 px does. 1 px is left out: too faint for pedestrians."""
DRAWN_WIDTH = np.array([2.9, 4.7, 6.6, 8.3])
"""How wide lines of these thicknesses really are, in px (mean over directions and sub-pixel places)."""
WIDTH_BOUNDS = (DRAWN_WIDTH[1:] + DRAWN_WIDTH[:-1]) / 2
"""Widths of boxes (px) from which on the next thickness is nearer."""
CUT = 4.5
"""Lines are cut this many rows outside their view, from where the thickest one just does not show."""
MIN_LENGTH = 1.0
"""Boxes are drawn at least this long (m), so that pedestrians are seen."""
VIEWS_AT_ONCE = 128
"""Views that are drawn before they are made small: as many as the processor's cache holds."""

PAINT = 8
"""Value of road user type 0 in a view; the values below are those of Surface."""
PAPER_PALETTE: NDArray[np.uint8] = np.zeros((256, 1, 3), np.uint8)
"""RGB of each value. The paper knows neither crossings nor cycle lanes: both are road."""
PAPER_PALETTE[[1, 3, 4]] = 255, 255, 255
PAPER_PALETTE[2] = 255, 255, 0
PAPER_PALETTE[PAINT + RoadUserType.CAR] = 255, 0, 0
PAPER_PALETTE[PAINT + RoadUserType.BICYCLE] = 0, 0, 255
PAPER_PALETTE[PAINT + RoadUserType.PEDESTRIAN] = 0, 255, 0
PATH = 7
"""Value of the path ahead."""
EXTENDED_PALETTE = PAPER_PALETTE.copy()
"""The same, with colours for crossings (grey), cycle lanes (cyan) and the path (magenta)."""
EXTENDED_PALETTE[3] = 160, 160, 160
EXTENDED_PALETTE[4] = 0, 255, 255
EXTENDED_PALETTE[PATH] = 255, 0, 255
PATH_THICKNESS = 2
"""px: a metre."""
VALUES = PAINT + len(RoadUserType)


def _channels(palette: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """The colours of all VALUES, one number each."""
    return np.asarray(palette[:VALUES, 0].astype(np.uint32) @ (1 << CHANNEL * np.arange(3, dtype=np.uint32)), np.uint32)


PAPER_COLOURS, EXTENDED_COLOURS = _channels(PAPER_PALETTE), _channels(EXTENDED_PALETTE)


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
    rows = np.ascontiguousarray(rows, np.intp)
    columns = (world.x, world.y, *cos_sin(world.heading), world.length, world.width)
    x, y, cos, sin, length, width = (np.ascontiguousarray(column, np.float64) for column in columns)
    # Cars first: whoever is vulnerable is never hidden. Within a type along the longer side of the scene, so that few
    # have to be looked at for a view.
    by_x = bool(np.ptp(x) >= np.ptp(y))
    order = np.lexsort((x if by_x else y, world.type))
    groups = np.searchsorted(world.type[order], np.arange(len(RoadUserType) + 1))
    way = RouteAhead.unknown(len(rows)) if route is None else route
    path_x, path_y = (np.ascontiguousarray(column, np.float64) for column in (way.x, way.y))
    window = BEHIND, AHEAD, SIDE, float(FINE), CUT
    look = PATH, PATH_THICKNESS, PAINT, MIN_LENGTH, float(DRAWN_WIDTH[-1]) / FINE
    colours = PAPER_COLOURS if route is None else EXTENDED_COLOURS
    for start in range(0, len(rows), VIEWS_AT_ONCE):
        some = slice(start, start + VIEWS_AT_ONCE)
        egos = rows[some]
        views = roadmap.ego_surfaces(
            x[egos], y[egos], world.heading[egos], behind=BEHIND, ahead=AHEAD, side=SIDE, resolution=FINE
        )
        draw_views(
            views,
            images[some],
            egos,
            (x, y, cos, sin, length, width),
            (order, groups, by_x),
            (way.known[some], path_x[some], path_y[some], HERE),
            window,
            look,
            (WIDTH_BOUNDS, THICKNESS),
            colours,
        )
    return images


def ego_picture(image: NDArray[np.uint8], scale: int = 10) -> NDArray[np.uint8]:
    """One ego image enlarged for people, (rows * scale, cols * scale, 3): every pixel becomes a square."""
    return image.repeat(scale, axis=0).repeat(scale, axis=1)
