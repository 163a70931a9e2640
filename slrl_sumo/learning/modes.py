"""Modes: clusters of where road users of one type are 12 intervals later (paper, section 3.2)."""

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

from slrl_sumo.errors import InputError
from slrl_sumo.world.geometry import Floats

ENOUGH = 200_000
"""Distinct destinations beyond which K-Means sees a random share: 20 centres in the plane need no more."""


def cluster(destinations: Floats, k: int, seed: int, name: str = "road user") -> Floats:
    """Centres (k, 2) of K-Means over destinations (N, 2), both m in the ego frame.

    Sorted by distance from the road user, then by angle, and rounded to mm, so that the same data and seed give the
    same centres whatever the number of threads. Raises InputError where there are fewer than k distinct destinations;
    `name` is the type that its message names.
    """
    destinations = np.asarray(destinations, np.float64)
    # To the mm, standing road users share one destination: counted once, with its weight, it can neither hide how
    # little else there is nor crowd the others out of a random share.
    distinct, weight = np.unique(np.round(destinations, 3), axis=0, return_counts=True)
    if len(distinct) < k:
        raise InputError(
            f"{name}: {len(distinct)} distinct destinations in the recordings, {k} modes need at least {k}; "
            f"add recordings with more {name} tracks of 6 s and longer"
        )
    if len(distinct) > ENOUGH:
        rows = np.random.default_rng(seed).choice(len(distinct), ENOUGH, replace=False)
        distinct, weight = distinct[rows], weight[rows]
    found: Floats = KMeans(k, n_init=4, random_state=seed).fit(distinct, sample_weight=weight).cluster_centers_
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
