"""Supervised fit: recordings -> modes, displacement models and prior (paper, sections 3.1, 3.2 and 4.1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import sklearn
import torch
from numpy.typing import NDArray
from torch.nn import functional

from slrl_sumo.errors import InputError, check_whole_number
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.supervised.bounds import hardest_braking, set_bounds
from slrl_sumo.learning.supervised.goals import HORIZONS, MODES_BY, Ranges, goals, modes_of, ranges, weigh
from slrl_sumo.learning.supervised.model_card import model_card
from slrl_sumo.learning.supervised.modes import cluster
from slrl_sumo.learning.supervised.network_training import HEADING, rolled, train_displacement, train_prior
from slrl_sumo.learning.supervised.windows import FUTURE, Windows, joined, mirrored, windows
from slrl_sumo.learning.supervised.winner_takes_all import mode_errors, train_path_prior, train_winners
from slrl_sumo.models.bundle import ModelBundle, weights_of
from slrl_sumo.models.bundle_config import BundleConfig
from slrl_sumo.models.displacement import SPEED, DisplacementModels, displacement
from slrl_sumo.models.prior import Prior
from slrl_sumo.models.stacked_networks import StackedNetworks
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.features import COMPANY, STATES, WITHIN_20
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.version import __version__

HELD_OUT = 0.1
"""Share of the tracks of each type that is not used in training."""

MIRROR_BELOW = 20_000
"""Number of windows below which a type is also trained on mirrored windows. Left and right differ in traffic, but few
road users do not show the difference; on held-out recordings of HC and SDD, mirroring lowered the errors of all
types."""

MOVING_DISTANCE = 2.4
"""Distance (m) in the 4.8 s of a window above which a road user moves: 0.5 m/s, as in the paper's r3."""

Longs = NDArray[np.int64]


class TooFewTracksError(InputError):
    """The recordings have too few tracks of each type."""


def fit(
    recordings: Sequence[Trajectories],
    *,
    name: str,
    seed: int,
    epochs: int = 35,
    stride: int = 1,
    modes: str = "paths",
    preset: str = "history",
    tests: Sequence[Trajectories] = (),
    notice: str = "",
    mirror: bool = False,
    forget: float = 0.0,
) -> ModelBundle:
    """Learn a bundle called `name` from recordings of at least one road user type.

    The bundle contains the types with enough tracks in the recordings for training and test; other types are left out,
    with the reason in `training["left_out"]`. Errors are measured on `tests`, recordings that are not used in training;
    without `tests`, on HELD_OUT of the tracks of each type, which are excluded from training. `stride` > 1 uses only
    every stride-th frame. `modes`: one of MODES_BY. `preset`: one of features.STATES, the inputs of the models.
    `mirror` adds mirrored windows for each type, not only for types with few windows. `forget`: see train_displacement.
    `notice`: text that the data's licence requires in the model card. The same seed and recordings give the same
    weights on one machine, independent of the number of threads. Raises InputError if the recordings have another
    interval or an argument is wrong, and TooFewTracksError.
    """
    check_whole_number("epochs", epochs, 1, 100_000)
    if not recordings:
        raise InputError("fit needs at least one recording; give Trajectories files made by `slrl-sumo import`")
    for recording in (*recordings, *tests):
        if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
            raise InputError(
                f"recording {recording.source or 'without a source'} has an interval of {recording.dt} s, "
                f"fit needs {DECISION_INTERVAL} s; import it again with that interval"
            )
    if preset not in STATES:
        raise InputError(f"--preset {preset}: there is no such preset; use {', '.join(STATES)}")
    if modes not in MODES_BY:
        raise InputError(f"--modes {modes}: there is no such clustering; use {', '.join(MODES_BY)}")
    with one_thread():
        return _fit(recordings, tests, name, seed, epochs, stride, modes, preset, notice, mirror, forget)


