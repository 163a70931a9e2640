"""Supervised fit: recordings -> modes, displacement models and prior (paper, sections 3.1, 3.2 and 4.1)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import sklearn
import torch
from numpy.typing import NDArray
from torch.nn import functional

import slrl_sumo
from slrl_sumo.errors import InputError
from slrl_sumo.learning.card import model_card
from slrl_sumo.learning.modes import assign, cluster
from slrl_sumo.learning.supervised import HEADING, train_displacement, train_prior
from slrl_sumo.learning.windows import Windows, windows
from slrl_sumo.models.bundle import BundleConfig, ModelBundle
from slrl_sumo.models.displacement import SPEED, DisplacementModels, displacement
from slrl_sumo.models.prior import Prior
from slrl_sumo.models.stacked import StackedNetworks
from slrl_sumo.records.trajectories import Trajectories
from slrl_sumo.world.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType

HELD_OUT = 0.1
"""Share of the tracks of each type that is kept out of training."""

TURNING = 0.02
"""rad/s; a road user with a higher yaw rate is turning."""

Longs = NDArray[np.int64]


def fit(
    recordings: Sequence[Trajectories],
    *,
    name: str,
    seed: int,
    epochs: int = 35,
    stride: int = 1,
) -> ModelBundle:
    """Learn a bundle called `name` from recordings of all three road user types.

    `stride` > 1 uses every stride-th frame only. The same seed and recordings give the same weights on one machine.
    Raises InputError where the recordings have another interval or too little of a type.
    """
    if not recordings:
        raise InputError("fit needs at least one recording; give Trajectories files made by `slrl-sumo import`")
    for recording in recordings:
        if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
            raise InputError(
                f"recording {recording.source or 'without a source'} has an interval of {recording.dt} s, "
                f"fit needs {DECISION_INTERVAL} s; import it again with that interval"
            )
    every = windows(recordings, stride)
    held_out = _hold_out(every, seed)
    train = every.take(~held_out)
    config = BundleConfig()
    centres = np.stack(
        [cluster(train.destination[train.type == t], config.modes, seed, TYPE_NAMES[t]) for t in RoadUserType]
    )
    mode = np.zeros(len(every), np.int64)
    for t in RoadUserType:
        mode[every.type == t] = assign(every.destination[every.type == t], centres[t])
    counts = np.stack([np.bincount(mode[~held_out & (every.type == t)], minlength=config.modes) for t in RoadUserType])

    models = DisplacementModels(config.modes, config.displacement_hidden)
    prior = Prior(config.modes, config.prior_hidden)
    _set_bounds(models, train)
    for networks in (models.networks, prior.networks):
        _set_normalisation(networks, train)
    generator = torch.Generator().manual_seed(seed)
    train_displacement(models, train, mode[~held_out], epochs, generator)
    train_prior(prior, train, mode[~held_out], epochs, generator)

    training: dict[str, Any] = {
        "recordings": [{"source": r.source, "licence": r.licence, "tracks": len(r.ids)} for r in recordings],
        "stride": stride,
        "seed": seed,
        "epochs": epochs,
        "modes": config.modes,
        "held_out_share": HELD_OUT,
        "versions": {
            "slrl_sumo": slrl_sumo.__version__,
            "torch": str(torch.__version__),
            "scikit_learn": sklearn.__version__,
        },
        "types": {TYPE_NAMES[t]: _measured(models, prior, every, mode, held_out, counts[t], t) for t in RoadUserType},
    }
    return ModelBundle(
        name=name,
        config=config,
        mode_centres=centres,
        mode_counts=counts,
        displacement=models.requires_grad_(False).eval(),
        prior=prior.requires_grad_(False).eval(),
        training=training,
        card=model_card(name, training),
    )


def _hold_out(every: Windows, seed: int) -> NDArray[np.bool_]:
    """Which windows, (N,), belong to the tracks that are kept out of training: HELD_OUT of each type, at least one."""
    random = np.random.default_rng(seed)
    identity = every.recording * (every.track.max(initial=0) + 1) + every.track
    chosen = []
    for t in RoadUserType:
        tracks = np.unique(identity[every.type == t])
        if len(tracks) < 2:
            raise InputError(
                f"{TYPE_NAMES[t]}: {len(tracks)} tracks of 6 s or longer in the recordings, a bundle needs at least "
                f"2 of every type; add recordings with {TYPE_NAMES[t]} traffic"
            )
        chosen.append(random.permutation(tracks)[: max(1, round(HELD_OUT * len(tracks)))])
    return np.isin(identity, np.concatenate(chosen))


def _set_bounds(models: DisplacementModels, train: Windows) -> None:
    """Bound each type by what it was recorded to do while in motion (standing ones would only narrow the bounds)."""
    before = train.vector[:, SPEED].astype(np.float64)
    after = before + train.acceleration * DECISION_INTERVAL
    for t in RoadUserType:
        rows = train.type == t
        moving = rows & (np.maximum(before, after) > 0.1)
        rows = moving if moving.any() else rows
        # Most moments are straight ahead (walkers in SUMO turn at corners only): their share must not rule the turns.
        turning = rows & (np.abs(train.yaw_rate) > TURNING)
        turning = turning if turning.any() else rows
        for bounds, values in (
            (models.acceleration_bounds, train.acceleration[rows]),
            (models.yaw_rate_bounds, train.yaw_rate[turning]),
        ):
            lowest, highest = np.percentile(values, (1, 99))
            bounds[t] = torch.tensor([min(lowest, 0.0), max(highest, 0.0)])
        fast = rows & (after > 1.0)
        if fast.any():
            models.max_curvature[t] = float(np.percentile(np.abs(train.yaw_rate[fast]) / after[fast], 99))
        models.max_speed[t] = float(np.percentile(after[rows], 99.5))


def _set_normalisation(networks: StackedNetworks, train: Windows) -> None:
    """Mean and 1 / standard deviation of each feature and type; 0 for features that are constant in a type."""
    for t in RoadUserType:
        vector = train.vector[train.type == t].astype(np.float64)
        mean, deviation = vector.mean(0), vector.std(0)
        mean[HEADING], deviation[HEADING] = 0.0, np.pi / np.sqrt(3)  # every direction alike: as `turned` makes them
        varies = deviation > 1e-6
        networks.mean[t] = torch.from_numpy(mean)
        networks.scale[t] = torch.from_numpy(np.where(varies, 1 / np.where(varies, deviation, 1.0), 0.0))


@torch.inference_mode()
def _measured(
    models: DisplacementModels,
    prior: Prior,
    every: Windows,
    mode: Longs,
    held_out: NDArray[np.bool_],
    counts: Longs,
    t: RoadUserType,
) -> dict[str, Any]:
    """The training record of one type: sizes, errors on its held-out windows, bounds."""
    test = every.take(held_out & (every.type == t))
    true = torch.from_numpy(mode[held_out & (every.type == t)])
    vector, kind = torch.from_numpy(test.vector), torch.from_numpy(test.type)
    target = torch.from_numpy(test.displacement).float()
    acceleration, yaw_rate = (both.gather(1, true[:, None])[:, 0] for both in models.motion_all(vector, kind))
    speed = vector[:, SPEED]
    moved = displacement(speed, acceleration, yaw_rate, models.max_speed[kind])
    straight = torch.stack([speed * DECISION_INTERVAL, torch.zeros_like(speed)], -1)
    logits = prior.logits(vector, kind)
    frequency = torch.from_numpy((counts + 1) / (counts + 1).sum())
    return {
        "tracks": len(np.unique(np.stack([every.recording, every.track])[:, every.type == t], axis=1).T),
        "windows": int((every.type == t).sum()),
        "held_out_windows": len(test),
        "smallest_mode": int(counts.min()),
        "displacement_error_m": float((moved - target).norm(dim=-1).mean()),
        "constant_velocity_error_m": float((straight - target).norm(dim=-1).mean()),
        "prior_cross_entropy_nats": float(functional.cross_entropy(logits, true)),
        "frequency_cross_entropy_nats": float(-frequency[true].log().mean()),
        "prior_accuracy": float((logits.argmax(-1) == true).float().mean()),
        "most_frequent_accuracy": float((true == int(counts.argmax())).float().mean()),
        "acceleration_bounds_mps2": models.acceleration_bounds[t].tolist(),
        "yaw_rate_bounds_radps": models.yaw_rate_bounds[t].tolist(),
        "max_curvature_per_m": float(models.max_curvature[t]),
        "max_speed_mps": float(models.max_speed[t]),
    }
