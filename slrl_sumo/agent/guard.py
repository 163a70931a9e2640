"""Constraint `guard`: excludes modes that lead into a conflict (before the deadlock release, which may override it)."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.types import PEDESTRIAN

COLLISION_SOON = 0.5
"""Collision score of a collision within 2 s. The selector handles later collisions: with a guard for 3.2 s, vehicles
braked in the middle of turns, where the models can then no longer turn."""
COLLISION_NOW = 0.75
"""Collision score of a collision within 1.2 s on the path of the mode itself, for vehicles that have left their
route."""
TOO_LATE = 1.0
"""Stop or follow ratio (see lookahead.route_fit) from which it is too late to stop."""
EQUAL = 1e-6


def guard(rollouts: ModeRollouts, kind: NDArray[np.int8], route: RouteAhead) -> NDArray[np.bool_]:
    """Mask of the modes that n road users may choose, (n, modes); at least one mode each.

    `rollouts`: along the routes, with `collision_off_route`. `kind`: types of the road users. The guard excludes modes
    that collide within 2 s along the route or within 1.2 s on their own path, that leave the own surfaces within 1.2 s,
    or after which the road user cannot stop at a red signal or behind its leader. If no mode remains, the modes with
    the least severe conflict are allowed.
    """
    assert rollouts.route is not None
    assert rollouts.collision_off_route is not None
    driving = kind != PEDESTRIAN
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
            # Severity from 0 (no conflict) to 1 (immediate). A collision is worse than a red signal, which is worse
            # than leaving the surface.
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
    """Severity of a ratio: 0 up to TOO_LATE, then from 0.2 up to 1."""
    return min(0.2 + 0.2 * (ratio - TOO_LATE), 1.0) if ratio > TOO_LATE else 0.0
