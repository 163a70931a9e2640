"""The path and the stops ahead of road users with a route, as plain arrays."""

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from operator import attrgetter
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import wrapped

SPACING = 1.0
"""Least spacing (m) of the points of a path; fast vehicles, which need to see farther, have a larger spacing."""
BEHIND, AHEAD = 8.0, 40.0
"""Length (m) of a path behind and ahead of the road user's position, at this spacing."""
POINTS = 1 + round((BEHIND + AHEAD) / SPACING)
SEVEN = 7
"""Number of points of a path in one block of the search for the nearest point."""
ROOM = SEVEN * math.ceil(POINTS / SEVEN)
APART = 3
"""Stride of the points that are compared first; it includes the last point."""
FEW = 1 + (POINTS - 1) // APART
LONGEST = 1.5 * SPACING
"""Greatest length (m) of a segment of an even path, at the least spacing; segments of curves deviate slightly."""
WITHIN = 0.75 * AHEAD + 10.0
"""Distance (m) from the middle of a path beyond which road users are not on it."""
HERE = round(BEHIND / SPACING)
"""Index of the point beside the road user."""
SEEN_BRAKING, SEEN_TIME, SEEN_MOST = 2.2, 1.1, 250.0
"""Deceleration (m/s²), time (s) and greatest distance (m) of the sight: a vehicle sees as far as it needs to stop
comfortably after this time, with half of the deceleration of cars; 40 m suffice up to 11 m/s. With the full
deceleration, cars at 15 m/s saw a queue at 38 m and had to brake hard."""


