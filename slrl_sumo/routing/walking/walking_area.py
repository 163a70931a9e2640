"""Ways of persons across the walking areas of junctions, whose outlines bend around corners."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats

ON_OUTLINE = 0.1
"""Distance (m) outside an outline that counts as inside: sidewalks and crossings end on outlines."""
SPACING = 0.5
"""Spacing (m) of the positions that are checked along a way."""
BACK = 0.5
"""Distance (m) inside the edge of a walking area at which persons wait for a crossing: at round corners, crossings
begin beyond the edge, in the way of right-turning vehicles."""
OUTSIDE = 10.0
"""Factor for each metre outside. A way inside may not exist: netconvert's outlines can intersect themselves at sharp
corners, and then nothing is inside for some metres."""


def way_across(
    outline: Floats, begin: tuple[float, float], end: tuple[float, float], clearance: float
) -> list[tuple[float, float]]:
    """Corners of the shortest way between two places (m) inside an outline (k, 2), without these two places.

    The way keeps `clearance` (m) from the corners of the outline around which it bends.
    """
    ends = np.array([begin, end])
    if not _outside(outline, ends[:1], ends[1:])[0]:
        return []
    nodes = np.concatenate([ends, _bends(outline, clearance)])
    previous = _previous(outline, nodes).tolist()
    chain: list[int] = [previous[1]]
    while chain[-1] != 0:
        chain.append(previous[chain[-1]])
    return [(x, y) for x, y in nodes[chain[-2::-1]].tolist()]


def back_from(outline: Floats, x: float, y: float, depth: float = BACK) -> tuple[float, float] | None:
    """The place `depth` (m) inside an outline (k, 2) near a position; None if the position is at least as far
    inside."""
    away = distance_to(outline, np.array([[x, y]])).item()
    if away <= -depth or abs(away) < 1e-6:
        return None
    parts = np.roll(outline, -1, axis=0) - outline
    share = np.sum(([x, y] - outline) * parts, axis=1) / np.maximum(np.sum(parts * parts, axis=1), 1e-9)
    places = outline + np.clip(share, 0.0, 1.0)[:, None] * parts
    near_x, near_y = places[np.hypot(*(places - [x, y]).T).argmin()].tolist()
    # Continue the line from the position to the nearest place of the outline, to the inside.
    return near_x - depth * (x - near_x) / away, near_y - depth * (y - near_y) / away


def distance_to(outline: Floats, places: Floats) -> Floats:
    """Distances (m) from an outline (k, 2) to places (n, 2), negative inside, (n,)."""
    return _distances(np.ascontiguousarray(outline), np.ascontiguousarray(places))


@compiled
def _distances(outline: Floats, places: Floats) -> Floats:
    signed = np.empty(len(places))
    for place in range(len(places)):
        signed[place] = _distance(outline, places[place, 0], places[place, 1])
    return signed


@compiled
def _distance(outline: Floats, place_x: float, place_y: float) -> float:
    """Distance (m) from an outline to a place, negative inside."""
    corners, least, inside = len(outline), math.inf, False
    for corner in range(corners):
        following = corner + 1 if corner + 1 < corners else 0
        side_x, side_y = outline[following, 0] - outline[corner, 0], outline[following, 1] - outline[corner, 1]
        x, y = place_x - outline[corner, 0], place_y - outline[corner, 1]
        along = (x * side_x + y * side_y) / max(side_x * side_x + side_y * side_y, 1e-9)
        along = min(max(along, 0.0), 1.0)
        aside_x, aside_y = x - along * side_x, y - along * side_y
        least = min(least, aside_x * aside_x + aside_y * aside_y)
        # Inside, a ray to the right crosses the outline an odd number of times.
        if (y >= 0.0) != (y >= side_y) and (side_x * y - side_y * x > 0.0) == (side_y > 0.0):
            inside = not inside
    return -math.sqrt(least) if inside else math.sqrt(least)


@compiled
def _bends(outline: Floats, clearance: float) -> Floats:
    """Places inside, `clearance` (m) from the corners that point inwards, (k, 2)."""
    corners, area = len(outline), 0.0
    for corner in range(corners):
        following = corner + 1 if corner + 1 < corners else 0
        area += outline[corner, 0] * outline[following, 1] - outline[following, 0] * outline[corner, 1]
    counterclockwise = math.copysign(1.0, area)
    bends, found = np.empty((corners, 2)), 0
    for corner in range(corners):
        following = corner + 1 if corner + 1 < corners else 0
        before_x, before_y = outline[corner, 0] - outline[corner - 1, 0], outline[corner, 1] - outline[corner - 1, 1]
        after_x, after_y = outline[following, 0] - outline[corner, 0], outline[following, 1] - outline[corner, 1]
        if counterclockwise * (before_x * after_y - before_y * after_x) >= 0.0:
            continue
        before = max(math.hypot(before_x, before_y), 1e-6)
        after = max(math.hypot(after_x, after_y), 1e-6)
        normal_x = counterclockwise * -(before_y / before + after_y / after)
        normal_y = counterclockwise * (before_x / before + after_x / after)
        # Keep `clearance` from both sides: the sharper the corner, the shorter the sum of their normals.
        short = max(0.5 * (normal_x * normal_x + normal_y * normal_y), 0.25)
        bends[found, 0] = outline[corner, 0] + clearance * normal_x / short
        bends[found, 1] = outline[corner, 1] + clearance * normal_y / short
        found += 1
    return bends[:found]


@compiled
def _previous(outline: Floats, nodes: Floats) -> NDArray[np.intp]:
    """The node before each of n nodes (n, 2) on the shortest way from the first node, (n,)."""
    n, pair = len(nodes), 0
    begin, end = np.empty((n * (n - 1) // 2, 2)), np.empty((n * (n - 1) // 2, 2))
    for first in range(n):
        for second in range(first + 1, n):
            begin[pair, 0], begin[pair, 1] = nodes[first, 0], nodes[first, 1]
            end[pair, 0], end[pair, 1] = nodes[second, 0], nodes[second, 1]
            pair += 1
    outside, lengths, pair = _outside(outline, begin, end), np.full((n, n), np.inf), 0
    for first in range(n):
        for second in range(first + 1, n):
            straight = math.hypot(begin[pair, 0] - end[pair, 0], begin[pair, 1] - end[pair, 1])
            lengths[first, second] = lengths[second, first] = straight * (1.0 + OUTSIDE * outside[pair])
            pair += 1
    # Bellman-Ford; ways of fewer segments stay at the begin, at no cost.
    lengths[0, 0] = 0.0
    distance, previous, shortened = np.full(n, np.inf), np.zeros(n, np.intp), True
    distance[0] = 0.0
    while shortened:
        known, shortened = distance.copy(), False
        for node in range(n):
            for before in range(n):
                if known[before] + lengths[before, node] < distance[node]:
                    distance[node], previous[node], shortened = known[before] + lengths[before, node], before, True
    return previous


@compiled
def _outside(outline: Floats, begin: Floats, end: Floats) -> Floats:
    """Share of each of n straight ways, from `begin` to `end` (n, 2), that lies outside an outline, (n,)."""
    most = 0.0
    for way in range(len(begin)):
        most = max(most, math.hypot(end[way, 0] - begin[way, 0], end[way, 1] - begin[way, 1]))
    steps, share = 1 + int(most / SPACING), np.empty(len(begin))
    for way in range(len(begin)):
        x, y, outside = begin[way, 0], begin[way, 1], 0
        for step in range(steps + 1):
            part = step / steps
            place_x, place_y = x + part * (end[way, 0] - x), y + part * (end[way, 1] - y)
            outside += _distance(outline, place_x, place_y) > ON_OUTLINE
        share[way] = outside / (steps + 1)
    return share
