"""Modes: clusters of where road users of one type are 12 intervals later (paper, section 3.2)."""

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

ENOUGH = 200_000
"""Distinct destinations beyond which K-Means uses a random sample: 20 centres in the plane need no more."""

BALANCE = 0.5
"""Balanced clustering gives a cell of n destinations the weight of n to the power of 1 - BALANCE."""

TURNS = np.radians([-75.0, -45.0, -20.0, -7.0, 7.0, 20.0, 45.0, 75.0])
"""Bounds between the cells of bearings, rad."""

SPEED_CELLS = 6

GENTLE = {RoadUserType.CAR: 0.75, RoadUserType.BICYCLE: 0.5}
"""Exponent of the distance by which curvature is weighted: cars go far in 4.8 s, where a gentle curve shifts them by a
lane's width."""

BEND = {RoadUserType.CAR: 0.22, RoadUserType.BICYCLE: 0.13}
"""Curvature (1/m) times that power of the distance (m) that weighs as much as the difference of 4 m and 9 m."""

AT_ONCE = 5
"""Intervals, 2 s, over which the curvature is measured."""

SHORT = 2.0
"""m below which the curvature of a path is unreliable."""


def balance(destinations: Floats, counts: NDArray[np.int64]) -> Floats:
    """Weights (N,) that bring the frequencies of turning and going straight, fast and slow closer together.

    Destinations (N, 2) m, ego frame, that occur `counts` (N,) times are sorted into cells by bearing and distance
    (that is, speed), SPEED_CELLS of equal width up to the 99th percentile. The paper names the bias of
    K-Means towards going straight as its first limitation (section 4.3).
    """
    far = np.hypot(destinations[:, 0], destinations[:, 1])
    width = max(float(np.percentile(np.repeat(far, counts), 99)) / SPEED_CELLS, 1e-3)
    ring = np.minimum(far / width, SPEED_CELLS - 1).astype(np.intp)
    turn = np.searchsorted(TURNS, np.arctan2(destinations[:, 1], destinations[:, 0]))
    cell = ring * (len(TURNS) + 1) + turn
    return np.asarray(counts * np.bincount(cell, counts)[cell] ** -BALANCE, np.float64)


def curved(destinations: Floats, near: Floats, kind: RoadUserType) -> Floats:
    """Next motion of cars or bicycles (`kind`) as root of the distance and weighted curvature, (N, 2).

    `destinations`: positions after 4.8 s, (N, 2) m, ego frame; `near`: positions after the first AT_ONCE intervals. The
    curvature is that of the circle tangent to the heading through `near`. In the plane, paths of 5 m to the left, to
    the right and straight on are close together, so that K-Means puts them into one mode, which decelerates straight
    on, and no mode decelerates in a turn. A turn at a junction takes about half of the 4.8 s. Roots of distances,
    because 2 m and 5 m differ as much as 40 m and 50 m."""
    distance, first = (np.hypot(place[:, 0], place[:, 1]) for place in (destinations, near))
    curvature = 2.0 * np.sin(np.arctan2(near[:, 1], near[:, 0])) / np.maximum(first, SHORT)
    return np.stack([np.sqrt(distance), curvature * distance ** GENTLE[kind] / BEND[kind]], -1)


def cluster(destinations: Floats, k: int, seed: int, name: str = "road user", *, balanced: bool = False) -> Floats:
    """Centres (k, 2) of K-Means over destinations (N, 2), both m in the ego frame; `balanced`: see `balance`.

    Sorted by distance from the road user, then by angle, and rounded to mm, so that the same data and seed give the
    same centres whatever the number of threads. Raises InputError where there are fewer than k distinct destinations;
    `name` is the type that its message names.
    """
    destinations = np.asarray(destinations, np.float64)
    # Rounded to mm, standing road users share one destination: counted once, with its weight, it neither hides a lack
    # of other destinations nor displaces them in a random sample.
    distinct, weight = np.unique(np.round(destinations, 3), axis=0, return_counts=True)
    if len(distinct) < k:
        raise InputError(
            f"{name}: {len(distinct)} distinct destinations in the recordings, {k} modes need at least {k}; "
            f"add recordings with more {name} tracks of 6 s and longer"
        )
    if len(distinct) > ENOUGH:
        rows = np.random.default_rng(seed).choice(len(distinct), ENOUGH, replace=False)
        distinct, weight = distinct[rows], weight[rows]
    weights = balance(distinct, weight) if balanced else weight
    found: Floats = KMeans(k, n_init=4, random_state=seed).fit(distinct, sample_weight=weights).cluster_centers_
    centres = np.round(found, 3) + 0.0  # + 0.0 makes -0.0 plain 0.0
    order = np.lexsort((np.arctan2(centres[:, 1], centres[:, 0]), np.hypot(centres[:, 0], centres[:, 1])))
    return np.asarray(centres[order], np.float64)


def assign(destinations: Floats, centres: Floats) -> NDArray[np.int64]:
    """The mode of each destination, (N,): the nearest of the centres (k, 2). `destinations` (N, 2), both m."""
    nearest = np.zeros(len(destinations), np.int64)
    best = np.full(len(destinations), np.inf)
    for mode, centre in enumerate(centres):  # k passes over N keep the memory at N
        distance = ((destinations - centre) ** 2).sum(-1)
        closer = distance < best
        nearest[closer], best[closer] = mode, distance[closer]
    return nearest