def _fit(
    recordings: Sequence[Trajectories],
    tests: Sequence[Trajectories],
    name: str,
    seed: int,
    epochs: int,
    stride: int,
    modes: str,
    preset: str,
    notice: str,
    mirror: bool,
    forget: float,
) -> ModelBundle:
    horizon = HORIZONS.get(modes, FUTURE)
    every = windows([*recordings, *tests], stride, preset, max(horizon, FUTURE))
    held_out = every.recording >= len(recordings) if tests else _hold_out(every, seed)
    config = BundleConfig(preset=preset, features=STATES[preset])
    left_out = _left_out(every, held_out, modes, config.modes)
    types = [t for t in RoadUserType if TYPE_NAMES[t] not in left_out]
    if not types:
        reasons = "; ".join(f"{name}: {why}" for name, why in left_out.items())
        raise TooFewTracksError(f"nothing can be learned: {reasons}")
    served = np.isin(every.type, types)
    every, held_out = every.take(served), held_out[served]
    train = every.take(~held_out)
    few = np.bincount(train.type, minlength=len(RoadUserType)) < MIRROR_BELOW
    few |= mirror
    train = joined([train, mirrored(train.take(few[train.type]))])
    centres = np.zeros((len(RoadUserType), config.modes, 2))
    known = ranges(train, types) if modes == "accelerations" else {}
    goal = goals(train, modes, known)
    for t in types:
        centres[t] = cluster(goal[train.type == t], config.modes, seed, TYPE_NAMES[t], weigh=weigh(modes, t))
    mode = modes_of(train, modes, centres, known)
    counts = np.stack([np.bincount(mode[train.type == t], minlength=config.modes) for t in RoadUserType])

    models = DisplacementModels(config.modes, config.displacement_hidden, len(config.features))
    prior = Prior(config.modes, config.prior_hidden, len(config.features))
    set_bounds(models, train, types, modes)
    for networks in (models.networks, prior.networks):
        _set_normalisation(networks, train, types)
        if preset != "paper":  # `turned` makes it noise
            networks.scale[:, HEADING] = 0.0
    company = [column for column, name in enumerate(STATES[preset]) if name.startswith(COMPANY)]
    if modes == "paths":
        # Numbers and positions of other road users identify a recording: models that read them would not generalise.
        models.networks.scale[:, company] = prior.networks.scale[:, company] = 0.0
    if modes == "accelerations":
        # The motion of such a mode must not depend on other road users: in a queue, the hardest mode braked at 2.3
        # instead of 4 m/s², because recorded cars brake less hard there, and cars that reached the end of the queue at
        # 16 m/s could not stop.
        models.networks.scale[:, company] = 0.0
    generator = torch.Generator().manual_seed(seed)
    if modes == "paths":
        mode = train_winners(models, train, mode, epochs, generator, forget=forget, horizon=horizon)
        centres, counts = _of_modes(goal, train.type, mode, centres)
        train_path_prior(prior, models, train, epochs, generator, horizon)
    else:
        train_displacement(models, train, mode, epochs, generator, forget=forget, horizon=horizon)
        train_prior(prior, train, mode, epochs, generator)

    training: dict[str, Any] = {
        "recordings": [{"source": r.source, "licence": r.licence, "tracks": len(r.ids)} for r in recordings],
        "notice": notice,
        "stride": stride,
        "seed": seed,
        "epochs": epochs,
        "modes": config.modes,
        "modes_by": modes,
        "preset": preset,
        "acceleration_ranges": {TYPE_NAMES[t]: one.to_json() for t, one in known.items()},
        "forget": forget,
        "mirrored": [TYPE_NAMES[t] for t in types if few[t]],
        "left_out": left_out,
        "held_out_share": None if tests else HELD_OUT,
        "tests": [recording.source for recording in tests],
        "versions": {
            "slrl_sumo": __version__,
            "torch": str(torch.__version__),
            "scikit_learn": sklearn.__version__,
        },
        "types": {
            TYPE_NAMES[t]: _measured(models, prior, every, held_out, centres, counts[t], modes, known, t) for t in types
        },
    }
    return ModelBundle(
        name=name,
        config=config,
        mode_centres=centres,
        mode_counts=counts,
        weights=weights_of(models, prior),
        training=training,
        card=model_card(name, training),
    )


def _hold_out(every: Windows, seed: int) -> NDArray[np.bool_]:
    """Mask (N,) of the windows of held-out tracks: HELD_OUT of each type, at least one track."""
    random = np.random.default_rng(seed)
    identity = every.recording * (every.track.max(initial=0) + 1) + every.track
    chosen = []
    for t in RoadUserType:
        tracks = np.unique(identity[every.type == t])
        chosen.append(random.permutation(tracks)[: max(1, round(HELD_OUT * len(tracks)))])  # of none it takes none
    return np.isin(identity, np.concatenate(chosen))


def _left_out(every: Windows, held_out: NDArray[np.bool_], modes: str, k: int) -> dict[str, str]:
    """Names of the types that cannot be learned, with the reason."""
    identity = np.stack([every.recording, every.track])
    goal = goals(every, modes)
    reasons = {}
    for t in RoadUserType:
        mine = every.type == t
        train, test = (np.unique(identity[:, mine & part], axis=1).shape[1] for part in (~held_out, held_out))
        distinct = len(np.unique(np.round(goal[mine & ~held_out], 3), axis=0))
        if not (train and test):
            tracks = f"{train + test} track{'s' * (train + test != 1)} of 6 s or longer in the recordings"
            reasons[TYPE_NAMES[t]] = f"{tracks}, {train} to learn from and {test} to test; at least 1 of each is needed"
        elif distinct < k:
            reasons[TYPE_NAMES[t]] = f"{distinct} distinct destinations in the recordings, {k} modes need at least {k}"
    return reasons


