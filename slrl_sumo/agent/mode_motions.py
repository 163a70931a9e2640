"""The motions of all modes of road users with a route, corrected by the constraints that act within a mode."""

from typing import NamedTuple

import numpy as np

from slrl_sumo.agent.braking import braking_residual
from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.agent.steering import CORRECTED, steering_residual
from slrl_sumo.jobs.row_threads import RowThreads
from slrl_sumo.lookahead.mode_paths import mode_paths
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats


class ModeMotions(NamedTuple):
    """Motions of the modes of n road users, (n, modes) each."""

    acceleration: Floats
    """m/s²."""
    yaw_rate: Floats
    """rad/s."""
    braking_residual: Floats
    """Part of `acceleration` that the constraint of this name added, m/s²."""
    steering_residual: Floats
    """Part of `yaw_rate` that the constraint of this name added, rad/s."""


def mode_motions(
    bundle: ModelBundle,
    observation: Observation,
    scene: Scene,
    context: RouteContext,
    constraints: Constraints,
    threads: RowThreads,
) -> ModeMotions:
    """Motions of the modes of the deciding road users of `scene`, which have the `observation`. The road users are
    distributed over `threads`."""

    def corrected(some: slice) -> ModeMotions:
        acceleration, yaw_rate = bundle.motions(observation.vector[some], observation.type[some])
        rows = scene.rows[some]
        users = scene.world.take(rows)
        harder = steered = np.zeros_like(acceleration)
        if constraints.braking_residual:
            harder = braking_residual(acceleration, bundle.hardest_braking[users.type])
            acceleration = acceleration + harder
        if constraints.steering_residual:
            fastest = bundle.max_speed[users.type]
            paths = mode_paths(users, acceleration, yaw_rate, fastest, on_route=True, steps=CORRECTED)
            steered = steering_residual(context, users, rows, paths, yaw_rate, bundle.max_curvature)
            yaw_rate = yaw_rate + steered
        return ModeMotions(acceleration, yaw_rate, harder, steered)

    parts = threads.each(corrected, len(scene))
    return parts[0] if len(parts) == 1 else ModeMotions(*map(np.concatenate, zip(*parts, strict=True)))
