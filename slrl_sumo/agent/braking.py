"""Constraint `braking_residual`: the mode that brakes hardest brakes as hard as recorded road users did.

The regressed mean of a mode brakes less hard than the recorded road users. If few of these stopped, such as in
recordings of a shared street, no mode stops: from 4 m/s, a bicycle would need 8 m and a car 20 m. All types brake
harder in emergencies than usual, pedestrians three times as hard.
"""

import numpy as np

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.scene.geometry import Floats


def braking_residual(acceleration: Floats, hardest: Floats) -> Floats:
    """Difference of each mode's acceleration to that of its model, m/s², (n, modes), not positive.

    It is 0 for all modes except the mode of each road user that brakes hardest. `acceleration`: of the models, m/s²,
    (n, modes). `hardest`: `ModelBundle.hardest_braking` for the type of each road user, m/s², (n,).
    """
    residual = np.zeros_like(acceleration)
    if len(acceleration):
        each, mode = np.arange(len(acceleration)), acceleration.argmin(axis=1)
        residual[each, mode] = np.minimum(hardest - acceleration[each, mode], 0.0)
    return residual


def with_braking(capability: Capability, bundle: ModelBundle) -> Capability:
    """Capability of the modes with the braking residual: they stop within v² / (2 b) with the usual deceleration b; the
    rest of the residual is a reserve."""
    braking = np.maximum(-bundle.usual_braking, 1e-3)
    return Capability(capability.sharpest, np.minimum(capability.stopping, STOPPING**2 / (2.0 * braking[:, None])))
