"""Constraint `guard`: excludes modes that lead into a conflict (before the deadlock release, which may override it)."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.types import RoadUserType

COLLISION_SOON = 0.5
"""Collision score of a collision within 2 s. Later ones are left to the selector: guarded for 3.2 s, vehicles braked in
the middle of turns, where the models can then not turn any more."""
COLLISION_NOW = 0.75
"""Collision score of a collision within 1.2 s on the path of the mode itself: a vehicle that has lost its route is not
where the route leads."""
TOO_LATE = 1.0
"""Stop or follow ratio (see lookahead.route_fit) from which it is too late to stop."""
EQUAL = 1e-6


def guard(rollouts: ModeRollouts, kind: NDArray[np.int8], route: RouteAhead) -> NDArray[np.bool_]:
    """Mask of the modes that n road users may choose, (n, modes); at least one mode each.

    `rollouts` along their routes, with `collision_off_route`; `kind`: their types. Not allowed are modes that collide
    within 2 s along the route or within 1.2 s on their own path, that leave the own surface within 1.2 s, or after
    which it is too late to stop at a closed signal or behind the leader. Where no mode remains, those with the least
    severe conflict are allowed.
    """
    assert rollouts.route is not None
    assert rollouts.collision_off_route is not None
    driving = kind != RoadUserType.PEDESTRIAN
    fit = rollouts.route
    return _guard(
        rollouts.collision,
        rollouts.collision_off_route,
        rollouts.off_surface,
        np.where(driving[:, None], fit.follow_ratio, 0.0),
        np.where((route.known & route.stop_at_signal)[:, None], fit.stop_ratio, 0.0),
    )


@compiled
def _guard(
    collision: Floats, off_route: Floats, off_surface: Floats, follow: Floats, stop: Floats
) -> NDArray[np.bool_]:
    n, modes = collision.shape
    allowed, conflict = np.empty((n, modes), np.bool_), np.empty(modes)
    for i in range(n):
        least = np.inf
        for mode in range(modes):
            # From 0, no conflict, up to 1, one at once. A collision is worse than a signal, and that than a kerb.
            worst = 0.6 * off_surface[i, mode]
            if collision[i, mode] >= COLLISION_SOON:
                worst = max(worst, collision[i, mode])
            if off_route[i, mode] >= COLLISION_NOW:
                worst = max(worst, off_route[i, mode])
            worst = max(worst, _late(follow[i, mode]), 0.8 * _late(stop[i, mode]))
            conflict[mode] = worst
            least = min(least, worst)
        for mode in range(modes):
            allowed[i, mode] = conflict[mode] <= least + EQUAL
    return allowed


@compiled
def _late(ratio: float) -> float:
    """From 0 at TOO_LATE up to 1."""
    return min(0.2 + 0.2 * (ratio - TOO_LATE), 1.0) if ratio > TOO_LATE else 0.0
