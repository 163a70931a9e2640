"""The lookahead guard: which modes must not be chosen, whatever the selector prefers."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.geometry import Floats
from slrl_sumo.world.route import RouteAhead
from slrl_sumo.world.types import RoadUserType

IMMINENT = 0.5
"""`meeting` of who is met within 2 s. Farther ahead it is the selector's to judge: guarded for 3.2 s, vehicles braked
in the middle of turns, where the models can then not turn any more."""
AT_ONCE = 0.75
"""`touching` of who is met within 1.2 s on the very course of a mode: who has lost its path is not where that leads."""
LATE = 1.0
"""Strain (see lookahead.strain) from which it is too late to stop."""
ALIKE = 1e-6


def allowed_modes(
    ahead: NDArray[np.float32], kind: NDArray[np.int8], route: RouteAhead, touching: Floats
) -> NDArray[np.bool_]:
    """Modes that n road users may choose, (n, modes); at least one each.

    `ahead`: (n, modes, 9), what each mode leads to (Observation.ahead in the preset `extended`); `kind`: their types;
    `route`: their routes; `touching`: (n, modes) of Lookahead. Masked are modes that meet somebody's predicted box
    within 2 s along the path or within 1.2 s on their own course, leave the own surface within 1.2 s, or after which it
    is too late to stop at a closed signal or behind who is ahead. Where none is left,
    those with the latest conflict are allowed.
    """
    meeting, off_surface, brake, follow = (ahead[..., column].astype(np.float64) for column in (0, 1, 7, 8))
    closed = (route.known & route.closed)[:, None]
    driving = (kind != RoadUserType.PEDESTRIAN)[:, None]
    # From 0, no conflict, up to 1, one at once. Contact is worse than a signal, and that than a kerb.
    meeting = np.where(meeting >= IMMINENT, meeting, 0.0)
    meeting = np.maximum(meeting, np.where(touching >= AT_ONCE, touching, 0.0))
    conflict = np.maximum(meeting, np.where(driving, _late(follow), 0.0))
    conflict = np.maximum(conflict, 0.8 * np.where(closed, _late(brake), 0.0))
    conflict = np.maximum(conflict, 0.6 * off_surface)
    least = conflict.min(axis=1, keepdims=True)
    return np.asarray(conflict <= least + ALIKE)


def _late(strain: Floats) -> Floats:
    """From 0 at LATE up to 1."""
    return np.where(strain > LATE, np.minimum(0.2 + 0.2 * (strain - LATE), 1.0), 0.0)
