"""The way that lies ahead of road users with a route, as plain arrays."""

import math
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.compiled import compiled
from slrl_sumo.world.geometry import Floats

SPACING = 1.0
"""m between the points of a path."""
BEHIND, AHEAD = 8.0, 40.0
"""m of a path that are known behind and ahead of the road user's place on it."""
POINTS = 1 + round((BEHIND + AHEAD) / SPACING)
HERE = round(BEHIND / SPACING)
"""Index of the point beside the road user."""


@dataclass(frozen=True, eq=False)
class RouteAhead:
    """Of n road users; where `known` is False there is no route, and the other entries mean nothing.

    Distances to what lies ahead are from the front of the box in m, inf where there is nothing within sight.
    """

    known: NDArray[np.bool_]
    x: Floats
    """Points every SPACING m of the own path, (n, POINTS), from BEHIND m behind to AHEAD m ahead of the centre."""
    y: Floats
    desired: Floats
    """m/s: what limits, here and further on, and the own wishes allow, (n,)."""
    stop: Floats
    """Line before which it has to stop: red, yellow in time, others go first, the end of a lane that leads astray."""
    line: Floats
    """The next line at which a junction or a signalised crossing begins."""
    out: Floats
    """Where that junction ends."""
    signal: NDArray[np.int8]
    """At that line: 0 none, 1 green, 2 yellow, 3 red."""
    closed: NDArray[np.bool_]
    """Whether its signal is red, or yellow in time to stop: the guard and the summary count these."""
    left: Floats
    """To the end of the route."""

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
            desired=np.zeros(n),
            stop=np.full(n, np.inf),
            line=np.full(n, np.inf),
            out=np.full(n, np.inf),
            signal=np.zeros(n, np.int8),
            closed=np.zeros(n, np.bool_),
            left=np.full(n, np.inf),
        )


def slopes(points: Floats) -> Floats:
    """Change of coordinates (n, points) along each row; np.gradient, without its overhead."""
    change = np.empty_like(points)
    change[:, 1:-1] = 0.5 * (points[:, 2:] - points[:, :-2])
    change[:, 0], change[:, -1] = points[:, 1] - points[:, 0], points[:, -1] - points[:, -2]
    return change


def on_path(
    route: RouteAhead, x: Floats, y: Floats, rows: NDArray[np.intp] | None = None
) -> tuple[Floats, Floats, Floats]:
    """Where points (n, m), in m, lie beside the n paths: m along from the road user's place, m to the left, and the
    direction there (rad), (n, m) each. Beyond its ends a path goes straight on. With `rows` (n,) those paths are
    meant, else all."""
    rows = np.arange(len(route)) if rows is None else rows
    return _on_path(route.x, route.y, rows, np.ascontiguousarray(x), np.ascontiguousarray(y))


def at(route: RouteAhead, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Positions (m) and directions (rad) `along` (n, m) metres from the road user's place on its path, (n, m) each."""
    return _at(route.x, route.y, np.ascontiguousarray(along))


@compiled
def _on_path(
    path_x: Floats, path_y: Floats, rows: NDArray[np.intp], x: Floats, y: Floats
) -> tuple[Floats, Floats, Floats]:
    n, m = x.shape
    along, aside, heading = np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    squares, directions, known = np.empty(POINTS), np.empty(POINTS), np.zeros(POINTS, np.bool_)
    for i in range(n):
        row = rows[i]
        if i > 0 and row != rows[i - 1]:
            known[:] = False
        for j in range(m):
            px, py = x[i, j], y[i, j]
            nearest = min(max(_nearest(path_x[row], path_y[row], px, py, squares), 1), POINTS - 2)
            # Two pieces meet at the nearest point: the one that the point lies beside.
            x0, y0 = path_x[row, nearest], path_y[row, nearest]
            dx, dy = path_x[row, nearest + 1] - x0, path_y[row, nearest + 1] - y0
            begin = nearest
            if not (px - x0) * dx + (py - y0) * dy > 0.0:
                begin -= 1
                x0, y0 = path_x[row, begin], path_y[row, begin]
                dx, dy = path_x[row, nearest] - x0, path_y[row, nearest] - y0
            length = max(math.sqrt(dx * dx + dy * dy), 1e-6)
            ahead = ((px - x0) * dx + (py - y0) * dy) / length
            along[i, j] = (begin - HERE) * SPACING + ahead
            aside[i, j] = (dx * (py - y0) - dy * (px - x0)) / length
            # Directions change from piece to piece: in between they are blended, so that curves have no corners.
            for k in (begin, begin + 1):
                if not known[k]:
                    before, after = max(k - 1, 0), min(k + 1, POINTS - 1)
                    directions[k] = math.atan2(
                        path_y[row, after] - path_y[row, before], path_x[row, after] - path_x[row, before]
                    )
                    known[k] = True
            share = min(max(ahead / length, 0.0), 1.0)
            turn = _wrapped(directions[begin + 1] - directions[begin])
            heading[i, j] = _wrapped(directions[begin] + share * turn)
    return along, aside, heading


@compiled
def _nearest(path_x: Floats, path_y: Floats, x: float, y: float, squares: Floats) -> int:
    """Index of the point of a path that is nearest to a point; `squares` is room for as many numbers as it has."""
    for k in range(POINTS):
        dx, dy = x - path_x[k], y - path_y[k]
        squares[k] = dx * dx + dy * dy
    # Side by side: one after the other takes twice as long.
    even, odd = squares[0], squares[1]
    for k in range(2, POINTS - 1, 2):
        even, odd = min(even, squares[k]), min(odd, squares[k + 1])
    least = min(min(even, odd), squares[POINTS - 1])
    nearest = 0
    while nearest < POINTS - 1 and squares[nearest] > least:
        nearest += 1
    return nearest


@compiled
def _wrapped(angle: float) -> float:
    """As `wrap_angle`."""
    return angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))


@compiled
def _at(path_x: Floats, path_y: Floats, along: Floats) -> tuple[Floats, Floats, Floats]:
    n, m = along.shape
    x, y, heading = np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    directions, known = np.empty(POINTS), np.empty(POINTS, np.bool_)
    for i in range(n):
        known[:] = False
        for j in range(m):
            place = along[i, j] / SPACING + HERE
            # Beyond the ends first: what is far beyond is no index.
            begin = int(min(max(math.floor(place), 0.0), POINTS - 2.0))
            dx, dy = path_x[i, begin + 1] - path_x[i, begin], path_y[i, begin + 1] - path_y[i, begin]
            if not known[begin]:
                directions[begin], known[begin] = math.atan2(dy, dx), True
            x[i, j] = path_x[i, begin] + (place - begin) * dx
            y[i, j] = path_y[i, begin] + (place - begin) * dy
            heading[i, j] = directions[begin]
    return x, y, heading