def _of_modes(goal: Floats, kind: Longs, mode: Longs, centres: Floats) -> tuple[Floats, Longs]:
    """Mean of the `goal` (N, 2) of the windows of each type and mode, (3, modes, 2), and their number, (3, modes).

    Modes without windows keep their `centres`."""
    means, counts = centres.copy(), np.zeros(centres.shape[:2], np.int64)
    np.add.at(counts, (kind, mode), 1)
    sums = np.zeros_like(centres)
    np.add.at(sums, (kind, mode), goal)
    some = counts > 0
    means[some] = np.round(sums[some] / counts[some][:, None], 3) + 0.0
    return means, counts


def _set_normalisation(networks: StackedNetworks, train: Windows, types: Sequence[RoadUserType]) -> None:
    """Mean and 1 / standard deviation of each feature and type; 0 for features that are constant in a type."""
    for t in types:
        vector = train.vector[train.type == t].astype(np.float64)
        mean, deviation = vector.mean(0), vector.std(0)
        mean[HEADING], deviation[HEADING] = 0.0, np.pi / np.sqrt(3)  # uniform, as `turned` draws them
        varies = deviation > 1e-6
        networks.mean[t] = torch.from_numpy(mean)
        networks.scale[t] = torch.from_numpy(np.where(varies, 1 / np.where(varies, deviation, 1.0), 0.0))


@torch.inference_mode()
def _measured(
    models: DisplacementModels,
    prior: Prior,
    every: Windows,
    held_out: NDArray[np.bool_],
    centres: Floats,
    counts: Longs,
    modes: str,
    known: Ranges,
    t: RoadUserType,
) -> dict[str, Any]:
    """The training record of one type: sizes, errors on its held-out windows, bounds."""
    mine = every.type == t
    test, train = every.take(held_out & mine), every.take(~held_out & mine)
    by_path = modes == "paths"
    true = torch.from_numpy(
        mode_errors(models, test, HORIZONS[modes]).argmin(-1) if by_path else modes_of(test, modes, centres, known)
    )
    vector, kind = torch.from_numpy(test.vector), torch.from_numpy(test.type)
    target = torch.from_numpy(test.displacement).float()
    acceleration, yaw_rate = (both.gather(1, true[:, None])[:, 0] for both in models.motion_all(vector, kind))
    speed = vector[:, SPEED]
    moved = displacement(speed, acceleration, yaw_rate, models.max_speed[kind])
    straight = torch.stack([speed * DECISION_INTERVAL, torch.zeros_like(speed)], -1)
    error, straight_error = (moved - target).norm(dim=-1), (straight - target).norm(dim=-1)
    arrived = rolled(models, vector[:, None], kind, true)[0][:, 0, -1]
    arrival_error = (arrived - torch.from_numpy(test.destination).float()).norm(dim=-1)
    seen = torch.bincount(true, minlength=len(counts))
    way = np.hypot(train.destination[:, 0], train.destination[:, 1])
    moving = way > MOVING_DISTANCE

    def by_mode(values: torch.Tensor) -> list[float]:
        return (torch.bincount(true, values.double(), len(counts)) / seen.clamp_min(1)).tolist()

    logits = prior.logits(vector, kind)
    frequency = torch.from_numpy((counts + 1) / (counts + 1).sum())
    return {
        "tracks": len(np.unique(np.stack([every.recording, every.track])[:, mine], axis=1).T),
        "windows": int(mine.sum()),
        "held_out_windows": len(test),
        "smallest_mode": int(counts.min()),
        "displacement_error_m": float(error.mean()),
        "constant_velocity_error_m": float(straight_error.mean()),
        "destination_error_m": float(arrival_error.mean()),
        "by_mode": {
            "windows": counts.tolist(),
            "held_out_windows": seen.tolist(),
            "displacement_error_m": by_mode(error),
            "constant_velocity_error_m": by_mode(straight_error),
            "destination_error_m": by_mode(arrival_error),
        },
        "prior_cross_entropy_nats": float(functional.cross_entropy(logits, true)),
        "frequency_cross_entropy_nats": float(-frequency[true].log().mean()),
        "prior_accuracy": float((logits.argmax(-1) == true).float().mean()),
        "most_frequent_accuracy": float((true == int(counts.argmax())).float().mean()),
        "moving_speed_mps": float(way[moving].mean() / (FUTURE * DECISION_INTERVAL)) if moving.any() else None,
        "speed_percentiles_mps": np.percentile(train.vector[:, SPEED], (1, 99)).tolist(),
        "within_20_m_percentiles": np.percentile(train.vector[:, WITHIN_20].sum(1), (1, 99)).tolist(),
        "acceleration_percentiles_mps2": np.percentile(train.acceleration, (1, 99)).tolist(),
        "hardest_braking_mps2": hardest_braking(train),
        "acceleration_bounds_mps2": models.acceleration_bounds[t].tolist(),
        "yaw_rate_bounds_radps": models.yaw_rate_bounds[t].tolist(),
        "max_curvature_per_m": float(models.max_curvature[t]),
        "max_speed_mps": float(models.max_speed[t]),
    }
