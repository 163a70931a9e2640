"""Ways of persons across the walking areas of junctions, whose outlines bend around corners."""

import math

import numpy as np

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
    first, second = np.triu_indices(len(nodes), 1)
    lengths = np.full((len(nodes), len(nodes)), np.inf)
    lengths[first, second] = lengths[second, first] = np.hypot(*(nodes[first] - nodes[second]).T) * (
        1.0 + OUTSIDE * _outside(outline, nodes[first], nodes[second])
    )
    # Bellman-Ford; ways of fewer segments stay at the begin, at no cost.
    lengths[0, 0] = 0.0
    distance = lengths[0]
    shorter = np.min(distance[:, None] + lengths, axis=0)
    while (shorter < distance).any():
        distance, shorter = shorter, np.min(shorter[:, None] + lengths, axis=0)
    previous = np.argmin(distance[:, None] + lengths, axis=0).tolist()
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
    corners, signed = len(outline), np.empty(len(places))
    for place in range(len(places)):
        least, inside = math.inf, False
        for corner in range(corners):
            following = corner + 1 if corner + 1 < corners else 0
            side_x, side_y = outline[following, 0] - outline[corner, 0], outline[following, 1] - outline[corner, 1]
            x, y = places[place, 0] - outline[corner, 0], places[place, 1] - outline[corner, 1]
            along = (x * side_x + y * side_y) / max(side_x * side_x + side_y * side_y, 1e-9)
            along = min(max(along, 0.0), 1.0)
            aside_x, aside_y = x - along * side_x, y - along * side_y
            least = min(least, aside_x * aside_x + aside_y * aside_y)
            # Inside, a ray to the right crosses the outline an odd number of times.
            if (y >= 0.0) != (y >= side_y) and (side_x * y - side_y * x > 0.0) == (side_y > 0.0):
                inside = not inside
        signed[place] = -math.sqrt(least) if inside else math.sqrt(least)
    return signed


def _bends(outline: Floats, clearance: float) -> Floats:
    """Places inside, `clearance` (m) from the corners that point inwards, (k, 2)."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    (x, y), (next_x, next_y) = outline.T, np.roll(outline, -1, axis=0).T
    counterclockwise = np.sign(np.sum(x * next_y - next_x * y))
    inwards = counterclockwise * (before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) < 0.0
    before, after = (one / np.maximum(np.hypot(*one.T), 1e-6)[:, None] for one in (before, after))
    normals = counterclockwise * np.stack([-(before + after)[:, 1], (before + after)[:, 0]], axis=1)
    # Keep `clearance` from both sides: the sharper the corner, the shorter the sum of their normals.
    moved = outline + clearance * normals / np.maximum(0.5 * np.sum(normals**2, axis=1), 0.25)[:, None]
    bends: Floats = moved[inwards]
    return bends


def _outside(outline: Floats, begin: Floats, end: Floats) -> Floats:
    """Share of each of n straight ways, from `begin` to `end` (n, 2), that lies outside an outline, (n,)."""
    most = float(np.max(np.hypot(*(end - begin).T), initial=0.0))
    share = np.linspace(0.0, 1.0, 2 + int(most / SPACING))[:, None]
    places = begin[:, None] + share * (end - begin)[:, None]
    apart = distance_to(outline, places.reshape(-1, 2)).reshape(len(begin), -1)
    share_outside: Floats = np.mean(apart > ON_OUTLINE, axis=1)
    return share_outside
