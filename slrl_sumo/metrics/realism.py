"""Realism of simulated road users: a score modelled on the Waymo Open Sim Agents Challenge.

Montali et al. (2023), The Waymo Open Sim Agents Challenge, computes the likelihood of the recorded motion of each road
user under the distribution of its simulated motions from the same begin, by feature, and takes a weighted mean. This
module does the same: the score is conditional on the road user and its window of time. Distributions of all traffic
together would rank traffic that avoids all encounters, or stands, above realistic traffic with small errors. Scores are
not comparable with those of the challenge: the likelihood is divided by the likelihood of the recorded motion under
itself, so that 1 can be reached; standing is a feature; the time to collision is that of boxes in the plane, towards
any road user; and the mean over features is geometric, because in an arithmetic mean, events that rarely happen
(overlaps, conflicts, standing) would compensate impossible motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.realism_features import FEATURES, ROWS_BEFORE_KNOWN, Feature, features
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

WINDOW = 16
"""Number of moments of a window: 6.4 s at intervals of 0.4 s."""
DISTRIBUTION_SMOOTHING = 0.1
"""Share of each distribution that is spread evenly over all bins, so that motion that was never simulated is unlikely,
not impossible; the same for one simulation and for many."""
MOST_ALIKE_WINDOWS = 20
"""Number of windows of simulated traffic with the most similar begin to a window of the reference."""
FARTHEST_NEIGHBOUR = 10.0
"""Greatest distance (m) of the nearest road user in the similarity of situations; larger distances are clipped."""

Values = Mapping[str, Floats]


@dataclass(frozen=True)
class Realism:
    """Scores in (0, 1], means over windows; 1 if the simulated motion equals the recorded motion."""

    score: float
    """Weighted geometric mean over the compared features."""
    features: dict[str, float]
    """Score of each feature."""
    groups: dict[str, float]
    """Scores of kinematic, interactive and map features; no map features without a map."""
    windows: int
    """Number of windows."""


def window_scores(recorded: Values, simulated: Values, alike: Values | None = None) -> dict[str, Floats]:
    """The likelihood ratio in (0, 1] of each of N windows, (N,), by feature.

    `recorded` (N, WINDOW) and `simulated` (S, N, WINDOW), S simulations of each window, by names of FEATURES. The
    distribution of a window contains all its simulations and moments. The likelihood is relative to the likelihood
    under `alike` (S', N, WINDOW), recorded windows; without `alike`, under the recorded window itself, the maximum for
    any simulation.
    """
    found = {}
    for name, values in recorded.items():
        feature = FEATURES[name]
        own = values[None] if alike is None else alike[name]
        ours, best = (_log_likelihood(values, samples, feature) for samples in (simulated[name], own))
        found[name] = np.exp(np.minimum(ours - best, 0.0))
    return found


def mean_realism(scores: Values) -> Realism:
    """The mean over windows of their scores, (N,) by feature."""
    groups = dict.fromkeys(FEATURES[name].group for name in scores)
    return Realism(
        score=_combined(scores),
        features={name: float(values.mean()) for name, values in scores.items()},
        groups={g: _combined({f: s for f, s in scores.items() if FEATURES[f].group == g}) for g in groups},
        windows=len(next(iter(scores.values()))),
    )


def realism(
    *,
    simulated: Trajectories,
    reference: Trajectories,
    tracks: NDArray[np.bool_] | None = None,
    reference_tracks: NDArray[np.bool_] | None = None,
    shapes: SurfaceShapes | None = None,
    reference_shapes: SurfaceShapes | None = None,
) -> dict[str, Realism]:
    """The realism of simulated road users against a reference, by type name; types missing in either are left out.

    This is for traffic that was not simulated from the recording (otherwise see `window_scores`): each window of the
    reference is compared with the MOST_ALIKE_WINDOWS windows of simulated road users of its type with the most similar
    begin, by speed, acceleration, yaw rate, and distances to the nearest road user and to the edge of the surface. The
    likelihood under these windows is divided by the likelihood under the windows of the reference with the most similar
    begin, so that equal traffic has the score 1.

    With `tracks` and `reference_tracks`, (T,), only these road users count; all others still appear as their
    neighbours. Parked road users, and tracks shorter than WINDOW and the two moments before, do not count.

    Map features need the ground of both, in m and in the coordinates of the tracks: `shapes`, and `reference_shapes` if
    the reference was recorded elsewhere.
    """
    grounds = (None, None) if shapes is None else (shapes, reference_shapes or shapes)
    own = features(simulated, grounds[0])
    # Two groups of one run share their features.
    same = reference is simulated and grounds[1] is grounds[0]
    other = own if same else features(reference, grounds[1])
    result = {}
    for kind, name in enumerate(TYPE_NAMES):
        ours, theirs = _windows(simulated, tracks, kind), _windows(reference, reference_tracks, kind)
        if not (len(ours) and len(theirs)):
            continue
        place, scale = _situation(other, theirs)
        there = place / scale
        here = _situation(own, ours)[0] / scale
        count = min(MOST_ALIKE_WINDOWS, len(ours), len(theirs))
        near, alike = (cKDTree(points).query(there, np.arange(1, count + 1))[1].T for points in (here, there))
        result[name] = mean_realism(
            window_scores(
                _taken(other, theirs),
                {feature: values[near] for feature, values in _taken(own, ours).items()},
                {feature: values[alike] for feature, values in _taken(other, theirs).items()},
            )
        )
    return result


def _windows(t: Trajectories, tracks: NDArray[np.bool_] | None, kind: int) -> Integers:
    """First rows of the windows of one type, one after the other along each track."""
    counted = (~t.parked if tracks is None else tracks & ~t.parked) & (t.type == kind)
    ends = t.starts[1:]
    since = t.frame - t.frame[t.starts[t.track]] - ROWS_BEFORE_KNOWN
    first = (since >= 0) & (since % WINDOW == 0) & counted[t.track]
    return np.flatnonzero(first & (np.arange(len(t)) + WINDOW <= ends[t.track]))


def _taken(values: Values, first: Integers) -> dict[str, Floats]:
    rows = first[:, None] + np.arange(WINDOW)
    return {name: one[rows] for name, one in values.items()}


def _situation(values: Values, first: Integers) -> tuple[Floats, Floats]:
    """The quantities at the begin of each window, (N, quantities), and the spread of each quantity."""
    columns = [values[name][first] for name in ("speed", "acceleration", "yaw_rate")]
    columns.append(np.minimum(values["nearest"][first], FARTHEST_NEIGHBOUR))
    if "road_edge" in values:
        columns.append(values["road_edge"][first])
    place = np.stack(columns, -1)
    return place, np.maximum(place.std(0), 0.1)


def _log_likelihood(recorded: Floats, samples: Floats, feature: Feature) -> Floats:
    """Mean log-likelihood of the moments of each window (N, moments) under its samples (S, N, moments), (N,)."""
    if feature.event:
        recorded, samples = recorded.max(-1, keepdims=True), samples.max(-1, keepdims=True)
    count = len(recorded)
    cells = np.arange(count)[:, None] * feature.bins
    held = np.bincount((cells + _bin(samples, feature)).ravel(), minlength=count * feature.bins)
    share = held / (samples.shape[0] * samples.shape[2])
    density = np.log((1.0 - DISTRIBUTION_SMOOTHING) * share + DISTRIBUTION_SMOOTHING / feature.bins)
    return np.asarray(density[cells + _bin(recorded, feature)].mean(-1), np.float64)


def _bin(values: Floats, feature: Feature) -> Integers:
    place = (values - feature.low) / (feature.high - feature.low) * feature.bins
    return np.clip(place, 0, feature.bins - 1).astype(np.int64)


def _combined(scores: Values) -> float:
    weights = np.array([FEATURES[feature].weight for feature in scores])
    return float(np.exp(np.average(np.log(list(scores.values())), axis=0, weights=weights)).mean())
