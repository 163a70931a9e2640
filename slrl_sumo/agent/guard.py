"""The lookahead guard: which modes must not be chosen, whatever the selector prefers."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.types import RoadUserType

IMMINENT = 0.5
"""`meeting` of who is met within 2 s. Farther ahead it is the selector's to judge: guarded for 3.2 s, vehicles braked
in the middle of turns, where the models can then not turn any more."""
AT_ONCE = 0.75
"""`touching` of who is met within 1.2 s on the very course of a mode: who has lost its path is not where that leads."""
LATE = 1.0
"""Strain (see onroute.strain) from which it is too late to stop."""
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
    return _allowed_modes(
        ahead, route.known & route.closed, kind != RoadUserType.PEDESTRIAN, np.ascontiguousarray(touching)
    )


@compiled
def _allowed_modes(
    ahead: NDArray[np.float32], closed: NDArray[np.bool_], driving: NDArray[np.bool_], touching: Floats
) -> NDArray[np.bool_]:
    n, modes, _ = ahead.shape
    allowed, conflict = np.empty((n, modes), np.bool_), np.empty(modes)
    for i in range(n):
        least = np.inf
        for mode in range(modes):
            # From 0, no conflict, up to 1, one at once. Contact is worse than a signal, and that than a kerb.
            worst = 0.6 * ahead[i, mode, 1]
            if ahead[i, mode, 0] >= IMMINENT:
                worst = max(worst, ahead[i, mode, 0])
            if touching[i, mode] >= AT_ONCE:
                worst = max(worst, touching[i, mode])
            if driving[i]:
                worst = max(worst, _late(ahead[i, mode, 8]))
            if closed[i]:
                worst = max(worst, 0.8 * _late(ahead[i, mode, 7]))
            conflict[mode] = worst
            least = min(least, worst)
        for mode in range(modes):
            allowed[i, mode] = conflict[mode] <= least + ALIKE
    return allowed


@compiled
def _late(strain: float) -> float:
    """From 0 at LATE up to 1."""
    return min(0.2 + 0.2 * (strain - LATE), 1.0) if strain > LATE else 0.0
