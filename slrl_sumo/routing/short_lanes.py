"""Curves in place of short lanes that a network draws across each other.

Where two junctions are a few metres apart, as in networks imported from OpenStreetMap, netconvert cuts the edge between
them to 0.2 m and joins it with internal lanes that lead aside, or backwards, within 3 m. Neither SUMO's vehicles, which
are points there, nor the models of this package can turn so sharply.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import pairwise, takewhile
from typing import NamedTuple

import numpy as np

from slrl_sumo.routing.polyline import Polyline, direction_between, line_through
from slrl_sumo.sumo.network.lanes import Lane

SHORT = 4.0
"""Length (m) below which a lane between two junctions is short: less than a car."""
ZIGZAG, WITHIN = 1.2, 6.0
"""Turning (rad) to both sides beyond the change of direction, and distance (m) within it, from which a curve replaces
lanes: a change of lane within 3 m has 1.6 rad. A mini-roundabout has 0.7 rad within 6 m."""
STEP = 1.0
"""Spacing (m) of places on the next lane that a curve may join."""
FARTHEST = 10.0
"""Distance (m) from the begin of the next lane to the farthest of them."""
SMOOTH = 0.1
"""Turning (rad) to both sides up to which a curve is smooth: the first place that allows such a curve within the lanes
is taken."""
OUTSIDE = 0.5
"""Distance (m) that a curve may lead outside the lanes that it replaces: without a bound, curves that ended up to 10 m
on the next lane led more than 1 m beside the carriageway at 23 places in five cities."""
CONTROL = 0.39
"""Distance of a curve's control points from its ends, as a share of the distance between the ends: that of a quarter
of a circle."""
PIECES = 8
"""Segments of a curve."""
KEPT = 16384
"""Curves that are kept: a decision in a part of Helsinki takes 0.98 of its time."""

Point = tuple[float, float]


class Curve(NamedTuple):
    """A curve from the lane before short lanes to the lane after them."""

    points: list[Point]
    """Points after the end of the lane before, up to the place on the lane after."""
    after: int
    """Index of the lane after the short lanes."""
    rest: list[Point]
    """Points of that lane from the place on."""


def curve_over(lanes: Sequence[Lane], first: int) -> Curve | None:
    """The curve that replaces the `lanes` from the index `first` on, over one short lane or several in a row.

    It stays within the lanes that it replaces where it can. None if there is no tight zigzag over the first short lane,
    and for the begin and the end of a path.
    """
    if first == 0 or lanes[first - 1].internal or not lanes[first].internal:
        return None
    ends = _lanes_after(lanes, first)
    if not ends:
        return None
    found = _best_curve(tuple(lanes[first - 1 : ends[-1] + 1]))
    return None if found is None else found._replace(after=found.after + first - 1)


@lru_cache(KEPT)
def _best_curve(lanes: tuple[Lane, ...]) -> Curve | None:
    """See `curve_over`: it begins after the first of the `lanes`, and may end on each one up to the last."""
    before, ends = lanes[0].points, _lanes_after(lanes, 1)
    drawn = (point for lane in lanes[1 : ends[0]] for point in lane.points)
    if tightest_zigzag([*before[-2:], *drawn, *lanes[ends[0]].points[:2]]) < ZIGZAG:
        return None
    best, least = None, (math.inf, math.inf)
    for after in ends:
        line, _ = line_through(lanes[after].points)
        replaced, _ = line_through([*before[-2:], *(p for lane in lanes[1 : after + 1] for p in lane.points)])
        for k in range(1 + int(min(FARTHEST, 0.5 * line.end) / STEP)):
            points = _curve(before[-2], before[-1], line, k * STEP)
            turning = zigzag([*before[-2:], *points, line.at(k * STEP + 0.5 * STEP)[:2]])
            outside = _distance(points, replaced) - 0.5 * lanes[after].width - OUTSIDE
            rank = max(outside, 0.0), turning
            if rank < least:
                best, least = Curve(points, after, line.between(k * STEP, line.end)), rank
            if rank < (0.0, SMOOTH):
                return best
    return best


def _lanes_after(lanes: Sequence[Lane], first: int) -> list[int]:
    """Indices of the lanes between junctions that follow the first short lane from the index `first` on, up to the
    first one that is not short."""
    between = [k for k in range(first, len(lanes)) if not lanes[k].internal]
    return [after for here, after in takewhile(lambda pair: is_short(lanes[pair[0]]), pairwise(between))]


def is_short(lane: Lane) -> bool:
    """Whether a lane between two junctions is shorter than a car."""
    return not lane.internal and lane.length < SHORT


def zigzag(points: Iterable[Point]) -> float:
    """Turning (rad) of a line to both sides beyond its change of direction; points closer than 5 cm count as one."""
    line, _ = line_through(points)
    directions = [direction_between(*ends) for ends in pairwise(zip(line.x, line.y, strict=True))]
    turns = [math.remainder(b - a, math.tau) for a, b in pairwise(directions)]
    return sum(map(abs, turns)) - abs(sum(turns))


def tightest_zigzag(points: Iterable[Point]) -> float:
    """The greatest `zigzag` (rad) of a part of a line that is WITHIN long."""
    line, _ = line_through(points)
    begins = range(1 + max(math.ceil(line.end - WITHIN), 0))
    return max(zigzag(line.between(begin, min(begin + WITHIN, line.end))) for begin in begins)


def _distance(points: Sequence[Point], line: Polyline) -> float:
    """The greatest distance (m) of the points from a line."""
    x, y = np.array(points).T
    return float(line.places(x, y)[2].max())


def _curve(previous: Point, begin: Point, line: Polyline, place: float) -> list[Point]:
    """Points of a cubic Bezier curve from `begin`, reached from `previous`, to a `place` (m) on a line."""
    x, y, direction = line.at(place)
    reach = CONTROL * math.dist(begin, (x, y))
    ahead = direction_between(previous, begin)
    controls = (
        begin,
        (begin[0] + reach * math.cos(ahead), begin[1] + reach * math.sin(ahead)),
        (x - reach * math.cos(direction), y - reach * math.sin(direction)),
        (x, y),
    )
    points = []
    for k in range(1, PIECES + 1):
        u = k / PIECES
        weights = (1.0 - u) ** 3, 3.0 * u * (1.0 - u) ** 2, 3.0 * u * u * (1.0 - u), u**3
        points.append(
            (
                sum(w * c[0] for w, c in zip(weights, controls, strict=True)),
                sum(w * c[1] for w, c in zip(weights, controls, strict=True)),
            )
        )
    return points