class SignalAspect(IntEnum):
    """The aspect that a signal shows to road users before its line."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


@dataclass(frozen=True, eq=False)
class RouteAhead:
    """Routes of n road users. If `known` is False, the road user has no route, and its other entries have no meaning.

    Distances are in m from the front of the box; inf if there is nothing within sight.
    """

    known: NDArray[np.bool_]
    x: Floats
    """Points of the own path every `spacing` m, (n, POINTS); the point with the index HERE is beside the centre."""
    y: Floats
    spacing: Floats
    """Spacing (m) of the points of the path, (n,)."""
    desired_speed: Floats
    """Speed (m/s) that the limits here and ahead and the desired speed of the road user allow, (n,)."""
    stop: Floats
    """Distance to where the road user must stop: a red signal, a yellow signal in time, foes with right of way, the end
    of a lane that leaves the route."""
    line: Floats
    """Distance to the next line at which a junction or a signalised crossing begins."""
    keep_clear_line: Floats
    """Distance to the line of the next junction that must be kept clear, because other ways cross there."""
    keep_clear_exit: Floats
    """Distance to the end of that junction, or of the following junction if there is no room to stand between them."""
    waiting_position: Floats
    """Distance to the first position after that line where vehicles wait inside the junction, such as before a left
    turn; -inf without one."""
    signal: NDArray[np.int8]
    """SignalAspect at `line`."""
    stop_at_signal: NDArray[np.bool_]
    """Whether the signal at `line` is red, or yellow in time to stop; the guard and the summary use it."""
    remaining_distance: Floats
    """Distance to the end of the route."""
    junction_entry_time: Floats
    """Time (s) at which the road user entered its present junction; inf outside junctions."""
    tight_curvature: Floats
    """Curvature (1/m) of the path at the road user, if its models cannot turn as sharply; else 0."""

    def __len__(self) -> int:
        return len(self.known)

    def take(self, rows: NDArray[np.intp]) -> "RouteAhead":
        """The entries of the road users `rows`."""
        return RouteAhead(*[values[rows] for values in _arrays(self)])

    @classmethod
    def unknown(cls, n: int) -> Self:
        """n road users without a route."""
        return cls(
            known=np.zeros(n, np.bool_),
            x=np.zeros((n, POINTS)),
            y=np.zeros((n, POINTS)),
            spacing=np.full(n, SPACING),
            desired_speed=np.zeros(n),
            stop=np.full(n, np.inf),
            line=np.full(n, np.inf),
            keep_clear_line=np.full(n, np.inf),
            keep_clear_exit=np.full(n, np.inf),
            waiting_position=np.full(n, -np.inf),
            signal=np.zeros(n, np.int8),
            stop_at_signal=np.zeros(n, np.bool_),
            remaining_distance=np.full(n, np.inf),
            junction_entry_time=np.full(n, np.inf),
            tight_curvature=np.zeros(n),
        )


_arrays = attrgetter(*(field.name for field in fields(RouteAhead)))


def on_path(
    route: RouteAhead, x: Floats, y: Floats, rows: NDArray[np.intp] | None = None
) -> tuple[Floats, Floats, Floats]:
    """Project points (n, m), in m, onto the n paths.

    Returns the distance (m) along the path from the road user's position, the offset (m) to the left, and the direction
    of the path there (rad), (n, m) each. A path continues straight beyond its ends; points outside a corner are
    projected onto the corner. `rows` (n,) selects the paths; default: all. ValueError for arrays of other shapes.
    """
    rows = np.arange(len(route)) if rows is None else rows
    if not (x.shape == y.shape and len(x) == len(rows)):
        raise ValueError(f"{len(rows)} paths, but points {x.shape} and {y.shape}")
    return _on_path(route.x, route.y, route.spacing, rows, np.ascontiguousarray(x), np.ascontiguousarray(y))


def beside(
    route: RouteAhead, room: Floats, x: Floats, y: Floats, reach: Floats, some: slice = slice(None)
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (p,) of a path and a road user that may be on it: row of the path, and row of the road user.

    `x`, `y` (m,): positions of the road users, in m. The first n road users own the paths and are not paired with their
    own path. A road user is found if its lateral offset, as in `on_path`, is at most `room` (n,) plus `reach` (m,), if
    it is at most `reach` beyond the ends of the path, and if it is within WITHIN of the middle (at the least spacing).
    `some`: find the pairs of these paths only.
    """
    rows = np.flatnonzero(route.known[some]) + (some.start or 0)
    # Sort from west to east, so that road users near a path are neighbours in this order.
    order = np.argsort(x)
    begin = np.searchsorted(x[order], route.x[rows, POINTS // 2] - WITHIN * route.spacing[rows])
    # The kernel makes no arrays, because numba takes long to compile growing arrays. In crowds of 1,000 road users,
    # each has 10 pairs.
    pairs = np.empty((2, 16 * len(x)), np.intp)
    users = x[order], y[order], reach, order
    while (count := _beside(route.x, route.y, route.spacing, rows, room, *users, begin, pairs)) > pairs.shape[1]:
        pairs = np.empty((2, count), np.intp)
    return pairs[0, :count], pairs[1, :count]


def spacing_at(speed: float) -> float:
    """Spacing (m) of the points of the path of a vehicle at `speed` (m/s)."""
    seen = SEEN_TIME * speed + speed * speed / (2.0 * SEEN_BRAKING)
    return SPACING if seen <= AHEAD else SPACING / AHEAD * min(seen, SEEN_MOST)


@compiled
def _on_path(
    path_x: Floats, path_y: Floats, spacing: Floats, rows: NDArray[np.intp], x: Floats, y: Floats
) -> tuple[Floats, Floats, Floats]:
    n, m = x.shape
    along, aside, heading = np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    squares, directions, known = np.full(ROOM, np.inf), np.empty(POINTS), np.zeros(POINTS, np.bool_)
    for i in range(n):
        xs, ys = path_x[rows[i]], path_y[rows[i]]
        if i > 0 and rows[i] != rows[i - 1]:
            known[:] = False
        for j in range(m):
            px, py = x[i, j], y[i, j]
            nearest = _nearest(xs, ys, px, py, squares)
            # Two segments meet at the nearest point: take the segment beside which the projected point lies.
            x0, y0 = xs[nearest], ys[nearest]
            dx, dy = xs[nearest + 1] - x0, ys[nearest + 1] - y0
            begin = nearest
            if not (px - x0) * dx + (py - y0) * dy > 0.0:
                begin -= 1
                x0, y0 = xs[begin], ys[begin]
                dx, dy = xs[nearest] - x0, ys[nearest] - y0
            length = max(math.sqrt(dx * dx + dy * dy), 1e-6)
            ahead = ((px - x0) * dx + (py - y0) * dy) / length
            left = (dx * (py - y0) - dy * (px - x0)) / length
            if begin < nearest and ahead > length:
                # The point lies outside a corner, beside neither segment: the distance to the corner is the offset.
                # Otherwise persons that missed a turn seemed to be on their path, and training rewarded them for it.
                after_x, after_y = xs[nearest + 1] - xs[nearest], ys[nearest + 1] - ys[nearest]
                corner = dy * after_x - dx * after_y
                left = math.copysign(math.hypot(px - xs[nearest], py - ys[nearest]), left if corner == 0.0 else corner)
                ahead = length
            along[i, j] = (begin - HERE) * spacing[rows[i]] + ahead
            aside[i, j] = left
            # Interpolate the directions of the segments, so that curves have no corners.
            for k in (begin, begin + 1):
                if not known[k]:
                    before, after = max(k - 1, 0), min(k + 1, POINTS - 1)
                    directions[k], known[k] = math.atan2(ys[after] - ys[before], xs[after] - xs[before]), True
            share = min(max(ahead / length, 0.0), 1.0)
            turn = wrapped(directions[begin + 1] - directions[begin])
            heading[i, j] = wrapped(directions[begin] + share * turn)
    return along, aside, heading


@compiled
def _nearest(path_x: Floats, path_y: Floats, x: float, y: float, squares: Floats) -> int:
    """Index of the point of a path that is nearest to a position, except its ends, which have only one segment.

    `squares` is a buffer of ROOM numbers.
    """
    for k in range(POINTS):
        dx, dy = x - path_x[k], y - path_y[k]
        squares[k] = dx * dx + dy * dy
    # Find the nearest block of SEVEN points, then the nearest point in it, without branches: twice as fast as a simple
    # loop.
    least, begin = math.inf, 0
    for k in range(0, POINTS, SEVEN):
        a, b = min(squares[k], squares[k + 1]), min(squares[k + 2], squares[k + 3])
        c = min(squares[k + 4], squares[k + 5])
        nearer = min(min(a, b), min(c, squares[k + 6]))
        begin = k if nearer < least else begin
        least = min(nearer, least)
    nearest = begin
    for k in range(begin + SEVEN - 1, begin - 1, -1):
        nearest = k if squares[k] <= least else nearest
    return min(max(nearest, 1), POINTS - 2)


@compiled
def _beside(
    path_x: Floats,
    path_y: Floats,
    spacing: Floats,
    rows: NDArray[np.intp],
    room: Floats,
    x: Floats,
    y: Floats,
    reach: Floats,
    order: NDArray[np.intp],
    begin: NDArray[np.intp],
    pairs: NDArray[np.intp],
) -> int:
    """Count the pairs, and write their rows to `pairs` (2, k), as many as fit.

    `x` and `y` are sorted by `order`; `begin`: for each of `rows`, the index of the first road user in this order that
    is not too far west.
    """
    squares, few_x, few_y, found = np.full(ROOM, np.inf), np.empty(FEW), np.empty(FEW), 0
    for i in range(len(rows)):
        row = rows[i]
        xs, ys = path_x[row], path_y[row]
        middle_x, middle_y = xs[POINTS // 2], ys[POINTS // 2]
        within, longest = WITHIN * spacing[row], LONGEST * spacing[row]
        even = _even(xs, ys, longest)
        x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
        for k in range(FEW):
            few_x[k], few_y[k] = xs[k * APART], ys[k * APART]
            x0, x1, y0, y1 = min(x0, few_x[k]), max(x1, few_x[k]), min(y0, few_y[k]), max(y1, few_y[k])
        for j in range(begin[i], len(x)):
            px, py, one = x[j], y[j], order[j]
            if px - middle_x > within:
                break
            if (px - middle_x) * (px - middle_x) + (py - middle_y) * (py - middle_y) > within * within or one == row:
                continue
            most = room[row] + reach[one]
            if even:
                # Greatest distance from a point: at the second one, or beyond the path's end; plus half the stride.
                gap, far = math.inf, max(1.16 * most, most + 0.42 * reach[one]) + 0.5 * APART * longest
                if px < x0 - far or px > x1 + far or py < y0 - far or py > y1 + far:
                    continue  # outside the box around these points
                for k in range(FEW):
                    dx, dy = px - few_x[k], py - few_y[k]
                    gap = min(gap, dx * dx + dy * dy)
                if gap > far * far:
                    continue
            nearest = _nearest(xs, ys, px, py, squares)
            # The projection lies on one of these two segments.
            fits = False
            for k in range(nearest - 1, nearest + 1):
                dx, dy = xs[k + 1] - xs[k], ys[k + 1] - ys[k]
                aside = dx * (py - ys[k]) - dy * (px - xs[k])
                fits |= aside * aside <= most * most * max(dx * dx + dy * dy, 1e-12)
            if fits:
                if found < pairs.shape[1]:
                    pairs[0, found], pairs[1, found] = row, one
                found += 1
    return found


@compiled
def _even(x: Floats, y: Floats, longest: float) -> bool:
    """Whether no segment of a path is longer than `longest` (m), and it turns by less than 30 degrees at its second
    point: else positions near its first point, which `_nearest` leaves out, may lie on the line of its second segment.
    """
    before_x, before_y, after_x, after_y = x[1] - x[0], y[1] - y[0], x[2] - x[1], y[2] - y[1]
    before, after = before_x * before_x + before_y * before_y, after_x * after_x + after_y * after_y
    along = before_x * after_x + before_y * after_y
    even = bool(along > 0.0 and 4.0 * along * along > 3.0 * before * after)
    for k in range(POINTS - 1):
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        even &= bool(dx * dx + dy * dy <= longest * longest)
    return even
