"""Capability of the models of a bundle: the sharpest curves and the stopping distances."""

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from slrl_sumo.models import motion_models
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.features import FEATURES, PAST_SPEED
from slrl_sumo.perception.past_motion import PAST
from slrl_sumo.scene import advance
from slrl_sumo.scene.compiled import cache_folder
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

SPEEDS = np.arange(1.0, 45.5, 0.5)
"""Speeds (m/s) at which the models are probed for curves."""
STOPPING = np.arange(0.0, 50.5, 0.25)
"""Speeds (m/s) from which stopping distances are probed."""
MAX_DECISIONS = 60
"""Greatest number of decisions of a probed stop."""
PROBED_NEIGHBOURS = (0, 1, 3)
"""Probed numbers of other road users within 20 m, on which the turns of models depend."""
MOST_FILES = 32
"""Greatest number of bundles with stored results."""
MAX_CURVE_BRAKING = -1.5
"""Acceleration (m/s²) below which a mode brakes too hard to count for curves."""


@dataclass(frozen=True, eq=False)
class Capability:
    """Capability of the modes of a bundle, by type."""

    sharpest: Floats
    """Greatest curvature (1/m) at each of SPEEDS, to the right and to the left, (3, 2, speeds); falls with speed."""
    stopping: Floats
    """Stopping distance (m) from each of STOPPING with the hardest braking of the modes, (3, speeds); rises with
    speed."""


def capability_of(bundle: ModelBundle) -> Capability:
    """Capability of the modes of a bundle.

    It is probed on first use on a machine, which takes half as long as the rest of a start, and afterwards read from a
    file beside the machine code.
    """
    folder = cache_folder()
    if folder is None:
        return probed(bundle)
    file = folder / f"capability-{_stamp(bundle)}.npz"
    try:
        with np.load(file) as stored:
            return Capability(stored["sharpest"], stored["stopping"])
    except (OSError, ValueError, KeyError, BadZipFile):
        found = probed(bundle)
    with suppress(OSError):
        older = sorted(folder.glob("capability-*.npz"), key=lambda one: one.stat().st_mtime)
        for one in older[: 1 - MOST_FILES]:
            one.unlink(missing_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".capability-", suffix=".npz", delete=False) as new:
            np.savez(new, sharpest=found.sharpest, stopping=found.stopping)
        os.replace(new.name, file)
    return found


def _stamp(bundle: ModelBundle) -> str:
    """Digest of the models and of the code that probes them, on which the result depends."""
    digest = hashlib.sha256(bundle.config.preset.encode())
    for module in (sys.modules[__name__], motion_models, advance):
        digest.update(Path(str(module.__file__)).read_bytes())
    for name in sorted(bundle.weights):
        if name.startswith("displacement."):
            digest.update(np.ascontiguousarray(bundle.weights[name]).tobytes())
    return digest.hexdigest()[:16]


def probed(bundle: ModelBundle) -> Capability:
    """Probe all modes of a bundle; figures are medians over PROBED_NEIGHBOURS."""
    sharpest = np.zeros((len(PROBED_NEIGHBOURS), len(RoadUserType), 2, len(SPEEDS)))
    stopping = np.zeros((len(RoadUserType), len(STOPPING)))
    for kind in RoadUserType:
        for company, others in enumerate(PROBED_NEIGHBOURS):
            acceleration, yaw_rate = _motions(bundle, kind, SPEEDS, np.zeros(len(SPEEDS)), others)
            after = np.maximum(SPEEDS[:, None] + acceleration * DECISION_INTERVAL, 0.5)
            curve = np.where(acceleration > MAX_CURVE_BRAKING, yaw_rate / after, 0.0)
            sharpest[company, kind] = -curve.min(axis=1), curve.max(axis=1)
        stopping[kind] = _stopping(bundle, kind)
    # A curve that is possible at some speed is possible at any lower speed: the road user accelerates first.
    usual = np.median(sharpest, axis=0)
    falling = np.maximum.accumulate(usual[..., ::-1], axis=-1)[..., ::-1]
    return Capability(np.ascontiguousarray(falling), stopping)


def _stopping(bundle: ModelBundle, kind: RoadUserType) -> Floats:
    """Stopping distances (m) from each of STOPPING, or the distance of MAX_DECISIONS decisions."""
    speed, past = STOPPING.copy(), np.zeros(len(STOPPING))
    distance = np.zeros(len(STOPPING))
    for _ in range(MAX_DECISIONS):
        # All standing road users are equal; keep only the first one, which stands from the begin.
        still = (speed == 0.0) & (past == 0.0)
        going = np.flatnonzero(~still | (np.arange(len(still)) == still.argmax()))
        each = [
            _motions(bundle, kind, speed[going], past[going], others)[0].min(axis=1) for others in PROBED_NEIGHBOURS
        ]
        hardest = np.empty(len(speed))
        hardest[going] = np.median(each, axis=0)
        hardest[still] = hardest[still.argmax()]
        hardest = advance.halting(speed, hardest, DECISION_INTERVAL)
        after = np.maximum(speed + hardest * DECISION_INTERVAL, 0.0)
        past, speed = (after - speed) / DECISION_INTERVAL, after
        distance += speed * DECISION_INTERVAL
        if not speed.any():
            break
    # Strictly rising, so that it can be inverted.
    return np.maximum.accumulate(distance) + 1e-3 * STOPPING


def _motions(
    bundle: ModelBundle, kind: RoadUserType, speed: Floats, acceleration: Floats, others: int
) -> tuple[Floats, Floats]:
    """Accelerations (m/s²) and yaw rates (rad/s) of all modes, (speeds, modes), for road users of one type."""
    vector = np.zeros((len(speed), len(bundle.config.features)), np.float32)
    vector[:, 0], vector[:, 1] = speed, acceleration
    vector[:, FEATURES.index(kind.name.lower())] = 1.0
    vector[:, [FEATURES.index("vru_20"), FEATURES.index("other_20")]] = others
    if bundle.config.preset == "history":  # straight ahead until now
        for ago in range(PAST):
            before = np.maximum(speed - acceleration * (ago + 1) * DECISION_INTERVAL, 0.0)
            vector[:, PAST_SPEED + ago] = before
    found = motion_models.motions(bundle.models, vector, np.full(len(speed), int(kind)))
    return found[0].astype(np.float64), found[1].astype(np.float64)
