"""Distributions of motion by road user type, and distances between them."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

QUANTITIES = {"speed": "m/s", "acceleration": "m/s²", "yaw_rate": "rad/s"}
"""Compared quantities and their units."""
EDGES: Mapping[str, tuple[Floats, ...]] = {
    "speed": (np.linspace(0.0, 20.0, 41), np.linspace(0.0, 10.0, 41), np.linspace(0.0, 3.0, 31)),
    "acceleration": (np.linspace(-6.0, 6.0, 50),) * 2 + (np.linspace(-3.0, 3.0, 32),),
    "yaw_rate": (np.linspace(-1.0, 1.0, 42),) * 2 + (np.linspace(-3.0, 3.0, 32),),
}
"""Edges of the bins by quantity and RoadUserType, in the quantity's unit: 40 or 49, for pedestrians 30 or 31 bins. 0
lies in the middle of a bin, or at the end of the first bin, so that rounding does not move it to another bin. Values
outside the edges count in the outer bins."""


Kinematics = Mapping[str, tuple[Floats, ...]]
"""Values by quantity and RoadUserType."""


def kinematics(trajectories: Trajectories, tracks: NDArray[np.bool_] | None = None) -> Kinematics:
    """Speed (m/s), acceleration (m/s²) and yaw rate (rad/s) of all rows with known values, by RoadUserType.

    They are backward differences over dt: a track has a speed and a yaw rate from its second row on, and an
    acceleration from its third row on. Parked road users, and road users not in `tracks`, (T,), if given, are left out.
    """
    t = trajectories
    since = t.frame - t.frame[t.starts[t.track]]
    counted = (~t.parked if tracks is None else tracks & ~t.parked)[t.track]
    kind = t.type[t.track]
    return {
        name: tuple(values[counted & (kind == k) & (since >= known)] for k in range(len(TYPE_NAMES)))
        for name, values, known in (
            ("speed", t.speed, 1),
            ("acceleration", t.acceleration, 2),
            ("yaw_rate", t.yaw_rate, 1),
        )
    }


def jensen_shannon_distance(*, a: Floats, b: Floats, edges: Floats) -> float:
    """Distance of two samples as histograms over `edges`: the root of the Jensen-Shannon divergence to base 2.

    It is 0 for equal histograms and 1 for histograms without a common bin; no unit; a metric (Endres and Schindelin
    2003; divergence: Lin 1991). `a` (n,), `b` (m,) and `edges` (k + 1,) in one unit; values outside the edges count in
    the outer bins. It depends on the bins: compare only figures with the same bins. Raises ValueError for an empty
    sample.
    """
    if not len(a) or not len(b):
        raise ValueError("an empty sample has no distribution")
    return math.sqrt(divergence(histogram(a, edges), histogram(b, edges)))


def kinematic_distances(ours: Kinematics, theirs: Kinematics) -> dict[str, dict[str, float | None]]:
    """Jensen-Shannon distances over EDGES by type name and quantity; None for types without values in either."""
    return {
        name: {
            quantity: jensen_shannon_distance(a=ours[quantity][k], b=theirs[quantity][k], edges=EDGES[quantity][k])
            if len(ours[quantity][k]) and len(theirs[quantity][k])
            else None
            for quantity in QUANTITIES
        }
        for k, name in enumerate(TYPE_NAMES)
    }


def histogram(values: Floats, edges: Floats) -> Floats:
    """Share of the values in each bin, (k,); values outside the edges (k + 1,) count in the outer bins."""
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    return np.asarray(counts / max(len(values), 1), np.float64)


def divergence(p: Floats, q: Floats) -> float:
    """Jensen-Shannon divergence of two histograms (k,) that each add up to 1, in bits: from 0 to 1."""
    middle = 0.5 * (p + q)
    return min(max(0.5 * (_relative_entropy(p, middle) + _relative_entropy(q, middle)), 0.0), 1.0)


def _relative_entropy(p: Floats, q: Floats) -> float:
    """Kullback-Leibler divergence in bits of histograms; q is positive wherever p is."""
    known = p > 0.0
    return float((p[known] * np.log2(p[known] / q[known])).sum())
