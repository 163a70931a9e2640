"""The path and the stops ahead of road users with a route, as plain arrays."""

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import wrapped

SPACING = 1.0
"""m between the points of a path, of road users that see far enough with it."""
BEHIND, AHEAD = 8.0, 40.0
"""m of such a path that are known behind and ahead of the road user's position on it."""
POINTS = 1 + round((BEHIND + AHEAD) / SPACING)
SEVEN = 7
"""Points of a path in one block of the search for the nearest one."""
ROOM = SEVEN * math.ceil(POINTS / SEVEN)
APART = 3
"""Stride of the points that are compared first; the last point is among them."""
FEW = 1 + (POINTS - 1) // APART
LONGEST = 1.5 * SPACING
"""Longest piece of a smooth path in m, at the usual spacing: pieces of a path beside a line deviate a little."""
WITHIN = 0.75 * AHEAD + 10.0
"""m from the middle of a path; road users farther away are not on it."""
HERE = round(BEHIND / SPACING)
"""Index of the point beside the road user."""
SEEN_BRAKING, SEEN_TIME, SEEN_MOST = 2.2, 1.1, 250.0
"""m/s², s and m: a vehicle sees as far as it needs to stop after that time in comfort, with half of the braking that
cars can; 40 m suffice up to 11 m/s. With all of it, cars at 15 m/s saw a queue at 38 m and had to brake hard."""


