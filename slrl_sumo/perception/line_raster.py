"""Ego views drawn: paths and road users as thick lines on the ground, then colours, half as many pixels each way.

A line is a filled quadrilateral with its outline, and discs at its ends. For each of them OpenCV's rule is followed to
the bit (cv2.polylines with LINE_8), because selectors have learned from images that it drew: a call of it took longer
than the drawing.
"""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled

Ids = NDArray[np.uint8]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

SIXTEENTHS = 16
"""Ends of lines are rounded to 1/16 px."""
BITS = 16
"""Fractional bits of all that is computed from them."""
ONE = 1 << BITS
HALF = ONE // 2
DISCS = np.array([[0, 0, 0, 0, 0], [1, 0, 0, 0, 0], [2, 1, 0, 0, 0], [3, 2, 2, 0, 0], [4, 3, 3, 2, 0]])
"""Pixels that a disc reaches to each side of its middle column, by radius (px) and row from its middle."""
EDGE = 12
"""px round a view that may be drawn on as well, so that not every pixel has to be checked: more than OUTSIDE and the
radius of the largest disc."""
OUTSIDE = 6
"""Lines may end this many rows above or below a view."""
FARTHEST = 1 << 20
"""Sixteenths of a pixel; columns are less than that to either side."""
LINES = 256
"""Lines that are drawn at once: numba counts who uses the canvas in every function that it is given to."""
CHANNEL = 10
"""Bits of a colour channel where four of them are added up."""


@compiled
def _span(canvas: Ids, row: int, first: int, last: int, value: int) -> None:
    """Fill a row from column `first` to `last`, both included, rows and columns counted from the view's first."""
    for col in range(max(first + EDGE, 0), min(last + EDGE, canvas.shape[1] - 1) + 1):
        canvas[row + EDGE, col] = value


@compiled
def _twins(canvas: Ids, x0: int, y0: int, x1: int, y1: int, dx: int, dy: int, value: int) -> None:
    """Two lines one pixel thick, from (x0, y0) and (x1, y1), both by (dx, dy)."""
    wide, high = abs(dx), abs(dy)
    if dx < 0 if wide > high else dy < 0:
        x0, y0, x1, y1, dx, dy = x0 + dx, y0 + dy, x1 + dx, y1 + dy, -dx, -dy
    shift = EDGE * ONE + HALF
    x0, y0, x1, y1 = x0 + shift, y0 + shift, x1 + shift, y1 + shift
    canvas[(y0 + dy) >> BITS, (x0 + dx) >> BITS] = value
    canvas[(y1 + dy) >> BITS, (x1 + dx) >> BITS] = value
    if wide > high:
        step = int(float(dy * ONE) / float(wide | 1))
        x0, x1 = x0 >> BITS, x1 >> BITS
        for k in range((wide >> BITS) + 1):
            canvas[y0 >> BITS, x0 + k] = value
            canvas[y1 >> BITS, x1 + k] = value
            y0, y1 = y0 + step, y1 + step
    else:
        step = int(float(dx * ONE) / float(high | 1))
        y0, y1 = y0 >> BITS, y1 >> BITS
        for k in range((high >> BITS) + 1):
            canvas[y0 + k, x0 >> BITS] = value
            canvas[y1 + k, x1 >> BITS] = value
            x0, x1 = x0 + step, x1 + step


@compiled
def _cut(x0: int, y0: int, x1: int, y1: int, right: int) -> tuple[int, int, int, int]:
    """What of a line lies between the left border of the view and the `right` one; the same if nothing does."""
    if not ((x0 < 0 and x1 < 0) or (x0 > right and x1 > right)):
        if x0 < 0 or x0 > right:
            border = 0 if x0 < 0 else right
            y0 += int(float(border - x0) * float(y1 - y0) / float(x1 - x0))
            x0 = border
        if x1 < 0 or x1 > right:
            border = 0 if x1 < 0 else right
            y1 += int(float(border - x1) * float(y1 - y0) / float(x1 - x0))
            x1 = border
    return x0, y0, x1, y1


@compiled
def _slope(change: int, rows: int) -> int:
    """Columns per row, rounded up by half a unit."""
    return int(float(2 * change + rows) / float(2 * rows))


