"""Prediction error of a bundle on a recording, per selector, type and step, as figures in tables."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.features import WITHIN_20, features
from slrl_sumo.routing.expected_routes import ExpectedRoutes
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES
from slrl_sumo.studies.prediction.expectations import expectations
from slrl_sumo.studies.prediction.long_rollout import LONG_STEPS as DRIVE_STEPS
from slrl_sumo.studies.prediction.long_rollout import LongRollout, long_rollout, long_rollout_figures
from slrl_sumo.studies.prediction.predictors import prior_sampled
from slrl_sumo.studies.prediction.rollout import STEPS, Cast, Move, cast_of
from slrl_sumo.studies.prediction.rollout_realism import realism_rows, recorded
from slrl_sumo.studies.prediction.selector_rollouts import (
    POLICY_SELECTORS,
    SAMPLES,
    SELECTORS,
    Rollouts,
    draws,
    joined,
    selector_rollouts,
    so_far,
)

STARTS_EVERY = 5
"""Frames from one start to the next: 2 s."""

UNUSUAL_SPEED_SHARE = 0.1
"""Share of the recorded speeds outside the 1st to 99th percentile of the training data above which a note says so."""

BATCH = 16
"""Start frames that are simulated at once; with 20 samples of each, arrays stay small enough for the cache."""


def selectors_of(bundle: ModelBundle) -> tuple[str, ...]:
    """All selectors that can be evaluated with a bundle."""
    return SELECTORS if bundle.policy is None else SELECTORS + POLICY_SELECTORS


def evaluate(
    recording: Trajectories,
    bundle: ModelBundle,
    *,
    selectors: Sequence[str] | None = None,
    roadmap: RoadMap | None = None,
    surface: str = "",
    routes: ExpectedRoutes | None = None,
    starts_every: int = STARTS_EVERY,
    seed: int = 1,
    batch: int = BATCH,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Rollouts of a recording from every `starts_every`-th frame, as JSON-ready tables.

    `rows`: selector, type, step, ade_m (mean error over the steps so far), fde_m (error after this step), min_ade_m
    and min_fde_m (the same of the best of SAMPLES rollouts per road user; equal where there is one), n (road users
    behind it). A road user's steps count from its own entry. `bends`: the same at the last step, of road users in
    bends. `realism`: per selector and type the mean score, `groups` and `features` of road users that are simulated for
    all steps (see slrl_sumo.metrics.realism), n. `reversing`: road users left out, in all rollouts together, because
    they are cars that reverse then. `driving`: long rollouts of the prior over 64 steps (see
    slrl_sumo.studies.prediction.long_rollout). `roadmap` is the ground, `surface` says where it comes from; with it
    there is `off_surface`: per selector and type the share of steps that end off the own surface, also of what was
    recorded. Without it everything is road. On `routes` the trained selector reads where vehicles are expected to go,
    if it was calibrated to that (slrl_sumo.learning.supervised.without_route); `expected_routes` says for which types.
    `selectors`: of selectors_of(bundle), which is the default. Types that the bundle has no models for are there as
    recorded; `notes` names them, and types at other speeds, or with other numbers of road users nearby, than the bundle
    was learned from.
    The figures depend on `seed`, not on `batch`. Raises InputError where nothing can be evaluated.
    """
    known = selectors_of(bundle)
    selectors = known if selectors is None else selectors
    for name in selectors:
        if name not in known:
            missing = (
                f"bundle {bundle.name} has no trained selector" if name in POLICY_SELECTORS else "no such selector"
            )
            raise InputError(f"--selectors {name}: {missing}; use {', '.join(known)}")
    if not len(recording):
        raise InputError("the recording holds no road user; make one with `slrl-sumo record` or `slrl-sumo import`")
    if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
        raise InputError(f"the recording has an interval of {recording.dt} s, evaluation needs {DECISION_INTERVAL} s")
    if starts_every < 1:
        raise InputError(f"--starts {starts_every}: give a number of frames, 1 or more")
    starts = np.arange(recording.frames.start, recording.frames.stop, starts_every)
    # Joined recordings have pauses without road users.
    present = np.unique(recording.frame)
    if len(starts):
        starts = starts[present[np.searchsorted(present, starts)] <= starts + STEPS]
    parts: dict[str, list[Rollouts]] = {name: [] for name in selectors}
    ground = everywhere_road(recording.x, recording.y) if roadmap is None else roadmap
    truth, expected = recorded(recording, roadmap), expectations(bundle, routes)
    drives: list[LongRollout] = []
    reversed_ = 0
    with one_thread():
        for first in range(0, len(starts), batch):
            here = starts[first : first + batch]
            cast = cast_of(recording, here, types=bundle.types)
            reversed_ += int(cast.reverses.sum())
            for name in selectors:
                parts[name].append(selector_rollouts(truth, cast, here, name, bundle, ground, seed, expected))
            if "prior" in selectors:
                make = partial(_in_a_run, bundle, ground, here, seed)
                drives.append(long_rollout(recording, here, make, bundle.types))
            progress(min(first + batch, len(starts)) / max(len(starts), 1))
    there = np.isin(np.arange(len(TYPE_NAMES)), recording.type)
    if (unserved := bundle.missing(there)) and not (there & bundle.types).any():
        raise InputError(f"bundle {bundle.name} has no models for {unserved}, and the recording holds nothing else")
    notes = [f"bundle {bundle.name} has no models for {unserved}: as recorded, without figures"] if unserved else []
    notes += _beyond(recording, bundle, starts)
    if not len(starts) or not any((part.steps > 0).any() for part in parts[selectors[0]]):
        raise InputError("no road user of the recording can be simulated: that takes 1.2 s of a track of its own")
    return {
        "recording": recording.source,
        "bundle": bundle.name,
        "seed": seed,
        "notes": notes,
        "starts": len(starts),
        "starts_every": starts_every,
        "samples": SAMPLES,
        "reversing": reversed_,
        "surface": "everything is road (no --net or --mask was given)" if roadmap is None else surface,
        "expected_routes": [] if expected is None else [TYPE_NAMES[t] for t in np.flatnonzero(expected.types)],
        "rows": [row for name in selectors for row in _rows(name, parts[name])],
        "bends": [row for name in selectors for row in _bends(name, parts[name])],
        "off_surface": [] if roadmap is None else _off_surface(recording, parts, roadmap),
        "realism": [row for name in selectors for row in _realism(name, parts[name])],
        "driving": long_rollout_figures("prior", drives, bundle, truth) if drives else [],
    }


