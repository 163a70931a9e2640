"""Modes: clusters of the destinations of road users of one type after 12 intervals (paper, section 3.2)."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

ENOUGH = 200_000
"""Number of distinct destinations above which K-Means uses a random sample: 20 centres in the plane need no more."""

BALANCE = 0.5
"""Balanced clustering gives a cell of n destinations the weight of n to the power of 1 - BALANCE."""

BEARING_BOUNDS = np.radians([-75.0, -45.0, -20.0, -7.0, 7.0, 20.0, 45.0, 75.0])
"""Bounds between the cells of bearings, rad."""

SPEED_CELLS = 6

GENTLE = {RoadUserType.CAR: 0.75, RoadUserType.BICYCLE: 0.5}
"""Exponent of the distance in the weight of curvature: in 4.8 s, cars drive so far that a gentle curve shifts them by
the width of a lane."""

BEND_WEIGHT = {RoadUserType.CAR: 0.22, RoadUserType.BICYCLE: 0.13}
"""Curvature (1/m) times this power of the distance (m) with the same weight as the difference of 4 m and 9 m."""

CURVATURE_INTERVALS = 5
"""Number of intervals (2 s) over which the curvature is measured."""

AT_PRESENT = 3
"""Number of intervals (1.2 s) over which relative accelerations are measured: turns at corners take hardly longer, and
means over 2 s smooth these turns."""

SHORT_PATH = 2.0
"""Length (m) below which the curvature of a path is unreliable."""

SPEED_BIN, FEWEST = 1.0, 300
"""Width (m/s) and least number of windows of the speed bins for ranges of accelerations."""
EXTREME = 99.5
"""Percentile that counts as nearly the highest value."""
LEAST_RANGE = 0.1
"""Smallest range, m/s²."""
CELL, EVENLY = 0.2, 0.9
"""Size of the cells of `balance_accelerations`, and its exponent: a cell of n windows has the weight of n to the power
of 1 - EVENLY."""
MOST_ACCELERATION = 1.3
"""Bound to which relative accelerations are clipped, so that outliers do not become modes."""


def balance(destinations: Floats, counts: NDArray[np.int64]) -> Floats:
    """Weights (N,) that reduce the differences in frequency of turning and straight, fast and slow motion.

    Destinations (N, 2) m, ego frame, that occur `counts` (N,) times are sorted into cells by bearing and distance
    (that is, speed), SPEED_CELLS of equal width up to the 99th percentile. The paper names the bias of K-Means towards
    straight motion as its first limitation (section 4.3).
    """
    far = np.hypot(destinations[:, 0], destinations[:, 1])
    width = max(float(np.percentile(np.repeat(far, counts), 99)) / SPEED_CELLS, 1e-3)
    ring = np.minimum(far / width, SPEED_CELLS - 1).astype(np.intp)
    turn = np.searchsorted(BEARING_BOUNDS, np.arctan2(destinations[:, 1], destinations[:, 0]))
    cell = ring * (len(BEARING_BOUNDS) + 1) + turn
    return np.asarray(counts * np.bincount(cell, counts)[cell] ** -BALANCE, np.float64)


def curved(destinations: Floats, near: Floats, kind: RoadUserType) -> Floats:
    """Next motion of cars or bicycles (`kind`) as root of the distance and weighted curvature, (N, 2).

    `destinations`: positions after 4.8 s, (N, 2) m, ego frame; `near`: positions after the first CURVATURE_INTERVALS
    intervals. The curvature is that of the circle tangent to the heading through `near`. In the plane, paths of 5 m to
    the left, to the right and straight on are close together, so that K-Means assigns them to one mode, which
    decelerates straight on, and no mode decelerates in a turn. A turn at a junction takes about half of the 4.8 s. The
    root makes the difference of 2 m and 5 m comparable to that of 40 m and 50 m."""
    distance, curvature = np.hypot(destinations[:, 0], destinations[:, 1]), _curvature(near)
    return np.stack([np.sqrt(distance), curvature * distance ** GENTLE[kind] / BEND_WEIGHT[kind]], -1)


Weigh = Callable[[Floats, NDArray[np.int64]], Floats]
"""Returns the weights of distinct points (N, 2) from their numbers of occurrences, (N,)."""


@dataclass(frozen=True, eq=False)
class AccelerationRanges:
    """Recorded ranges of accelerations of a type at each speed: the scale of `relative_accelerations`."""

    speeds: Floats
    """Speeds, m/s, (k,), rising."""
    forward: Floats
    """Nearly the highest acceleration, m/s², (k,)."""
    braking: Floats
    """Nearly the highest deceleration, m/s², (k,)."""
    lateral: Floats
    """Nearly the highest lateral acceleration to either side, m/s², (k,)."""

    def to_json(self) -> dict[str, list[float]]:
        """Plain values, for the training record of a bundle."""
        return {field.name: np.round(getattr(self, field.name), 4).tolist() for field in fields(self)}


def acceleration_ranges(speed: Floats, path: Floats) -> AccelerationRanges:
    """The ranges of windows at `speed` (N,) m/s with `path` (N, 12, 2) m, in bins of SPEED_BIN."""
    forward, lateral = _accelerations(speed, path)
    bins = (speed / SPEED_BIN).astype(np.intp)
    rows = [np.flatnonzero(bins == k) for k in range(int(bins.max(initial=0)) + 1)]
    # Empty and sparse bins at high speeds would make the extremes of few windows a scale.
    rows = [one for one in rows if len(one) >= FEWEST] or [np.arange(len(speed))]
    extremes = [
        (
            speed[one].mean(),
            np.percentile(forward[one], EXTREME),
            -np.percentile(forward[one], 100.0 - EXTREME),
            np.percentile(np.abs(lateral[one]), EXTREME),
        )
        for one in rows
    ]
    speeds, *ranges = np.array(extremes).T
    return AccelerationRanges(speeds, *(np.maximum(values, LEAST_RANGE) for values in ranges))


def relative_accelerations(speed: Floats, path: Floats, ranges: AccelerationRanges) -> Floats:
    """Mean acceleration and lateral acceleration of the first 1.2 s relative to recorded values at the speed, (N, 2).

    Clusters of these contain hard and gentle braking and no, moderate and full acceleration at each speed, each with
    fine and sharp steering. Clusters of destinations do not: at 12 m/s, gentle turns without braking are in one cluster
    with straight motion. The signed root of the lateral acceleration resolves fine steering. `speed` (N,) m/s, `path`
    (N, 12, 2) m.
    """
    forward, lateral = _accelerations(speed, path)
    highest = np.interp(speed, ranges.speeds, ranges.forward)
    hardest = np.interp(speed, ranges.speeds, ranges.braking)
    aside = lateral / np.interp(speed, ranges.speeds, ranges.lateral)
    along = np.where(forward > 0.0, forward / highest, forward / hardest)
    return np.stack(
        [
            np.clip(along, -MOST_ACCELERATION, MOST_ACCELERATION),
            np.clip(np.sign(aside) * np.sqrt(np.abs(aside)), -MOST_ACCELERATION, MOST_ACCELERATION),
        ],
        -1,
    )


def _accelerations(speed: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Mean acceleration and lateral acceleration (to the left) over AT_PRESENT intervals, m/s², (N,) each."""
    steps = np.diff(path[:, :AT_PRESENT], axis=1, prepend=0.0)
    length = np.hypot(steps[..., 0], steps[..., 1]).sum(1)
    time = AT_PRESENT * DECISION_INTERVAL
    # SUMO's Euler update: after k intervals v + k a dt, so that the distance is v t + a dt² (1 + ... + AT_PRESENT).
    forward = (length - speed * time) / (DECISION_INTERVAL**2 * AT_PRESENT * (AT_PRESENT + 1) / 2)
    return forward, _curvature(path[:, AT_PRESENT - 1]) * (length / time) ** 2


