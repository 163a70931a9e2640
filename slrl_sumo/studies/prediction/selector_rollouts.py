"""Rollouts of the road users of a recording by a selector: its single prediction, and the best of several samples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.routing.expected_routes import ExpectedRoute
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.studies.prediction.central_path import central_path
from slrl_sumo.studies.prediction.expectations import Expectations
from slrl_sumo.studies.prediction.predictors import (
    PriorRanked,
    constant_velocity,
    held_mode,
    policy_central,
    policy_chosen,
    prior_central,
    prior_sampled,
    step_oracle,
)
from slrl_sumo.studies.prediction.rollout import STEPS, Cast, Errors, Move, rollout
from slrl_sumo.studies.prediction.rollout_realism import Recorded, rollout_scores

SELECTORS = ("constant-velocity", "prior", "step-oracle", "mode-oracle")
POLICY_SELECTORS = ("greedy", "sampled")
"""Selectors of bundles with a trained policy."""
SAMPLES = 20
"""Number of rollouts per road user, of which the best counts."""

BEND_ANGLE = np.radians(20.0)
"""Change (rad) of the recorded heading in 6.4 s above which a road user is in a bend."""


@dataclass(frozen=True, eq=False)
class Rollouts:
    """Rollouts of all simulated road users by one selector."""

    type: NDArray[np.int8]
    """RoadUserType, (U,)."""
    row: Integers
    """Row of the recording from which the road user is simulated, (U,); without meaning if `steps` is 0."""
    steps: Integers
    """Simulated intervals, (U,)."""
    bend: NDArray[np.bool_]
    """Whether the road user was simulated for all STEPS and was in a bend, (U,)."""
    error: Floats
    """Error (m) of the single prediction after each step, (U, STEPS)."""
    best: Floats
    """Least error (m) of all samples after each step, (U, STEPS)."""
    best_mean: Floats
    """Least mean error (m) of all samples over the steps so far, (U, STEPS)."""
    off_surface: Integers
    """Number of intervals of the single prediction that ended off the own surfaces, (U,)."""
    realism: Floats
    """Scores of the distribution, (U, features) (see rollout_realism); without samples, of the single prediction."""


def joined(parts: Sequence[Rollouts]) -> Rollouts:
    """Concatenate the rollouts of all parts."""
    names = Rollouts.__dataclass_fields__
    return Rollouts(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def selector_rollouts(
    truth: Recorded,
    cast: Cast,
    starts: Integers,
    name: str,
    bundle: ModelBundle,
    ground: RoadMap,
    seed: int,
    expected: Expectations | None = None,
) -> Rollouts:
    """Simulate the cast of the frames `starts` by the selector `name`, one of SELECTORS and POLICY_SELECTORS.

    The samples of the prior hold different modes, the most probable modes of the road user's first decision: 20 draws
    of 20 modes would contain only about half of the modes. The single prediction of the prior is the most central mode
    at each step; if modes are whole paths (`fit --modes paths`), which are not chosen again at each step, it is the
    most central path of the samples. The realism of the prior is that of draws as in a run. The single prediction of
    `sampled` is also the most central mode at each step; `greedy` takes the most probable mode, as in a run. Samples of
    a policy choose again at each decision, as in training; each sample uses another twentieth of the distribution
    (`stratified`). A policy reads the `expected` routes.
    """
    recording = truth.recording
    copies = _copies(cast, len(starts))

    def many(make: Callable[[], Move]) -> tuple[Floats, Floats]:
        """Errors (SAMPLES, U, STEPS) and paths (SAMPLES, U, STEPS + 1, 3)."""
        found = rollout(recording, copies, make())
        error, path = (values.reshape(SAMPLES, len(cast), *values.shape[1:]) for values in (found.error, found.path))
        return error, path

    sample = np.repeat(np.arange(SAMPLES), len(cast))
    if name == "mode-oracle":
        return _mode_oracle(truth, cast, bundle, ground)
    if name == "prior":
        ranked = PriorRanked(bundle, ground, sample % bundle.config.modes)
        samples, held = many(lambda: ranked)
        if bundle.training.get("modes_by") == "paths":
            one = _central(recording, cast, held, ranked.probability.reshape(SAMPLES, -1), ground)
        else:
            one = rollout(recording, cast, prior_central(bundle, ground), ground)
        drawn = draws(cast, starts, seed, SAMPLES, STEPS).reshape(-1, STEPS, 2)
        _, paths = many(partial(prior_sampled, bundle, ground, drawn))
        return _rollouts(truth, cast, one, samples, paths)
    policy = bundle if expected is None else expected.bundle

    def routes(members: Cast) -> list[ExpectedRoute | None] | None:
        return None if expected is None else expected.of(recording, members)

    if name == "sampled":
        one = rollout(recording, cast, policy_central(policy, ground, routes(cast)), ground)
        chosen = stratified(draws(cast, starts, seed, SAMPLES, STEPS)).reshape(-1, STEPS)
        return _rollouts(truth, cast, one, *many(lambda: policy_chosen(policy, ground, chosen, routes(copies))))
    alone: dict[str, Callable[[], Move]] = {
        "constant-velocity": lambda: constant_velocity,
        "step-oracle": lambda: step_oracle(bundle, ground),
        "greedy": lambda: policy_chosen(policy, ground, None, routes(cast)),
    }
    one = rollout(recording, cast, alone[name](), ground)
    return _rollouts(truth, cast, one, one.error[None], one.path[None])


def _mode_oracle(truth: Recorded, cast: Cast, bundle: ModelBundle, ground: RoadMap) -> Rollouts:
    """The rollouts of the mode with the least mean error, held from the first to the last decision."""
    moves = [held_mode(bundle, ground, mode) for mode in range(bundle.config.modes)]
    every = [rollout(truth.recording, cast, move, ground) for move in moves]
    samples = np.stack([one.error for one in every])
    best = so_far(samples)[:, np.arange(len(cast)), np.maximum(every[0].steps, 1) - 1].argmin(0)
    chosen = best, np.arange(len(cast))
    off_surface, path = (
        np.stack([getattr(other, what) for other in every])[chosen] for what in ("off_surface", "path")
    )
    one = replace(every[0], error=samples[chosen], off_surface=off_surface, path=path)
    return _rollouts(truth, cast, one, samples, path[None])


def _central(recording: Trajectories, cast: Cast, paths: Floats, probability: Floats, ground: RoadMap) -> Errors:
    """The central path of rollouts `paths` (S, U, STEPS + 1, 3) with `probability` (S, U)."""
    path = paths[0].copy()
    path[..., :2] = central_path(paths[..., :2], probability)
    steps = np.maximum(cast.leaves - cast.enters, 0)
    user, step = np.nonzero(np.arange(STEPS) < steps[:, None])
    after = cast.enters[user] + step + 1
    row, (x, y) = cast.row[user] + after, path[user, after, :2].T
    error, off_surface = np.zeros((len(cast), STEPS)), np.zeros(len(cast), np.int64)
    error[user, step] = np.hypot(x - recording.x[row], y - recording.y[row])
    kind = recording.type[cast.track]
    np.add.at(off_surface, user, ~OWN_SURFACE[kind[user], ground.surface_at(x, y)])
    return Errors(kind, steps, error, off_surface, path)


def _rollouts(truth: Recorded, cast: Cast, one: Errors, samples: Floats, paths: Floats) -> Rollouts:
    return Rollouts(
        type=one.type,
        row=cast.row + cast.enters,
        steps=one.steps,
        bend=_bend(truth.recording, cast, one),
        error=one.error,
        best=samples.min(0),
        best_mean=so_far(samples).min(0),
        off_surface=one.off_surface,
        realism=rollout_scores(truth, cast, paths),
    )


def draws(cast: Cast, starts: Integers, seed: int, samples: int, steps: int) -> Floats:
    """Random numbers (samples, U, steps, 2); the numbers of a scene depend only on seed and start frame."""
    parts = []
    for scene, start in enumerate(starts.tolist()):
        count = int((cast.scene == scene).sum())
        # Draw for each road user and sample, so that the numbers of a scene do not depend on other scenes.
        parts.append(np.random.default_rng((seed, start)).random((count, samples, steps, 2)).swapaxes(0, 1))
    return np.concatenate(parts, axis=1)


def stratified(draws: Floats) -> Floats:
    """Random numbers (samples, ...) from [0, 1); each sample has another stratum of width 1 / samples.

    `draws` (samples, ..., 2): the first of each pair places the number in its stratum, the second assigns the strata.
    """
    return (draws[..., 1].argsort(0).argsort(0) + draws[..., 0]) / len(draws)


def so_far(error: Floats) -> Floats:
    """Mean over the steps so far, along the last axis."""
    return error.cumsum(-1) / np.arange(1, error.shape[-1] + 1)


def _copies(cast: Cast, scenes: int) -> Cast:
    """SAMPLES copies of the cast, each in separate scenes."""
    scene = (np.arange(SAMPLES)[:, None] * scenes + cast.scene).ravel()
    names = [name for name in Cast.__dataclass_fields__ if name != "scene"]
    return replace(cast, scene=scene, **{name: np.tile(getattr(cast, name), SAMPLES) for name in names})


def _bend(recording: Trajectories, cast: Cast, errors: Errors) -> NDArray[np.bool_]:
    whole = errors.steps == STEPS
    entry = cast.row[whole] + cast.enters[whole]
    bend = np.zeros(len(cast), np.bool_)
    bend[whole] = np.abs(wrap_angle(recording.heading[entry + STEPS] - recording.heading[entry])) > BEND_ANGLE
    return bend