def _beyond(recording: Trajectories, bundle: ModelBundle, frames: Integers) -> list[str]:
    """A note where more than UNUSUAL_SPEED_SHARE of the recorded speeds of a type, or of the numbers of others near it
    at `frames`, are not among those of the training."""
    notes, moving = [], ~recording.parked[recording.track]
    kind, within_20 = _others(recording, frames)
    for t, type_name in enumerate(TYPE_NAMES):
        learned = bundle.training.get("types", {}).get(type_name, {})
        speed = recording.speed[moving & (recording.type[recording.track] == t)]
        for values, percentiles, what, unit, digits in (
            (speed, "speed_percentiles_mps", "speeds", " m/s", 1),
            (within_20[kind == t], "within_20_m_percentiles", "numbers of others within 20 m", "", 0),
        ):
            bounds = learned.get(percentiles)
            if bounds is None or not len(values):
                continue
            share = float(((values < bounds[0] - 1e-3) | (values > bounds[1] + 1e-3)).mean())
            if share > UNUSUAL_SPEED_SHARE:
                notes.append(
                    f"{type_name}: {share:.0%} of the recorded {what} lie outside {bounds[0]:.{digits}f} to "
                    f"{bounds[1]:.{digits}f}{unit}, from which bundle {bundle.name} was learned; its models "
                    "extrapolate there"
                )
    return notes


def _others(recording: Trajectories, frames: Integers) -> tuple[NDArray[np.int8], Floats]:
    """Types (n,) of the road users at `frames` that are not parked, and numbers of all others within 20 m of them."""
    kinds, counts = [np.zeros(0, np.int8)], [np.zeros(0)]
    for frame in frames.tolist():
        track = recording.track[recording.rows_at(frame)]
        rows = np.flatnonzero(~recording.parked[track])
        if len(rows):
            kinds.append(recording.type[track[rows]])
            counts.append(features(recording.world(frame), rows)[:, WITHIN_20].sum(1))
    return np.concatenate(kinds), np.concatenate(counts)


def _in_a_run(bundle: ModelBundle, ground: RoadMap, starts: Integers, seed: int, cast: Cast) -> Move:
    """As the prior moves road users in a run, where it draws modes."""
    return prior_sampled(bundle, ground, draws(cast, starts, seed, 1, DRIVE_STEPS)[0])


def _off_surface(recording: Trajectories, parts: dict[str, list[Rollouts]], roadmap: RoadMap) -> list[dict[str, Any]]:
    rows = []
    kind = recording.type[recording.track]
    moving = ~recording.parked[recording.track]
    off = ~OWN_SURFACE[kind, roadmap.surface_at(recording.x, recording.y)]
    for t, type_name in enumerate(TYPE_NAMES):
        mine = moving & (kind == t)
        if mine.any():
            share = float(off[mine].mean())
            rows.append({"selector": "recorded", "type": type_name, "share": share, "steps": int(mine.sum())})
    for name, some in parts.items():
        every = joined(some)
        for t, type_name in enumerate(TYPE_NAMES):
            steps = int(every.steps[every.type == t].sum())
            if steps:
                share = float(every.off_surface[every.type == t].sum() / steps)
                rows.append({"selector": name, "type": type_name, "share": share, "steps": steps})
    return rows


def _table(name: str, kind: int, step: int, rollouts: Rollouts, chosen: NDArray[np.bool_]) -> dict[str, Any]:
    return {
        "selector": name,
        "type": TYPE_NAMES[kind],
        "step": step,
        "ade_m": float(so_far(rollouts.error[chosen])[:, step - 1].mean()),
        "fde_m": float(rollouts.error[chosen, step - 1].mean()),
        "min_ade_m": float(rollouts.best_mean[chosen, step - 1].mean()),
        "min_fde_m": float(rollouts.best[chosen, step - 1].mean()),
        "n": int(chosen.sum()),
    }


def _rows(name: str, parts: Sequence[Rollouts]) -> list[dict[str, Any]]:
    every, rows = joined(parts), []
    for kind in range(len(TYPE_NAMES)):
        for step in range(1, STEPS + 1):
            chosen = (every.type == kind) & (every.steps >= step)
            if chosen.any():
                rows.append(_table(name, kind, step, every, chosen))
    return rows


def _bends(name: str, parts: Sequence[Rollouts]) -> list[dict[str, Any]]:
    every = joined(parts)
    kinds = [kind for kind in range(len(TYPE_NAMES)) if (every.bend & (every.type == kind)).any()]
    return [_table(name, kind, STEPS, every, every.bend & (every.type == kind)) for kind in kinds]


def _realism(name: str, parts: Sequence[Rollouts]) -> list[dict[str, Any]]:
    every = joined(parts)
    return realism_rows(name, every.type, every.realism)