@compiled
def _draw_lines(canvas: Ids, lines: Ints, count: int) -> None:
    """Draw the first `count` of `lines` (n, 7): columns and rows of both ends in sixteenths of a pixel, value,
    thickness in px, and whether it begins with a disc. It ends with one."""
    low, high = -OUTSIDE * SIXTEENTHS, (canvas.shape[0] - 2 * EDGE + OUTSIDE) * SIXTEENTHS
    border = (canvas.shape[1] - 2 * EDGE + OUTSIDE) * SIXTEENTHS
    right = (canvas.shape[1] - 2 * EDGE) * ONE - 1
    scale = ONE // SIXTEENTHS
    for k in range(count):
        x0, y0, x1, y1 = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
        value, thickness = lines[k, 4], lines[k, 5]
        if max(x0, x1) < low or min(x0, x1) > border:
            continue
        if not (low < min(y0, y1) and max(y0, y1) < high and min(x0, x1) > -FARTHEST and max(x0, x1) < FARTHEST):
            continue
        x0, y0, x1, y1 = x0 * scale, y0 * scale, x1 * scale, y1 * scale
        radius = (thickness + 1) // 2
        for end in range(1 - lines[k, 6], 2):
            col, row = ((x1 if end else x0) + HALF) >> BITS, ((y1 if end else y0) + HALF) >> BITS
            for r in range(-radius, radius + 1):
                reach = DISCS[radius, abs(r)]
                _span(canvas, row + r, col - reach, col + reach, value)
        if x0 == x1 and y0 == y1:
            continue

        # A bar: the line, and as much aside of it as it is thick. Downwards, whichever way the line goes.
        if y1 < y0:
            x0, y0, x1, y1 = x1, y1, x0, y0
        dx, dy = float(x1 - x0) / ONE, float(y1 - y0) / ONE
        share = float((thickness + (thickness & 1)) * HALF) / np.sqrt(dx * dx + dy * dy)
        aside_x, aside_y = -int(np.rint(dy * share)), int(np.rint(dx * share))
        if aside_y < 0:
            aside_x, aside_y = -aside_x, -aside_y
        # Its corners: the top, the two beside it, the bottom.
        top_x, top_y = x0 - aside_x, y0 - aside_y
        a_x, a_y = x0 + aside_x, y0 + aside_y
        b_x, b_y = x1 - aside_x, y1 - aside_y
        end_x, end_y = x1 + aside_x, y1 + aside_y
        if min(top_x, a_x, b_x, end_x) >= 0 and max(top_x, a_x, b_x, end_x) <= right:
            _twins(canvas, top_x, top_y, a_x, a_y, x1 - x0, y1 - y0, value)
            _twins(canvas, top_x, top_y, b_x, b_y, 2 * aside_x, 2 * aside_y, value)
        else:
            for edge in range(4):
                # From the top beside both others, and from both others to the bottom.
                begin_x, begin_y = (top_x, top_y) if edge < 2 else (end_x, end_y)
                turn_x, turn_y = (a_x, a_y) if edge & 1 else (b_x, b_y)
                begin_x, begin_y, turn_x, turn_y = _cut(begin_x, begin_y, turn_x, turn_y, right)
                if 0 <= begin_x <= right and 0 <= turn_x <= right:
                    _twins(canvas, begin_x, begin_y, begin_x, begin_y, turn_x - begin_x, turn_y - begin_y, value)
        first, last = (top_y + HALF) >> BITS, (end_y + HALF) >> BITS
        a_row, b_row = (a_y + HALF) >> BITS, (b_y + HALF) >> BITS
        a_at, a_step = top_x, _slope(a_x - top_x, a_row - first) if a_row > first else 0
        b_at, b_step = top_x, _slope(b_x - top_x, b_row - first) if b_row > first else 0
        # The row of the lowest corner is left to the outline.
        for row in range(first, last):
            if row == a_row:
                a_at, a_step = a_x, _slope(end_x - a_x, last - row)
            if row == b_row:
                b_at, b_step = b_x, _slope(end_x - b_x, last - row)
            _span(canvas, row, (min(a_at, b_at) + HALF) >> BITS, (max(a_at, b_at) + HALF) >> BITS, value)
            a_at, b_at = a_at + a_step, b_at + b_step


