"""How the package predicts recordings that it has not seen, beside baselines that learned from the same recordings.

    slrl-sumo import hc PATH/TO/hc --out recordings
    python -m benchmarks.prediction.measure recordings --fold D1:D2,D3
    python -m benchmarks.prediction.measure recordings --fold D1:D2,D3 --selector shared-space

Prints mean errors over 6.4 s relative to those of constant velocity: of single predictions, and of the best of 20; and
the realism score of the package's selectors. A fold TRAIN:TEST names the recordings (files of the folder) by the
beginnings of their names, with commas; those of TEST are never learned from, and without TRAIN all others are, so that
`--fold :sdd-gates --fold :sdd-nexus` leaves out one site at a time. SL is the prior of a bundle that is fitted to the
fold, or of BUNDLE; SL+RL is the trained selector of BUNDLE (`--selector`), whose single prediction is the most central
mode at each step, as that of SL; greedily it is the most probable one. Both simulate all road users together; all
predictions of a road user that has 2 s before and 6.4 s after it count, every 2 s.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prediction.baselines import BASELINES
from benchmarks.prediction.moments import has_past, joined, mirrored, moments_at, usable_rows
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.learning.supervised.fit import MIRROR_BELOW, fit
from slrl_sumo.learning.supervised.goals import MODES_BY
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.features import STATES
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.prediction.evaluate import BATCH, STARTS_EVERY
from slrl_sumo.studies.prediction.rollout import STEPS, cast_of
from slrl_sumo.studies.prediction.rollout_realism import realism_rows, recorded
from slrl_sumo.studies.prediction.selector_rollouts import Rollouts, selector_rollouts
from slrl_sumo.studies.prediction.selector_rollouts import joined as joined_rollouts

PACKAGE = {
    "constant velocity": "constant-velocity",
    "SL": "prior",
    "SL+RL": "sampled",
    "SL+RL greedy": "greedy",
    "one mode held": "mode-oracle",
}
"""Selectors of the package by the name of their column."""

UNTOLD = {
    *(("single", "constant velocity"), ("single", "one mode held"), ("realism", "one mode held")),
    *(("best", "constant velocity"), ("best", "SL+RL greedy")),
}
"""Figures that say nothing: 1 by definition, in hindsight, and of one sample."""

Row = dict[str, float]
"""By `FIGURE of METHOD`, and "windows" and "n"."""


def main() -> None:
    """Fit, evaluate, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, help="folder of Trajectories files, .npz")
    parser.add_argument("--fold", action="append", required=True, metavar="TRAIN:TEST")
    parser.add_argument("--selector", metavar="BUNDLE", help="a bundle with a trained selector, not fitted here")
    parser.add_argument("--modes", choices=MODES_BY, default="paths")
    parser.add_argument("--preset", choices=STATES, default="history")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gate", action="store_true", help="exit with 1 where SL+RL predicts worse than SL")
    arguments = parser.parse_args()
    files = {file.stem: load_trajectories(file) for file in sorted(arguments.recordings.glob("*.npz"))}
    given = load_bundle(arguments.selector) if arguments.selector else None
    rows = {}
    for fold in arguments.fold:
        train, tests = split(files, fold)
        learn, test = list(train.values()), list(tests.values())
        chosen: dict[str, Any] = {"seed": arguments.seed, "modes": arguments.modes, "preset": arguments.preset}
        bundle = given or fit(learn, name="fold", tests=test, **chosen)
        for kind, row in measured(learn, test, bundle, arguments.seed).items():
            rows[" ".join(tests), TYPE_NAMES[kind]] = row
    print_rows(rows)
    if arguments.gate and (worse := worse_than_prior(rows)):
        raise SystemExit(f"SL+RL predicts worse than SL: {', '.join(worse)}")


def worse_than_prior(rows: dict[tuple[str, str], Row]) -> list[str]:
    """The types, with figures, of which the single prediction of SL+RL has a higher error than that of SL."""
    found = []
    for (tests, kind), row in rows.items():
        prior, policy = row["single of SL"], row.get("single of SL+RL")
        if policy is None:
            raise SystemExit("--gate compares a trained selector; name its bundle with --selector")
        if policy > prior:
            found.append(f"{kind} on {tests} ({policy:.2f} instead of {prior:.2f} m)")
    return found


def split(files: dict[str, Trajectories], fold: str) -> tuple[dict[str, Trajectories], dict[str, Trajectories]]:
    """Recordings to learn from and to test on, by name, for a fold as on the command line."""
    left, _, right = fold.partition(":")
    test = {name: one for name, one in files.items() if name.startswith(tuple(right.split(",")))}
    train = {name: one for name, one in files.items() if name not in test and name.startswith(tuple(left.split(",")))}
    if not (train and test):
        raise SystemExit(f"--fold {fold}: {len(train)} recordings to learn from, {len(test)} to test on")
    return train, test


