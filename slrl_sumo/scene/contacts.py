"""Pairs of road users that are close to, or overlap, each other."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, boxes_overlap
from slrl_sumo.scene.state import WorldState

COLLISION_DISTANCE = 0.5
"""Distance (m) of centres below which the paper defines a collision (section 4.1)."""

FEW = 150
"""Greatest number of road users for which all pairs are compared: 22,500 distances take less time than a search."""

Pairs = NDArray[np.intp]


def close_pairs(world: WorldState, distance: float) -> Pairs:
    """Pairs of road users whose centres are closer than `distance` (m): (p, 2) row indices, sorted, smaller first."""
    return pairs_in_reach(world, np.full(len(world), 0.5 * distance))


def pairs_in_reach(world: WorldState, reach: Floats) -> Pairs:
    """Pairs of n road users whose centres are closer than the sum of their `reach` (m, (n,)): (p, 2) row indices,
    sorted, smaller first."""
    if len(world) < 2:
        return np.zeros((0, 2), np.intp)
    few = len(world) <= FEW
    if few:
        dx, dy = world.x[:, None] - world.x, world.y[:, None] - world.y
        pairs = np.argwhere(dx * dx + dy * dy < (1.001 * (reach[:, None] + reach)) ** 2)
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    else:
        # Only the remaining pairs are sorted: all pairs within the greatest reach took 15 instead of 5 ms (1,024 in
        # `district`).
        a, b = _near(world.x, world.y, 2.0 * float(reach.max())).T
        dx, dy = world.x[a] - world.x[b], world.y[a] - world.y[b]
        near = dx * dx + dy * dy < (1.001 * (reach[a] + reach[b])) ** 2
        pairs = np.sort(np.stack([a[near], b[near]], axis=1), axis=1)
    pairs = pairs[_apart(world, pairs) < reach[pairs].sum(axis=1)]
    return np.asarray(pairs if few else pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def colliding_pairs(world: WorldState) -> Pairs:
    """Pairs in a paper collision: centres closer than 0.5 m. (p, 2), sorted."""
    return close_pairs(world, COLLISION_DISTANCE)


def contact_pairs(world: WorldState) -> tuple[Pairs, Pairs]:
    """`colliding_pairs`, and the pairs whose boxes intersect, (p, 2), sorted, from one search."""
    reach = np.maximum(0.5 * np.hypot(world.length, world.width) + 0.01, 0.5 * COLLISION_DISTANCE)
    pairs = pairs_in_reach(world, reach)
    boxes = np.column_stack([world.x, world.y, world.heading, world.length, world.width])
    a, b = pairs.T
    return pairs[_apart(world, pairs) < COLLISION_DISTANCE], pairs[boxes_overlap(boxes[a], boxes[b])]


def ids_of(pairs: Pairs, world: WorldState) -> set[tuple[str, str]]:
    """Pairs of rows of `world` (p, 2) as pairs of ids, in the same order."""
    return {(world.ids[i], world.ids[j]) for i, j in pairs.tolist()}


def _apart(world: WorldState, pairs: Pairs) -> Floats:
    """Distances (m) of the centres of each pair, (p,)."""
    a, b = pairs.T
    return np.asarray(np.hypot(world.x[a] - world.x[b], world.y[a] - world.y[b]))


def _near(x: Floats, y: Floats, distance: float) -> Pairs:
    """All pairs of points at most `distance` apart, once each, and some pairs slightly farther apart: (p, 2).

    The plane is cut into strips of the height `distance`, which are sorted one after the other: neighbours of a point
    are close to it in its own strip or in the next strip. A tree would need scipy (0.2 s and 40 MiB), which the
    counting process does not use otherwise.
    """
    strip = np.floor((y - y.min()) / distance)
    length = np.ptp(x) + 3 * distance
    place = strip * length + (x - x.min())
    order = np.argsort(place)
    place = place[order]
    beside = listed_ranges(np.arange(1, len(x) + 1), np.searchsorted(place, place + 1.01 * distance))
    above = listed_ranges(
        np.searchsorted(place, place + length - 1.01 * distance),
        np.searchsorted(place, place + length + 1.01 * distance),
    )
    return np.asarray(order[np.concatenate([beside, above])])


def listed_ranges(begin: NDArray[np.intp], end: NDArray[np.intp]) -> Pairs:
    """The integers of ranges, (p, 2): index of the range, and the integer."""
    count = np.maximum(end - begin, 0)
    which = np.repeat(np.arange(len(count)), count)
    return np.stack([which, np.arange(len(which)) + (begin - np.cumsum(count) + count)[which]], axis=1)
