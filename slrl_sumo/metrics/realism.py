"""Realism of simulated road users: a score modelled on the Waymo Open Sim Agents Challenge."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.conflicts import boxes, velocities
from slrl_sumo.metrics.neighbours import row_pairs
from slrl_sumo.metrics.road_edge import edge_distance
from slrl_sumo.metrics.surrogate_safety import box_distance, time_to_collision
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

LONGEST_TTC = 5.0
"""s; longer ones, and none, count as this."""
FARTHEST = 40.0
"""m; neighbours farther away, and none, count as this far."""
NEIGHBOURS = 6
"""Number of road users, the nearest by their centres, among which the nearest box is searched."""
SMOOTHING = 0.1
"""Added to the count of each bin, so that values that were never simulated are unlikely, not impossible."""


@dataclass(frozen=True)
class Feature:
    """What a feature is compared over: `bins` bins from `low` to `high` in `unit`, with a weight."""

    group: str
    """kinematic, interactive or map."""
    unit: str
    low: float
    high: float
    bins: int
    weight: float


FEATURES: Mapping[str, Feature] = {
    "speed": Feature("kinematic", "m/s", 0.0, 25.0, 25, 0.05),
    "acceleration": Feature("kinematic", "m/s²", -12.0, 12.0, 49, 0.05),
    "yaw_rate": Feature("kinematic", "rad/s", -2.0, 2.0, 41, 0.05),
    "yaw_acceleration": Feature("kinematic", "rad/s²", -4.0, 4.0, 41, 0.05),
    "nearest": Feature("interactive", "m", -5.0, FARTHEST, 45, 0.10),
    "overlap": Feature("interactive", "1", 0.0, 1.0, 2, 0.25),
    "ttc": Feature("interactive", "s", 0.0, LONGEST_TTC, 10, 0.10),
    "road_edge": Feature("map", "m", -10.0, 10.0, 40, 0.10),
    "off_surface": Feature("map", "1", 0.0, 1.0, 2, 0.25),
}
"""Weights as in the challenge; bins finer, because cyclists and pedestrians move in the lowest of its bins."""


@dataclass(frozen=True)
class Realism:
    """Scores in (0, 1]; 1 where the simulated distribution is the reference's."""

    score: float
    """Weighted mean over the features that were compared."""
    features: dict[str, float]
    """By feature."""
    groups: dict[str, float]
    """Weighted means over kinematic, interactive and map features; without the map there are no map features."""


def realism(
    *,
    simulated: Trajectories,
    reference: Trajectories,
    tracks: NDArray[np.bool_] | None = None,
    reference_tracks: NDArray[np.bool_] | None = None,
    shapes: SurfaceShapes | None = None,
    reference_shapes: SurfaceShapes | None = None,
) -> dict[str, Realism]:
    """The realism of simulated road users against a reference, by type name; types that one of them lacks are left out.

    Montali et al. (2023), The Waymo Open Sim Agents Challenge, asks how likely what was recorded is under the
    distribution of what was simulated, feature by feature (kinematic, interactive and map features; FEATURES), and
    takes a weighted mean. So does this, with three differences: the distributions are those of all road users of a type
    at all times, not of one road user in 32 rollouts of one scene; the likelihood is divided by that of the reference
    under its own distribution, so that 1 can be reached: it is exp(-KL(reference || simulated)); and the time to
    collision is that of boxes in the plane, towards any road user. The scores are not
    comparable with those of the challenge.

    With `tracks` and `reference_tracks`, (T,), only those road users count; the others are still seen by them.

    Map features need the ground, in m and in the coordinates of the tracks, of both: `shapes`, and `reference_shapes`
    where the reference was recorded somewhere else.
    """
    grounds = (None, None) if shapes is None else (shapes, reference_shapes or shapes)
    own = _by_row(simulated, grounds[0])
    # Two groups of one run share their features.
    same = reference is simulated and grounds[1] is grounds[0]
    other = own if same else _by_row(reference, grounds[1])
    ours, theirs = _by_type(simulated, own, tracks), _by_type(reference, other, reference_tracks)
    result = {}
    for k, name in enumerate(TYPE_NAMES):
        scores = {
            feature: _likelihood(theirs[feature][k], ours[feature][k], FEATURES[feature])
            for feature in ours
            if len(ours[feature][k]) and len(theirs[feature][k])
        }
        if scores:
            groups = dict.fromkeys(FEATURES[feature].group for feature in scores)
            result[name] = Realism(
                score=_mean(scores),
                features=scores,
                groups={g: _mean({f: s for f, s in scores.items() if FEATURES[f].group == g}) for g in groups},
            )
    return result