def measured(
    train: Sequence[Trajectories], tests: Sequence[Trajectories], bundle: ModelBundle, seed: int
) -> dict[int, Row]:
    """Errors by type: of the selectors that the bundle has, and of all baselines, at the same moments."""
    names = {column: name for column, name in PACKAGE.items() if bundle.policy is not None or "+RL" not in column}
    parts = [simulated(recording, bundle, list(names.values()), seed) for recording in tests]
    known = [_known(recording, part["prior"]) for recording, part in zip(tests, parts, strict=True)]
    test = joined(
        [moments_at(one, part["prior"].row[rows]) for one, part, rows in zip(tests, parts, known, strict=True)]
    )
    learn = joined([moments_at(recording, usable_rows(recording)) for recording in train])
    table: dict[int, Row] = {}
    for kind in np.flatnonzero(bundle.types).tolist():
        mine, theirs = test.take(test.type == kind), learn.take(learn.type == kind)
        if not (len(mine) and len(theirs)):
            continue
        row = table[kind] = {"windows": float(len(theirs)), "n": float(len(mine))}
        if len(theirs) < MIRROR_BELOW:
            theirs = mirrored(theirs)
        with one_thread():
            for name, predict in BASELINES.items():
                row |= _figures(name, _errors(predict(theirs, mine, seed), mine.path))
        for column, name in names.items():
            every = [(part[name], rows) for part, rows in zip(parts, known, strict=True)]
            single = np.concatenate([one.error[rows] for one, rows in every])[test.type == kind]
            best = np.concatenate([one.best_mean[rows] for one, rows in every])[test.type == kind, -1]
            row |= {f"single of {column}": float(single.mean()), f"best of {column}": float(best.mean())}
            scores = np.concatenate([one.realism[rows] for one, rows in every])[test.type == kind]
            [realism] = realism_rows(name, np.full(len(scores), kind, np.int8), scores)
            row[f"realism of {column}"] = realism["score"]
    return table


def simulated(recording: Trajectories, bundle: ModelBundle, names: Sequence[str], seed: int) -> dict[str, Rollouts]:
    """Rollouts of all road users of a recording, by selector, as `evaluate` has them."""
    starts = np.arange(recording.frames.start, recording.frames.stop, STARTS_EVERY)
    ground, truth = everywhere_road(recording.x, recording.y), recorded(recording)
    parts: dict[str, list[Rollouts]] = {name: [] for name in names}
    with one_thread():
        for first in range(0, len(starts), BATCH):
            here = starts[first : first + BATCH]
            cast = cast_of(recording, here, types=bundle.types)
            for name in names:
                parts[name].append(selector_rollouts(truth, cast, here, name, bundle, ground, seed))
    return {name: joined_rollouts(some) for name, some in parts.items()}


def _known(recording: Trajectories, rollouts: Rollouts) -> np.ndarray:
    """Which rollouts count: 2 s before and 6.4 s after them are recorded."""
    whole = np.flatnonzero(rollouts.steps == STEPS)
    return whole[has_past(recording, rollouts.row[whole])]


def _errors(paths: Floats, true: Floats) -> Floats:
    """Mean error over the path of each sample, (samples, N)."""
    return np.asarray(np.hypot(paths[..., 0] - true[..., 0], paths[..., 1] - true[..., 1]).mean(-1), np.float64)


def _figures(name: str, errors: Floats) -> Row:
    if len(errors) == 1:
        return {f"single of {name}": float(errors.mean())}
    return {f"best of {name}": float(errors.min(0).mean())}


def print_rows(rows: dict[tuple[str, str], Row]) -> None:
    """Markdown tables: errors relative to constant velocity, of single predictions and the best of 20; realism."""
    columns = list(dict.fromkeys([*BASELINES, *PACKAGE]))
    for figure, title in (("single", "single prediction"), ("best", "best of 20"), ("realism", "realism")):
        there = [name for name in columns if any(f"{figure} of {name}" in row for row in rows.values())]
        there = [name for name in there if (figure, name) not in UNTOLD]
        print(f"\n| {title} | type | windows | n | constant velocity (m) | {' | '.join(there)} |")
        print("|" + "---|" * (5 + len(there)))
        for (tests, kind), row in rows.items():
            still = row["single of constant velocity"]
            unit = 1.0 if figure == "realism" else still
            cells = [f"{row[key] / unit:.2f}" if (key := f"{figure} of {name}") in row else "-" for name in there]
            print(f"| {tests} | {kind} | {row['windows']:.0f} | {row['n']:.0f} | {still:.2f} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
