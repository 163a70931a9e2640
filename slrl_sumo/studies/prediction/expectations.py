"""The routes that the road users of rollouts are expected to take."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy_files import on_expected_routes
from slrl_sumo.routing.expected_routes import ExpectedRoute, ExpectedRoutes
from slrl_sumo.studies.prediction.rollout import Cast


@dataclass(frozen=True, eq=False)
class Expectations:
    """What a selector expects of the road users of a recording."""

    bundle: ModelBundle
    """With a selector that counts as much as it does on expected routes."""
    routes: ExpectedRoutes
    types: NDArray[np.bool_]
    """Which types have routes, (3,): those of which the selector counts."""

    def of(self, recording: Trajectories, cast: Cast) -> list[ExpectedRoute | None]:
        """The routes of all members of the cast from their entries on; each call returns new ones."""
        found: list[ExpectedRoute | None] = [None] * len(cast)
        entering = np.flatnonzero((cast.enters < cast.leaves) & self.types[recording.type[cast.track]])
        # Copies of a member share what is found once.
        rows, first = np.unique(cast.row[entering] + cast.enters[entering], return_inverse=True)
        routes = self.routes.of(recording, rows)
        for member, k in zip(entering.tolist(), first.tolist(), strict=True):
            route = routes[k]
            found[member] = None if route is None else replace(route)
        return found


def expectations(bundle: ModelBundle, routes: ExpectedRoutes | None) -> Expectations | None:
    """What the bundle's selector expects on `routes`; None without them, or where it was not calibrated to expected
    routes."""
    if routes is None or bundle.policy is None:
        return None
    policy = on_expected_routes(bundle.policy, bundle.policy_training or {})
    if policy is None:
        return None
    return Expectations(replace(bundle, policy=policy), routes, policy.with_route.any(dim=1).numpy())
