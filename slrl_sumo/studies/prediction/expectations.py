"""Expected routes of the road users of rollouts."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.trained_policy import on_expected_routes
from slrl_sumo.routing.expected_routes import ExpectedRoute, ExpectedRoutes
from slrl_sumo.studies.prediction.rollout import Cast


@dataclass(frozen=True, eq=False)
class Expectations:
    """Expected routes of the road users of a recording for a selector."""

    bundle: ModelBundle
    """Bundle with a selector that is weighted for expected routes."""
    routes: ExpectedRoutes
    types: NDArray[np.bool_]
    """Whether each type has expected routes, (3,): types with a nonzero weight of the selector."""

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
    """The Expectations of the bundle's selector on `routes`; None without routes, or without a calibration to them."""
    if routes is None or bundle.policy is None:
        return None
    policy = on_expected_routes(bundle.policy, bundle.policy_training or {})
    if policy is None:
        return None
    return Expectations(replace(bundle, policy=policy), routes, policy.with_route.any(dim=1).numpy())