class SignalAspect(IntEnum):
    """What a signal shows to road users that want to pass its line."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


@dataclass(frozen=True, eq=False)
class RouteAhead:
    """Of n road users; where `known` is False there is no route, and the other entries have no meaning.

    Distances are in m from the front of the box, inf where there is nothing within sight.
    """

    known: NDArray[np.bool_]
    x: Floats
    """Points every `spacing` m of the own path, (n, POINTS), of which that at HERE is beside the centre."""
    y: Floats
    spacing: Floats
    """m between the points of the path, (n,)."""
    desired_speed: Floats
    """m/s that limits here and ahead and the desired speed of the road user allow, (n,)."""
    stop: Floats
    """Distance to the line before which it has to stop: red, yellow in time, right of way of others, the end of a lane
    that leaves the route."""
    line: Floats
    """Distance to the next line at which a junction or a signalised crossing begins."""
    keep_clear_line: Floats
    """Distance to the line of the next junction that has to be kept clear, because others cross its way there."""
    keep_clear_exit: Floats
    """Distance to the end of that junction, or of the next one where there is no room to stand between the two."""
    waiting_position: Floats
    """Distance to the first position beyond that line where vehicles wait inside the junction, as before a left turn;
    -inf where there is none."""
    signal: NDArray[np.int8]
    """SignalAspect at that line."""
    stop_at_signal: NDArray[np.bool_]
    """Whether its signal is red, or yellow in time to stop: the guard and the summary count these."""
    remaining_distance: Floats
    """Distance to the end of the route."""
    junction_entry_time: Floats
    """s: when it entered the junction in which it is now; inf outside of junctions."""
    tight_curvature: Floats
    """1/m: curvature of the path where it is, if that is sharper than its models turn, else 0."""

    def __len__(self) -> int:
        return len(self.known)

    def take(self, rows: NDArray[np.intp]) -> "RouteAhead":
        """The entries of the road users `rows`."""
        return RouteAhead(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

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


def on_path(
    route: RouteAhead, x: Floats, y: Floats, rows: NDArray[np.intp] | None = None
) -> tuple[Floats, Floats, Floats]:
    """Points (n, m), in m, projected onto the n paths: m along from the road user's position, m to the left, and the
    direction of the path there (rad), (n, m) each. Beyond its ends a path continues straight on; what lies outside of a
    corner is projected onto the corner. `rows` (n,) selects the paths; default: all. ValueError for arrays of other
    shapes."""
    rows = np.arange(len(route)) if rows is None else rows
    if not (x.shape == y.shape and len(x) == len(rows)):
        raise ValueError(f"{len(rows)} paths, but points {x.shape} and {y.shape}")
    return _on_path(route.x, route.y, route.spacing, rows, np.ascontiguousarray(x), np.ascontiguousarray(y))


def beside(
    route: RouteAhead, room: Floats, x: Floats, y: Floats, reach: Floats, some: slice = slice(None)
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (p,) of a path and a road user that may be on it: row of the path, and row of the road user.

    Positions (m,), in m, are those of road users; the first n are the owners of the paths, which are not paired with
    their own. A road user is found if its lateral offset, as in `on_path`, is at most `room` (n,) plus `reach` (m,), if
    it is at most `reach` beyond the ends of the path, and within WITHIN of its middle (at the usual spacing). `some`:
    only these paths, with the pairs that they have among all.
    """
    rows = np.flatnonzero(route.known[some]) + (some.start or 0)
    # From west to east, so that road users near a path are neighbours in this order.
    order = np.argsort(x)
    begin = np.searchsorted(x[order], route.x[rows, POINTS // 2] - WITHIN * route.spacing[rows])
    # The kernel makes no arrays: those that grow take numba long to compile. Crowds of 1,000 have 10 pairs each.
    pairs = np.empty((2, 16 * len(x)), np.intp)
    users = x[order], y[order], reach, order
    while (count := _beside(route.x, route.y, route.spacing, rows, room, *users, begin, pairs)) > pairs.shape[1]:
        pairs = np.empty((2, count), np.intp)
    return pairs[0, :count], pairs[1, :count]


def spacing_at(speed: float) -> float:
    """m between the points of the path of a vehicle at `speed` (m/s)."""
    seen = min(SEEN_TIME * speed + speed * speed / (2.0 * SEEN_BRAKING), SEEN_MOST)
    return max(SPACING, SPACING / AHEAD * seen)


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
            # Two pieces meet at the nearest point: take the one that the point lies beside.
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
                # Outside of a corner, beside neither piece: straight on is away from the path. Otherwise persons that
                # missed a turn seemed to be on it, and training paid them for going on.
                after_x, after_y = xs[nearest + 1] - xs[nearest], ys[nearest + 1] - ys[nearest]
                corner = dy * after_x - dx * after_y
                left = math.copysign(math.hypot(px - xs[nearest], py - ys[nearest]), left if corner == 0.0 else corner)
                ahead = length
            along[i, j] = (begin - HERE) * spacing[rows[i]] + ahead
            aside[i, j] = left
            # Directions change from piece to piece: they are interpolated, so that curves have no corners.
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
    """Index of the point of a path that is nearest to a point, except its ends, which have only one piece.

    `squares` is a buffer of ROOM numbers.
    """
    for k in range(POINTS):
        dx, dy = x - path_x[k], y - path_y[k]
        squares[k] = dx * dx + dy * dy
    # The nearest block of SEVEN, then the nearest of them, without branches: twice as fast as one by one.
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
    """Number of pairs; their rows go to `pairs` (2, k), as many as fit. x and y in `order`; `begin`: index in it of the
    first road user that is not too far west of each of `rows`."""
    squares, few_x, few_y, found = np.full(ROOM, np.inf), np.empty(FEW), np.empty(FEW), 0
    for i in range(len(rows)):
        row = rows[i]
        xs, ys = path_x[row], path_y[row]
        middle_x, middle_y = xs[POINTS // 2], ys[POINTS // 2]
        within, longest = WITHIN * spacing[row], LONGEST * spacing[row]
        smooth = _smooth(xs, ys, longest)
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
            if smooth:
                # Largest distance from a point: outside a turn, beyond the end of the path, plus half the stride.
                gap, far = math.inf, max(1.16 * most, most + 0.42 * reach[one]) + 0.5 * APART * longest
                if px < x0 - far or px > x1 + far or py < y0 - far or py > y1 + far:
                    continue  # outside of the box around these points
                for k in range(FEW):
                    dx, dy = px - few_x[k], py - few_y[k]
                    gap = min(gap, dx * dx + dy * dy)
                if gap > far * far:
                    continue
            nearest = _nearest(xs, ys, px, py, squares)
            # The projection lies on one of these two pieces.
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
def _smooth(x: Floats, y: Floats, longest: float) -> bool:
    """Whether a path turns by less than 30 degrees from piece to piece, none of which is longer than `longest` (m)."""
    smooth = True
    for k in range(1, POINTS - 1):
        from_x, from_y, to_x, to_y = x[k] - x[k - 1], y[k] - y[k - 1], x[k + 1] - x[k], y[k + 1] - y[k]
        before, after, along = (
            from_x * from_x + from_y * from_y,
            to_x * to_x + to_y * to_y,
            from_x * to_x + from_y * to_y,
        )
        smooth &= (along > 0.0) & (4.0 * along * along > 3.0 * before * after)
        smooth &= max(before, after) <= longest * longest
    return smooth
