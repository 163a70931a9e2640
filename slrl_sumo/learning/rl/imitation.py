"""Imitation of the modes of recorded road users, before the training by reward.

The prior depends only on the vector. Imitation uses the same windows with images, so that the policy also learns the
course of the road and the road users on it. PPO then need not discover lanes and braking by chance.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import cross_entropy

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.learning.supervised.goals import HORIZONS, modes_of, trained_ranges
from slrl_sumo.learning.supervised.windows import FUTURE, windows
from slrl_sumo.learning.supervised.winner_takes_all import mode_errors
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import Policy, policy_logits
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS, ego_images
from slrl_sumo.simulation.record import record
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.session import SumoSession


@dataclass(frozen=True)
class ImitationSettings:
    """Settings of the imitation before PPO."""

    epochs: int = 4
    """Number of passes over the windows; 0: no imitation, PPO starts from the prior."""
    seconds: float = 400.0
    """Duration (s) of plain SUMO traffic that is recorded in each scenario."""
    stride: int = 4
    """Use every stride-th frame, because successive windows hardly differ."""
    learning_rate: float = 1e-3
    batch: int = 512


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """M windows with observations and the modes of the recorded motion."""

    vector: NDArray[np.float32]
    """(M, 12)."""
    image: NDArray[np.uint8]
    """(M, EGO_ROWS, EGO_COLS, 3)."""
    type: NDArray[np.int64]
    mode: NDArray[np.int64]
    """The mode nearest to the recorded motion, (M,)."""

    def __len__(self) -> int:
        return len(self.type)


def demonstrations(recording: Trajectories, roadmap: RoadMap, bundle: ModelBundle, stride: int) -> Demonstrations:
    """All windows of a recording on its ground, with the modes of `bundle`."""
    modes_by = str(bundle.training.get("modes_by", "kmeans"))
    horizon = HORIZONS.get(modes_by, FUTURE)
    every = windows([recording], stride, bundle.config.preset, max(horizon, FUTURE))
    every = every.take(bundle.types[every.type])
    if modes_by == "paths":
        mode = mode_errors(bundle.displacement, every, horizon).argmin(-1)
    else:
        mode = modes_of(every, modes_by, bundle.mode_centres, trained_ranges(bundle.training))
    image = np.zeros((len(every), EGO_ROWS, EGO_COLS, 3), np.uint8)
    for frame in np.unique(every.frame):
        here = np.flatnonzero(every.frame == frame)
        rows = recording.rows_at(int(frame))
        place = np.searchsorted(recording.track[rows], every.track[here])
        image[here] = ego_images(recording.world(int(frame)), place, roadmap)
    return Demonstrations(every.vector, image, every.type, mode)


def recorded_traffic(scenario: Scenario, seconds: float, seed: int) -> tuple[Trajectories, RoadMap]:
    """Plain SUMO traffic in a scenario, and the road map of the scenario."""
    for item in record(scenario, seconds=seconds, seed=seed):
        if isinstance(item, Trajectories):
            recording = item
    with SumoSession(scenario, seed=seed) as session:
        return recording, RoadMap(session.network.surfaces())


def imitate(
    policy: Policy,
    bundle: ModelBundle,
    parts: list[Demonstrations],
    settings: ImitationSettings,
    seed: int,
    report: Callable[[float, dict[str, float]], None],
) -> None:
    """Fit `policy` (in place) to the recorded modes, and empty `parts`.

    After each epoch, `report` is called with the completed share and figures from a tenth of each part that is not used
    for fitting: cross-entropy (nats) and accuracy of the policy, `imitation/cross_entropy` and `imitation/accuracy`,
    and the same figures of the prior.
    """
    generator = torch.Generator().manual_seed(seed)
    vector, image, kind, mode = (
        torch.from_numpy(np.concatenate([getattr(part, name) for part in parts]))
        for name in ("vector", "image", "type", "mode")
    )
    # Test on the last tenth of each part: windows of a road user are adjacent, so these belong to other road users.
    tested = torch.cat([torch.arange(len(part)) >= 0.9 * len(part) for part in parts])
    parts.clear()  # frees the images, which are large
    train, test = (~tested).nonzero()[:, 0], tested.nonzero()[:, 0]
    optimizer = torch.optim.Adam(policy.parameters(), lr=settings.learning_rate)
    batches = -(-len(train) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=max(1, batches * settings.epochs)
    )
    for epoch in range(settings.epochs):
        order = train[torch.randperm(len(train), generator=generator)]
        for rows in torch.split(order, settings.batch):
            ahead = _no_lookahead(bundle, len(rows))
            logits, _ = policy_logits(policy, bundle.prior, vector[rows], image[rows], kind[rows], ahead)
            loss = cross_entropy(logits, mode[rows])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
        report((epoch + 1) / settings.epochs, _measured(policy, bundle, vector, image, kind, mode, test))


def _no_lookahead(bundle: ModelBundle, rows: int) -> torch.Tensor:
    """A lookahead without collisions and without leaving the surface, which PPO's teacher handles, not imitation."""
    return torch.zeros(rows, bundle.config.modes, 4)


def _measured(
    policy: Policy,
    bundle: ModelBundle,
    vector: torch.Tensor,
    image: torch.Tensor,
    kind: torch.Tensor,
    mode: torch.Tensor,
    test: torch.Tensor,
) -> dict[str, float]:
    with torch.no_grad():
        parts = [
            policy_logits(
                policy, bundle.prior, vector[rows], image[rows], kind[rows], _no_lookahead(bundle, len(rows))
            )[0]
            for rows in torch.split(test, 4096)
        ]
        logits = torch.cat(parts)
        known = torch.log_softmax(bundle.prior.logits(vector[test], kind[test]), -1)
    right = mode[test]
    return {
        "imitation/cross_entropy": float(cross_entropy(logits, right)),
        "imitation/accuracy": float((logits.argmax(-1) == right).float().mean()),
        "imitation/prior_cross_entropy": float(cross_entropy(known, right)),
        "imitation/prior_accuracy": float((known.argmax(-1) == right).float().mean()),
    }
