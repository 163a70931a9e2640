"""The ego image: the ground and the other road users around a road user (paper, section 3.1 and Fig. 2)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.line_raster import EDGE, SIXTEENTHS, draw_lines
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, cos_sin
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

EGO_ROWS = 20
EGO_COLS = 40
BEHIND, AHEAD, SIDE = 8.0, 32.0, 10.0
"""Extent (m) of the image behind, ahead of and to each side of the ego; one pixel is one metre."""

FINE = 2
"""Pixels per metre while drawing; the final mean of 2 x 2 pixels smooths the edges."""
THICKNESS = np.array([2, 3, 5, 7])
"""Thicknesses of lines; 4 px draws the same as 3 px, and 1 px is too faint for pedestrians."""
DRAWN_WIDTH = np.array([2.9, 4.7, 6.6, 8.3])
"""Drawn width of these lines in px (mean over directions and sub-pixel positions)."""
WIDTH_BOUNDS = (DRAWN_WIDTH[1:] + DRAWN_WIDTH[:-1]) / 2
"""Widths of boxes (px) above which the next thickness is nearer."""
WIDEST = float(DRAWN_WIDTH[-1]) / FINE
"""Drawn width (m) of the thickest line."""
CUT = 4.5
"""Number of rows outside the view at which lines are cut, where even the thickest line is invisible."""
MIN_LENGTH = 1.0
"""Least drawn length (m) of boxes, so that pedestrians are visible."""
VIEWS_AT_ONCE = 128
"""Number of views that are drawn together; these fit into the processor cache."""

PAINT = 8
"""Value of road user type 0 in a view; the values below are those of Surface."""
PAPER_PALETTE: NDArray[np.uint8] = np.zeros((256, 1, 3), np.uint8)
"""RGB of each value. In the paper, crossings and cycle lanes are road."""
PAPER_PALETTE[[1, 3, 4]] = 255, 255, 255
PAPER_PALETTE[2] = 255, 255, 0
PAPER_PALETTE[PAINT + RoadUserType.CAR] = 255, 0, 0
PAPER_PALETTE[PAINT + RoadUserType.BICYCLE] = 0, 0, 255
PAPER_PALETTE[PAINT + RoadUserType.PEDESTRIAN] = 0, 255, 0
PATH = 7
"""Value of the path ahead."""
EXTENDED_PALETTE = PAPER_PALETTE.copy()
"""RGB of each value, with colours for crossings (grey), cycle lanes (cyan) and the path (magenta)."""
EXTENDED_PALETTE[3] = 160, 160, 160
EXTENDED_PALETTE[4] = 0, 255, 255
EXTENDED_PALETTE[PATH] = 255, 0, 255
PATH_THICKNESS = 2
"""Thickness (px) of the path: one metre."""
VALUES = PAINT + len(RoadUserType)
CHANNEL = 10
"""Bits of a colour channel in the sum of four pixels."""
LINES = 256
"""Number of lines that are drawn in one call: numba counts references to the canvas in every function that takes it."""


def _channels(palette: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """The colours of all VALUES, packed into one number each."""
    return np.asarray(palette[:VALUES, 0].astype(np.uint32) @ (1 << CHANNEL * np.arange(3, dtype=np.uint32)), np.uint32)


PAPER_COLOURS, EXTENDED_COLOURS = _channels(PAPER_PALETTE), _channels(EXTENDED_PALETTE)


class _Users(NamedTuple):
    """All road users of a scene, (n,) each."""

    x: Floats
    y: Floats
    cos: Floats
    """Of the heading."""
    sin: Floats
    length: Floats
    width: Floats


class _Sorting(NamedTuple):
    """The order in which road users are searched and drawn: by group, later groups on top, then by x or y."""

    order: NDArray[np.intp]
    groups: NDArray[np.intp]
    """Index in `order` of the begin of each group, and the end."""
    by_x: bool


class _Paths(NamedTuple):
    """Paths ahead: which road users have a path, (n,), and its points, (n, POINTS)."""

    known: NDArray[np.bool_]
    x: Floats
    y: Floats


def ego_images(
    world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap, route: RouteAhead | None = None
) -> NDArray[np.uint8]:
    """The images of the road users `rows` of `world`, (len(rows), EGO_ROWS, EGO_COLS, 3) RGB.

    The ego is 8 m from the left border, half-way up, and faces right; row 0 is farthest to its left. The ground has the
    colours of its surfaces; places without ground are black. Each road user, including the ego, is a line along its
    heading, as long (at least 1 m) and about as wide as its box: cars red, cyclists blue, pedestrians green, later
    types on top. With `route`, the path ahead lies under the road users, and crossings and cycle lanes have their own
    colours.
    """
    images = np.empty((len(rows), EGO_ROWS, EGO_COLS, 3), np.uint8)
    if len(rows) == 0:
        return images
    rows = np.ascontiguousarray(rows, np.intp)
    columns = (world.x, world.y, *cos_sin(world.heading), world.length, world.width)
    users = _Users(*(np.ascontiguousarray(column, np.float64) for column in columns))
    x, y = users.x, users.y
    # Cars are drawn first, so that vulnerable road users are never hidden. Within a type, road users are sorted along
    # the longer side of the scene, so that a view has few candidates.
    by_x = bool(np.ptp(x) >= np.ptp(y))
    order = np.lexsort((x if by_x else y, world.type))
    groups = np.searchsorted(world.type[order], np.arange(len(RoadUserType) + 1))
    sorting = _Sorting(order, groups, by_x)
    ahead = RouteAhead.unknown(len(rows)) if route is None else route
    path_x, path_y = (np.ascontiguousarray(column, np.float64) for column in (ahead.x, ahead.y))
    colours = PAPER_COLOURS if route is None else EXTENDED_COLOURS
    for start in range(0, len(rows), VIEWS_AT_ONCE):
        some = slice(start, start + VIEWS_AT_ONCE)
        egos = rows[some]
        views = roadmap.ego_surfaces(
            x[egos], y[egos], world.heading[egos], behind=BEHIND, ahead=AHEAD, side=SIDE, resolution=FINE
        )
        paths = _Paths(ahead.known[some], path_x[some], path_y[some])
        _draw_views(views, images[some], egos, users, sorting, paths, colours)
    return images


def ego_picture(image: NDArray[np.uint8], scale: int = 10) -> NDArray[np.uint8]:
    """One ego image enlarged, (rows * scale, cols * scale, 3): each pixel becomes a square."""
    return image.repeat(scale, axis=0).repeat(scale, axis=1)


@compiled
def _draw_views(
    views: NDArray[np.uint8],
    images: NDArray[np.uint8],
    rows: NDArray[np.intp],
    users: _Users,
    sorting: _Sorting,
    paths: _Paths,
    colours: NDArray[np.uint32],
) -> None:
    """Draw paths and road users on the ground of `views` (n, rows, cols), and write `images` (n, rows / 2, cols / 2,
    3).

    Each pixel of an image is the mean colour of four pixels. View i belongs to the road user `rows[i]` of `users`, with
    path i of `paths`. `colours`: (VALUES,), channels of CHANNEL bits each, the first channel lowest.
    """
    height = views.shape[1]
    lines = np.empty((paths.x.shape[1] + LINES, 7), np.int64)
    canvas = np.empty((height + 2 * EDGE, views.shape[2] + 2 * EDGE), np.uint8)
    along = np.empty(len(sorting.order))
    reach = np.empty(len(sorting.order))
    most = 0.0
    for k in range(len(sorting.order)):
        i = sorting.order[k]
        along[k] = users.x[i] if sorting.by_x else users.y[i]
        reach[k] = (max(users.length[i], MIN_LENGTH) + WIDEST) / 2
        most = max(most, reach[k])
    middle = (AHEAD - BEHIND) / 2
    sight = np.sqrt(((AHEAD + BEHIND) / 2) ** 2 + SIDE**2) + most

    for v in range(len(rows)):
        for r in range(height):
            for k in range(views.shape[2]):
                canvas[r + EDGE, k + EDGE] = views[v, r, k]
        count = 0 * len(rows)  # not just 0: lines would be compiled for that number, then for any
        ego = rows[v]
        x, y, c, s = users.x[ego], users.y[ego], users.cos[ego], users.sin[ego]
        if paths.known[v]:
            for k in range(HERE, paths.x.shape[1]):
                dx, dy = paths.x[v, k] - x, paths.y[v, k] - y
                # A path that leaves the view continues beside it.
                left = min(max(c * dy - s * dx, -SIDE - 1.5), SIDE + 1.5)
                lines[count, 2] = int(np.rint(((c * dx + s * dy + BEHIND) * FINE - 0.5) * SIXTEENTHS))
                lines[count, 3] = int(np.rint(((SIDE - left) * FINE - 0.5) * SIXTEENTHS))
                lines[count, 4], lines[count, 5], lines[count, 6] = PATH, PATH_THICKNESS, k == HERE + 1
                # The next line begins here; no line ends at the first point.
                lines[count + 1, 0], lines[count + 1, 1] = lines[count, 2], lines[count, 3]
                if k > HERE:
                    count += 1
                else:
                    lines[count, 0], lines[count, 1] = lines[count, 2], lines[count, 3]
        centre = x + middle * c if sorting.by_x else y + middle * s
        for group in range(len(sorting.groups) - 1):
            low, high = sorting.groups[group], sorting.groups[group + 1]
            while low < high:  # find the first road user that may be visible
                half_way = (low + high) // 2
                if along[half_way] < centre - sight:
                    low = half_way + 1
                else:
                    high = half_way
            for k in range(low, sorting.groups[group + 1]):
                if along[k] > centre + sight:
                    break
                i = sorting.order[k]
                dx, dy = users.x[i] - x, users.y[i] - y
                front, left = c * dx + s * dy, c * dy - s * dx
                if not (abs(front - middle) < (AHEAD + BEHIND) / 2 + reach[k] and abs(left) < SIDE + reach[k]):
                    continue
                thickness = THICKNESS[0]
                for nth in range(len(WIDTH_BOUNDS)):
                    if WIDTH_BOUNDS[nth] < users.width[i] * FINE:
                        thickness = THICKNESS[nth + 1]
                # Thick lines have round caps, which add half the thickness at both ends.
                half = max((max(users.length[i], MIN_LENGTH) * FINE - thickness) / 2, 0.0)
                col, row = (front + BEHIND) * FINE - 0.5, (SIDE - left) * FINE - 0.5
                step_col = half * (users.cos[i] * c + users.sin[i] * s)
                step_row = -half * (users.sin[i] * c - users.cos[i] * s)
                # Positions, from -1 to 1 along the line, where it enters and leaves the rows within which it is drawn.
                slope = 1e-9 if abs(step_row) < 1e-9 else step_row
                enter, leave = (-0.5 - CUT - row) / slope, (height - 0.5 + CUT - row) / slope
                first = min(max(min(enter, leave), -1.0), 1.0)
                last = min(max(max(enter, leave), -1.0), 1.0)
                if first < last:
                    lines[count, 0] = int(np.rint((col + first * step_col) * SIXTEENTHS))
                    lines[count, 1] = int(np.rint((row + first * step_row) * SIXTEENTHS))
                    lines[count, 2] = int(np.rint((col + last * step_col) * SIXTEENTHS))
                    lines[count, 3] = int(np.rint((row + last * step_row) * SIXTEENTHS))
                    lines[count, 4], lines[count, 5], lines[count, 6] = PAINT + group, thickness, 1
                    count += 1
                    if count == len(lines):
                        draw_lines(canvas, lines, count)
                        count -= len(lines)
        draw_lines(canvas, lines, count)
        _shrink(canvas, images, v, colours)


@compiled
def _shrink(canvas: NDArray[np.uint8], images: NDArray[np.uint8], v: int, colours: NDArray[np.uint32]) -> None:
    """The mean colour of every four pixels, halves rounded up."""
    mask = np.uint32(255)
    halves = np.uint32(2 | 2 << CHANNEL | 2 << 2 * CHANNEL)
    for r in range(images.shape[1]):
        for k in range(images.shape[2]):
            row, col = 2 * r + EDGE, 2 * k + EDGE
            total = halves + colours[canvas[row, col]] + colours[canvas[row, col + 1]]
            total += colours[canvas[row + 1, col]] + colours[canvas[row + 1, col + 1]]
            images[v, r, k, 0] = total >> np.uint32(2) & mask
            images[v, r, k, 1] = total >> np.uint32(2 + CHANNEL) & mask
            images[v, r, k, 2] = total >> np.uint32(2 + 2 * CHANNEL) & mask
