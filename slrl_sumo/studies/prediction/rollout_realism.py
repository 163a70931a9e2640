"""Realism of rollouts: each simulated road user of a recording, compared with its recorded motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.realism import mean_realism, window_scores
from slrl_sumo.metrics.realism_features import FEATURES, ROWS_BEFORE_KNOWN, features
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.prediction.rollout import STEPS, Cast


@dataclass(frozen=True, eq=False)
class Recorded:
    """The recorded motion of the road users of a recording."""

    recording: Trajectories
    features: dict[str, Floats]
    """Of each row, (R,), by names of FEATURES."""
    shapes: SurfaceShapes | None
    """The ground, where it is known."""

    def of_type(self, name: str, kind: int) -> Floats:
        """A feature at all moments at which road users of a type, except parked ones, have all features."""
        t = self.recording
        since = t.frame - t.frame[t.starts[t.track]]
        rows = (t.type[t.track] == kind) & ~t.parked[t.track] & (since >= ROWS_BEFORE_KNOWN)
        return np.asarray(self.features[name][rows], np.float64)


def recorded(recording: Trajectories, roadmap: RoadMap | None = None) -> Recorded:
    """The features of a recording; map features with a map only."""
    shapes = None if roadmap is None else roadmap.shapes
    return Recorded(recording, features(recording, shapes), shapes)


def rollout_scores(truth: Recorded, cast: Cast, paths: Floats) -> Floats:
    """Realism of each road user of the cast, (U, len(FEATURES)), in the order of FEATURES (see metrics.realism).

    `paths`: Errors.path of rollouts of the same cast, the samples of a distribution, (S, U, STEPS + 1, 3). NaN
    for features that are not known, and for road users that were not simulated for all STEPS.
    """
    scores = np.full((len(cast), len(FEATURES)), np.nan)
    whole = np.flatnonzero(cast.leaves - cast.enters == STEPS)
    if not len(whole):
        return scores
    made, first = _tracks(truth.recording, cast, paths)
    ahead = np.arange(1, STEPS + 1)
    rows = first.reshape(len(paths), len(cast))[:, whole, None] + ahead
    found = features(made, truth.shapes, rows.ravel())
    # Sums over other numbers of rows would differ in the last digit, and with it the bin of a value.
    simulated = {name: np.round(values, 9).reshape(rows.shape) for name, values in found.items()}
    true = {name: np.round(values[cast.row[whole, None] + ahead], 9) for name, values in truth.features.items()}
    for name, values in window_scores(true, simulated).items():
        scores[whole, list(FEATURES).index(name)] = values
    return scores


def realism_rows(selector: str, kind: NDArray[np.int8], scores: Floats) -> list[dict[str, Any]]:
    """Mean scores of each type, JSON-ready; `kind`: RoadUserType, (U,), `scores`: as of `rollout_scores`."""
    rows = []
    for t, type_name in enumerate(TYPE_NAMES):
        mine = scores[kind == t]
        mine = mine[~np.isnan(mine).all(-1)]
        if not len(mine):
            continue
        known = {name: mine[:, i] for i, name in enumerate(FEATURES) if not np.isnan(mine[:, i]).any()}
        mean = mean_realism(known)
        row = {"selector": selector, "type": type_name, "score": mean.score, "n": mean.windows}
        rows.append({**row, "groups": mean.groups, "features": mean.features})
    return rows


def _tracks(recording: Trajectories, cast: Cast, path: Floats) -> tuple[Trajectories, Integers]:
    """The rollouts `path` (S, U, STEPS + 1, 3) as tracks, scene by scene, with the recorded moments before them, and
    the row at which each begins, (S U,)."""
    samples, users = path.shape[:2]
    # From the first of the KNOWN rows before the start, or from where the road user appears.
    since = np.maximum(-ROWS_BEFORE_KNOWN, recording.starts[cast.track] - cast.row)
    count = cast.leaves - since + 1
    user = np.repeat(np.arange(users), count)
    offset = np.arange(len(user)) - np.repeat(np.cumsum(count) - count, count) + since[user]
    there = cast.row[user] + offset
    before = np.stack([recording.x, recording.y, recording.heading], -1)[there]
    pose = np.where((offset < 0)[:, None], before, path[:, user, np.maximum(offset, 0)]).reshape(-1, 3)
    sample = np.repeat(np.arange(samples), len(user))
    scene = sample * (int(cast.scene.max()) + 1) + np.tile(cast.scene[user], samples)
    track, tracks = sample * users + np.tile(user, samples), np.tile(cast.track, samples)
    made = Trajectories(
        track=track,
        frame=scene * (STEPS + ROWS_BEFORE_KNOWN + 1) + np.tile(offset, samples),
        x=pose[:, 0].copy(),
        y=pose[:, 1].copy(),
        heading=pose[:, 2].copy(),
        ids=tuple(map(str, range(samples * users))),
        type=recording.type[tracks],
        length=recording.length[tracks],
        width=recording.width[tracks],
        dt=recording.dt,
    )
    return made, made.starts[:-1] - np.tile(since, samples)
