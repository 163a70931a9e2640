"""Constraint `steering_residual`: a bounded correction of the yaw rate within a mode, towards the path.

The regressed mean of a mode has one yaw rate at each speed; of 20 modes, neighbouring modes are about 0.1 rad/s apart
at 13 m/s. Lane keeping needs finer steering. If pedestrians were recorded on a straight street, no mode turns them
around a corner, or past a car: the correction then enlarges the turns of pedestrian modes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.lookahead.route_fit import aim
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import SPEEDS, Capability
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import wrapped
from slrl_sumo.scene.route import on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN, RoadUserType

CORRECTED = 1
"""Intervals after which the corrected heading equals the direction of the path at that place. With 2, vehicles turned
towards the direction of the path 0.8 s ahead: cars cut tight turns by 0.4 m, over the corners where persons wait, and
the lookahead, which checks collisions along the path, did not show it."""
LATERAL = 1.0
"""Greatest lateral acceleration (m/s²) of the correction."""
MOST = 0.15
"""Greatest correction (rad/s)."""
SHARE, TURNING = 0.5, 5.0
"""Share of the correction that counts towards the capability of the modes, and speed (m/s) below which the correction
counts as at this speed: at lower speeds, paths through junctions would contain turns so sharp that vehicles would have
to crawl."""
TIGHTER = 0.2
"""Share by which steering may exceed the curvature of a tight turn, to return to the path within the turn."""
SHARP, TURNS = 0.4, 1.0
"""Yaw rates (rad/s): if no mode of a pedestrian turns by SHARP to a side, its sharpest mode to that side turns by TURNS
and its other modes in proportion, also at a stand. Otherwise a pedestrian before a car could not step aside, and both
waited for minutes."""
TURNED = 0.01
"""Yaw rate (rad/s) below which a mode does not turn."""


def steering_residual(
    context: RouteContext,
    users: WorldState,
    rows: NDArray[np.intp],
    paths: ModePaths,
    yaw_rate: Floats,
    max_curvature: Floats,
) -> Floats:
    """Correction of the yaw rate of each mode, rad/s, (n, modes): zeros without a route.

    `rows`: rows of the n road users in `context`. `users`: their states. `paths`: paths of their modes with the yaw
    rates `yaw_rate`, rad/s, (n, modes), for at least CORRECTED intervals. `max_curvature`: greatest curvature by type,
    1/m, (3,); it also bounds the corrected modes of vehicles.
    """
    route, then = context.route, CORRECTED - 1
    walks = users.type == PEDESTRIAN
    offset, direction, drives = np.zeros(yaw_rate.shape), np.zeros(yaw_rate.shape), np.flatnonzero(~walks)
    # The correction of pedestrians does not depend on their paths.
    _, offset[drives], direction[drives] = on_path(route, paths.x[drives, then], paths.y[drives, then], rows[drives])
    speed = np.ascontiguousarray(paths.speed[:, then])
    most = np.maximum(max_curvature[users.type], (1.0 + TIGHTER) * route.tight_curvature[rows])
    return _residual(
        route.known[rows], walks, users.heading, yaw_rate, offset, direction, speed, most, route.tight_curvature[rows]
    )


def with_steering(capability: Capability, bundle: ModelBundle) -> Capability:
    """Capability of the modes with the steering residual: SHARE of it adds to the yaw rates, the rest serves the return
    to the path."""
    further = SHARE * np.minimum(MOST, LATERAL / SPEEDS) / np.maximum(SPEEDS, TURNING)
    sharpest = capability.sharpest.copy()
    for kind in (RoadUserType.CAR, RoadUserType.BICYCLE):
        most = np.maximum(bundle.max_curvature[kind], sharpest[kind])
        sharpest[kind] = np.minimum(np.where(sharpest[kind] > 0.0, sharpest[kind] + further, 0.0), most)
    return Capability(sharpest, capability.stopping)


@compiled
def _residual(
    known: NDArray[np.bool_],
    walks: NDArray[np.bool_],
    heading: Floats,
    yaw_rate: Floats,
    offset: Floats,
    direction: Floats,
    speed: Floats,
    curvature: Floats,
    tight: Floats,
) -> Floats:
    """`offset`, `direction` and `speed` after CORRECTED intervals, (n, modes)."""
    n, modes = yaw_rate.shape
    time = CORRECTED * DECISION_INTERVAL
    residual = np.zeros((n, modes))
    for i in range(n):
        if not known[i]:
            continue
        if walks[i]:
            left = right = 0.0
            for mode in range(modes):
                left, right = max(left, yaw_rate[i, mode]), max(right, -yaw_rate[i, mode])
            if min(left, right) < SHARP:
                for mode in range(modes):
                    sharpest = left if yaw_rate[i, mode] > 0.0 else right
                    residual[i, mode] = yaw_rate[i, mode] * max(TURNS / max(sharpest, TURNED) - 1.0, 0.0)
            continue
        for mode in range(modes):
            now = speed[i, mode]
            off = wrapped(heading[i] + time * yaw_rate[i, mode] - direction[i, mode] + aim(offset[i, mode], now))
            bound = min(MOST, LATERAL / max(now, 1.0)) + tight[i] * now
            corrected = yaw_rate[i, mode] + min(max(-off / time, -bound), bound)
            # The yaw rate is proportional to the speed: 0 at a stand.
            most = curvature[i] * now
            residual[i, mode] = min(max(corrected, -most), most) - yaw_rate[i, mode]
            if math.fabs(yaw_rate[i, mode]) > most:
                residual[i, mode] = 0.0
    return residual
