"""Thick lines on a small canvas.

A line is a filled quadrilateral with its outline, and discs at its ends. Each of them follows OpenCV's rules to the bit
(cv2.polylines with LINE_8), because the shipped selectors have learned from images that OpenCV drew. Calls of OpenCV
took longer than the drawing.
"""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled

Ids = NDArray[np.uint8]
Ints = NDArray[np.int64]

SIXTEENTHS = 16
"""Ends of lines are rounded to 1/16 px."""
BITS = 16
"""Fractional bits of coordinates computed from them."""
ONE = 1 << BITS
HALF = ONE // 2
DISCS = np.array([[0, 0, 0, 0, 0], [1, 0, 0, 0, 0], [2, 1, 0, 0, 0], [3, 2, 2, 0, 0], [4, 3, 3, 2, 0]])
"""Pixels that a disc reaches to each side of its middle column, by radius (px) and row from its middle."""
EDGE = 12
"""px round a view that belong to its canvas, so that pixels need no checks: more than OUTSIDE and the radius of the
largest disc."""
OUTSIDE = 6
"""Lines may end this many rows above or below a view."""
FARTHEST = 1 << 20
"""Largest column on either side, in sixteenths of a pixel."""


@compiled
def _span(canvas: Ids, row: int, first: int, last: int, value: int) -> None:
    """Fill a row from column `first` to `last`, both included. Rows and columns count from the first of the view."""
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
    """The part of a line between the left border of the view and the `right` one; the whole line if that is empty."""
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
def draw_lines(canvas: Ids, lines: Ints, count: int) -> None:
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
                # From the top to both others, and from both others to the bottom.
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