def _curvature(near: Floats) -> Floats:
    """Curvature (1/m, (N,)) of the circles tangent to the heading through the places `near` (N, 2) m, ego frame."""
    distance = np.hypot(near[:, 0], near[:, 1])
    return np.asarray(2.0 * np.sin(np.arctan2(near[:, 1], near[:, 0])) / np.maximum(distance, SHORT_PATH))


def balance_accelerations(relative: Floats, counts: NDArray[np.int64]) -> Floats:
    """Like `balance`, for relative accelerations (N, 2), sorted into square cells of CELL.

    It is needed because nearly all recorded motion is straight at nearly constant speed.
    """
    _, cell = np.unique(np.round(relative / CELL).astype(np.int64), axis=0, return_inverse=True)
    return np.asarray(counts * np.bincount(cell, counts)[cell] ** -EVENLY, np.float64)


def cluster(
    destinations: Floats,
    k: int,
    seed: int,
    name: str = "road user",
    *,
    weigh: Weigh | None = None,
) -> Floats:
    """Centres (k, 2) of K-Means over destinations (N, 2), both m in the ego frame, or over relative accelerations;
    `weigh`: `balance`, or `balance_accelerations`.

    Sorted by distance from the road user, then by angle, and rounded to mm, so that the same data and seed give the
    same centres for any number of threads. Raises InputError for fewer than k distinct destinations; `name`: type in
    the message.
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
    weights = weigh(distinct, weight) if weigh else weight
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