@compiled
def draw_views(
    views: Ids,
    images: Ids,
    rows: NDArray[np.intp],
    world: tuple[Floats, Floats, Floats, Floats, Floats, Floats],
    sorting: tuple[NDArray[np.intp], NDArray[np.intp], bool],
    path: tuple[NDArray[np.bool_], Floats, Floats, int],
    window: tuple[float, float, float, float, float],
    look: tuple[int, int, int, float, float],
    widths: tuple[Floats, Ints],
    colours: NDArray[np.uint32],
) -> None:
    """Draw paths and road users on the ground of `views` (n, rows, cols), and put them into `images` (n, rows / 2,
    cols / 2, 3): the mean colour of every four pixels.

    The views are those of the road users `rows` (n,) of `world`: x, y (m), cosine and sine of the heading, length,
    width (m) of all. `sorting`: the order in which they are sorted by group (later groups lie on top), then by x or y;
    where each group begins in it, and the end; and whether by x. `path`: who has one, (n,), its points, (n, k) each,
    and the first one that is drawn. `window`: m behind, ahead, to each side, px per m, and how many px outside lines
    are cut. `look`: value and thickness of paths, value of group 0, least length and greatest drawn width (m).
    `widths`: thresholds (px) and thicknesses.
    `colours`: (values,), channels of CHANNEL bits each, the first lowest.
    """
    all_x, all_y, all_cos, all_sin, length, width = world
    order, groups, by_x = sorting
    has_path, path_x, path_y, here = path
    behind, ahead, side, fine, cut = window
    path_value, path_thickness, group_value, least, widest = look
    bounds, thicknesses = widths
    height = views.shape[1]
    lines = np.empty((path_x.shape[1] + LINES, 7), np.int64)
    canvas = np.empty((height + 2 * EDGE, views.shape[2] + 2 * EDGE), np.uint8)
    along = np.empty(len(order))
    reach = np.empty(len(order))
    most = 0.0
    for k in range(len(order)):
        i = order[k]
        along[k] = all_x[i] if by_x else all_y[i]
        reach[k] = (max(length[i], least) + widest) / 2
        most = max(most, reach[k])
    middle = (ahead - behind) / 2
    sight = np.sqrt(((ahead + behind) / 2) ** 2 + side**2) + most

    for v in range(len(rows)):
        for r in range(height):
            for k in range(views.shape[2]):
                canvas[r + EDGE, k + EDGE] = views[v, r, k]
        count = 0 * here  # not just 0: lines would be compiled for that number, then for any
        ego = rows[v]
        x, y, c, s = all_x[ego], all_y[ego], all_cos[ego], all_sin[ego]
        if has_path[v]:
            for k in range(here, path_x.shape[1]):
                dx, dy = path_x[v, k] - x, path_y[v, k] - y
                # A path that leaves the view goes on beside it.
                left = min(max(c * dy - s * dx, -side - 1.5), side + 1.5)
                lines[count, 2] = int(np.rint(((c * dx + s * dy + behind) * fine - 0.5) * SIXTEENTHS))
                lines[count, 3] = int(np.rint(((side - left) * fine - 0.5) * SIXTEENTHS))
                lines[count, 4], lines[count, 5], lines[count, 6] = path_value, path_thickness, k == here + 1
                # It is where the next one begins; the first point ends nothing.
                lines[count + 1, 0], lines[count + 1, 1] = lines[count, 2], lines[count, 3]
                if k > here:
                    count += 1
                else:
                    lines[count, 0], lines[count, 1] = lines[count, 2], lines[count, 3]
        centre = x + middle * c if by_x else y + middle * s
        for group in range(len(groups) - 1):
            low, high = groups[group], groups[group + 1]
            while low < high:  # the first one that may be seen
                half_way = (low + high) // 2
                if along[half_way] < centre - sight:
                    low = half_way + 1
                else:
                    high = half_way
            for k in range(low, groups[group + 1]):
                if along[k] > centre + sight:
                    break
                i = order[k]
                dx, dy = all_x[i] - x, all_y[i] - y
                front, left = c * dx + s * dy, c * dy - s * dx
                if not (abs(front - middle) < (ahead + behind) / 2 + reach[k] and abs(left) < side + reach[k]):
                    continue
                thickness = thicknesses[0]
                for nth in range(len(bounds)):
                    if bounds[nth] < width[i] * fine:
                        thickness = thicknesses[nth + 1]
                # Thick lines have round caps, which add half the thickness at both ends.
                half = max((max(length[i], least) * fine - thickness) / 2, 0.0)
                col, row = (front + behind) * fine - 0.5, (side - left) * fine - 0.5
                step_col = half * (all_cos[i] * c + all_sin[i] * s)
                step_row = -half * (all_sin[i] * c - all_cos[i] * s)
                # Where, from -1 to 1 along itself, a line enters and leaves the rows within which it is drawn.
                slope = 1e-9 if abs(step_row) < 1e-9 else step_row
                enter, leave = (-0.5 - cut - row) / slope, (height - 0.5 + cut - row) / slope
                first = min(max(min(enter, leave), -1.0), 1.0)
                last = min(max(max(enter, leave), -1.0), 1.0)
                if first < last:
                    lines[count, 0] = int(np.rint((col + first * step_col) * SIXTEENTHS))
                    lines[count, 1] = int(np.rint((row + first * step_row) * SIXTEENTHS))
                    lines[count, 2] = int(np.rint((col + last * step_col) * SIXTEENTHS))
                    lines[count, 3] = int(np.rint((row + last * step_row) * SIXTEENTHS))
                    lines[count, 4], lines[count, 5], lines[count, 6] = group_value + group, thickness, 1
                    count += 1
                    if count == len(lines):
                        _draw_lines(canvas, lines, count)
                        count -= len(lines)
        _draw_lines(canvas, lines, count)
        _shrink(canvas, images, v, colours)


@compiled
def _shrink(canvas: Ids, images: Ids, v: int, colours: NDArray[np.uint32]) -> None:
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