def features(
    trajectories: Trajectories, shapes: SurfaceShapes | None, tracks: NDArray[np.bool_] | None = None
) -> dict[str, tuple[Floats, ...]]:
    """The features at all moments at which they are known, by name and RoadUserType, in the units of FEATURES."""
    return _by_type(trajectories, _by_row(trajectories, shapes), tracks)


def _by_row(t: Trajectories, shapes: SurfaceShapes | None) -> dict[str, tuple[Floats, int]]:
    """Features of each row, (R,), and from which row of a track on they are known."""
    change = np.diff(t.yaw_rate, prepend=0.0) / t.dt
    nearest = nearest_distance(t)
    values = {
        "speed": (t.speed, 1),
        "acceleration": (t.acceleration, 2),
        "yaw_rate": (t.yaw_rate, 1),
        "yaw_acceleration": (change, 2),
        "nearest": (nearest, 0),
        "overlap": ((nearest <= 0.0).astype(np.float64), 0),
        "ttc": (shortest_ttc(t), 1),
    }
    if shapes is not None:
        edge = edge_distance(shapes=shapes, x=t.x, y=t.y, kind=t.type[t.track])
        values |= {"road_edge": (edge, 0), "off_surface": ((edge > 0.0).astype(np.float64), 0)}
    return values


def _by_type(
    t: Trajectories, values: dict[str, tuple[Floats, int]], tracks: NDArray[np.bool_] | None
) -> dict[str, tuple[Floats, ...]]:
    since = t.frame - t.frame[t.starts[t.track]]
    counted = (~t.parked if tracks is None else tracks & ~t.parked)[t.track]
    kind = t.type[t.track]
    return {
        name: tuple(v[counted & (kind == k) & (since >= known)] for k in range(len(TYPE_NAMES)))
        for name, (v, known) in values.items()
    }


def nearest_distance(trajectories: Trajectories) -> Floats:
    """Distance from box to box of the nearest other road user at the time, m, (R,), at most FARTHEST; negative in
    overlap."""
    t = trajectories
    nearest = np.full(len(t), FARTHEST)
    if not len(t):
        return nearest
    box = boxes(t)
    apart = 4.0 * FARTHEST
    points = np.column_stack([t.x, t.y, (t.frame - t.frame.min()) * apart])
    count = min(NEIGHBOURS + 1, len(t))
    _, index = cKDTree(points).query(points, k=count, distance_upper_bound=2.0 * FARTHEST)
    index = np.asarray(index).reshape(len(t), count)
    rows = np.arange(len(t))
    for column in index.T:
        some = np.flatnonzero((column < len(t)) & (column != rows))
        nearest[some] = np.minimum(nearest[some], box_distance(a=box[some], b=box[column[some]]))
    return nearest


def shortest_ttc(trajectories: Trajectories) -> Floats:
    """Shortest time to collision with any road user, s, (R,), at most LONGEST_TTC."""
    t = trajectories
    box, velocity = boxes(t), velocities(t)
    shortest = np.full(len(t), LONGEST_TTC)
    reach = 0.5 * np.hypot(box[:, 3], box[:, 4]) + LONGEST_TTC * np.hypot(velocity[:, 0], velocity[:, 1])
    for i, j in row_pairs(x=t.x, y=t.y, frame=t.frame, reach=reach):
        ttc = time_to_collision(a=box[i], b=box[j], velocity_a=velocity[i], velocity_b=velocity[j])
        for rows in (i, j):
            np.minimum.at(shortest, rows, ttc)
    return shortest


def _likelihood(reference: Floats, simulated: Floats, feature: Feature) -> float:
    """exp(-KL(reference || simulated)) of smoothed histograms."""
    edges = np.linspace(feature.low, feature.high, feature.bins + 1)
    p, q = (_smoothed(values, edges) for values in (reference, simulated))
    return float(np.exp(-(p * np.log(p / q)).sum()))


def _smoothed(values: Floats, edges: Floats) -> Floats:
    counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0] + SMOOTHING
    return np.asarray(counts / counts.sum(), np.float64)


def _mean(scores: Mapping[str, float]) -> float:
    weights = np.array([FEATURES[feature].weight for feature in scores])
    return float(np.average(np.array(list(scores.values())), weights=weights))
