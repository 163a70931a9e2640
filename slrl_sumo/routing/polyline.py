"""Polylines of paths: positions along them, and places nearest to a position."""

import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats


@dataclass(frozen=True)
class Polyline:
    """A polyline of at least one segment; `s`: m along the line. Lists are faster than arrays for single items."""

    x: list[float]
    y: list[float]
    s: list[float]

    @property
    def end(self) -> float:
        """Length of the line, m."""
        return self.s[-1]

    def at(self, s: float) -> tuple[float, float, float]:
        """Position (m) and direction (rad) at `s`; the line is extended straight beyond its ends."""
        i = min(max(bisect_right(self.s, s) - 1, 0), len(self.s) - 2)
        dx, dy = self.x[i + 1] - self.x[i], self.y[i + 1] - self.y[i]
        share = (s - self.s[i]) / (self.s[i + 1] - self.s[i])
        return self.x[i] + share * dx, self.y[i] + share * dy, math.atan2(dy, dx)

    @cached_property
    def points(self) -> Floats:
        """x, y and s of the points, (3, points), for compiled loops."""
        return np.array([self.x, self.y, self.s])

    def nearest(self, x: float, y: float, begin: float = -math.inf, end: float = math.inf) -> tuple[float, float]:
        """The place between `begin` and `end` nearest to a position: m along the line, and m to the left of it."""
        return self.place(x, y, begin, end)[:2]

    def place(self, x: float, y: float, begin: float, end: float) -> tuple[float, float, float]:
        """Like `nearest`, with the distance (m) of the position as well; inf if no part of the line lies between."""
        return _place(self.points, x, y, begin, end)

    def places(self, x: Floats, y: Floats, end: float = math.inf) -> Floats:
        """The place of each of m positions, (4, m): m along the line, m to the left of it, distance (m), and the
        direction (rad) of the line there; places beyond `end` are not searched."""
        places = np.empty((4, len(x)))
        _places(self.points, x, y, end, places)
        return places

    def draw(self, begin: float, spacing: float, x: Floats, y: Floats, row: int) -> None:
        """Write points of the line every `spacing` m, from `begin` on, to row `row` of `x` and `y`.

        The line is extended straight beyond its ends.
        """
        _draw(self.points, begin, spacing, x, y, row)

    def between(self, begin: float, end: float) -> list[tuple[float, float]]:
        """The points of the line from `begin` to `end`, both included."""
        inner = [(self.x[i], self.y[i]) for i in range(len(self.s)) if begin < self.s[i] < end]
        return [self.at(begin)[:2], *inner, self.at(end)[:2]]


def direction_between(begin: tuple[float, float], end: tuple[float, float]) -> float:
    """Direction (rad) from one point (m) to another one."""
    return math.atan2(end[1] - begin[1], end[0] - begin[0])


def line_through(points: Iterable[tuple[float, float]]) -> tuple[Polyline, list[float]]:
    """A line, and the position (m along the line) of each of the given points. Points closer than 5 cm become one.

    Successive lanes share a point, and there is no direction between equal points.
    """
    x: list[float] = []
    y: list[float] = []
    s: list[float] = []
    along = []
    for px, py in points:
        step = math.hypot(px - x[-1], py - y[-1]) if x else 0.0
        if not x or step > 0.05:
            x.append(px)
            y.append(py)
            s.append(s[-1] + step if s else 0.0)
        along.append(s[-1])
    if len(x) == 1:
        # A single point gets an arbitrary direction.
        x, y, s = [x[0], x[0] + 0.1], [y[0], y[0]], [0.0, 0.1]
    return Polyline(x, y, s), along


@compiled
def _place(points: Floats, x: float, y: float, begin: float, end: float) -> tuple[float, float, float]:
    xs, ys, s = points[0], points[1], points[2]
    least, found, left = math.inf, max(s[0], begin), 0.0
    # Search only segments that lie at least partly between `begin` and `end`.
    for i in range(_segment(s, begin), len(s) - 1):
        if s[i] > end or s[i + 1] < begin:
            break
        dx, dy, step = xs[i + 1] - xs[i], ys[i + 1] - ys[i], s[i + 1] - s[i]
        px, py = x - xs[i], y - ys[i]
        low, high = max(begin - s[i], 0.0), min(end - s[i], step)
        along = min(max((px * dx + py * dy) / step, low), high)
        distance = math.sqrt((px - along * dx / step) ** 2 + (py - along * dy / step) ** 2)
        if distance < least:
            least, found, left = distance, s[i] + along, (dx * py - dy * px) / step
    return found, left, least


@compiled
def _places(points: Floats, x: Floats, y: Floats, end: float, places: Floats) -> None:
    xs, ys, s = points[0], points[1], points[2]
    for k in range(len(x)):
        along, left, distance = _place(points, x[k], y[k], -math.inf, end)
        i = _segment(s, along)
        places[0, k], places[1, k], places[2, k] = along, left, distance
        places[3, k] = math.atan2(ys[i + 1] - ys[i], xs[i + 1] - xs[i])


@compiled
def _draw(points: Floats, begin: float, spacing: float, x: Floats, y: Floats, row: int) -> None:
    xs, ys, s, many = points[0], points[1], points[2], x.shape[1]
    i = _segment(s, begin)
    for k in range(many):
        along = begin + k * spacing
        while i < len(s) - 2 and s[i + 1] <= along:
            i += 1
        share = (along - s[i]) / (s[i + 1] - s[i])
        x[row, k], y[row, k] = xs[i] + share * (xs[i + 1] - xs[i]), ys[i] + share * (ys[i + 1] - ys[i])


@compiled
def _segment(s: Floats, along: float) -> int:
    """Index of the last segment that begins before `along`; without one, of the first segment."""
    low, high = 0, len(s) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if s[middle] < along:
            low = middle
        else:
            high = middle
    return low
