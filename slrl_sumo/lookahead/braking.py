"""Constraint `braking_residual`: inside the mode that brakes hardest, road users brake as hard as recorded ones did.

The regressed mean of a mode brakes less hard than the road users that it is learned from. Where few of them stopped, as
in recordings of a shared street, no mode stops: a bicycle would need 8 m from 4 m/s and a car 20 m. And all types
brake harder in need than they usually do, pedestrians three times as hard.
"""

import numpy as np

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.scene.geometry import Floats


def braking_residual(acceleration: Floats, hardest: Floats) -> Floats:
    """What each mode's acceleration is more than that of its model, m/s², (n, modes), not positive: 0 but for the mode
    that brakes hardest, of each road user.

    `acceleration`: of the models, m/s², (n, modes); `hardest`: `ModelBundle.hardest_braking` of its type, m/s², (n,).
    """
    residual = np.zeros_like(acceleration)
    if len(acceleration):
        each, mode = np.arange(len(acceleration)), acceleration.argmin(axis=1)
        residual[each, mode] = np.minimum(hardest - acceleration[each, mode], 0.0)
    return residual


def with_braking(capability: Capability, bundle: ModelBundle) -> Capability:
    """What the modes can do with that residual: they stop in v² / (2 b) as they usually brake, and have the rest of it
    for need."""
    braking = np.maximum(-bundle.usual_braking, 1e-3)
    return Capability(capability.sharpest, np.minimum(capability.stopping, STOPPING**2 / (2.0 * braking[:, None])))
