"""Corrections of the steering inside a mode: towards the path, within bounds, and not at a stand."""

import numpy as np
from builders import make_world, straight_routes

from slrl_sumo.lookahead.mode_paths import mode_paths
from slrl_sumo.lookahead.steering import LATERAL, MOST, steering_residual
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CURVATURE = np.full(3, 0.2)
YAW = np.array([[-0.3, 0.0, 0.3]])


def corrected(users: WorldState, known: bool = True) -> Floats:
    """Yaw rates with the correction, of a road user beside the x axis that keeps its speed."""
    context = route_context(straight_routes((float(users.x[0]), 0.0, 0.0), known=known), users)
    paths = mode_paths(users, np.full((1, 3), 0.2), YAW, np.full(1, 20.0), halting=True)
    residual = steering_residual(context, users, np.array([0]), paths, YAW, CURVATURE)
    return np.asarray(YAW + residual)[0]


def test_modes_are_corrected_towards_the_path_within_bounds() -> None:
    for speed in (3.0, 13.0):
        left = corrected(make_world([0.0], [0.4], speed=[speed]))
        bound = min(MOST, LATERAL / speed)
        assert (np.abs(left - YAW[0]) <= bound + 1e-9).all()
        # The modes that steer right are at their bound or there already; straight on it turns right.
        assert left[1] < -0.02
        assert left[2] < YAW[0, 2] - 0.9 * bound
    # On the path, straight on needs nothing, and both others are straightened.
    on = corrected(make_world([0.0], [0.0], speed=[13.0]))
    assert abs(on[1]) < 1e-9
    assert on[0] > YAW[0, 0]
    assert on[2] < YAW[0, 2]


def test_at_a_stand_without_a_route_and_for_pedestrians_nothing_changes() -> None:
    standing = make_world([0.0], [0.4], speed=[0.0])
    context = route_context(straight_routes((0.0, 0.0, 0.0)), standing)
    paths = mode_paths(standing, np.zeros((1, 3)), np.zeros((1, 3)), np.full(1, 20.0), halting=True)
    assert not steering_residual(context, standing, np.array([0]), paths, np.zeros((1, 3)), CURVATURE).any()
    assert corrected(make_world([0.0], [0.4], speed=[5.0]), known=False).tolist() == YAW[0].tolist()
    walks = make_world([0.0], [0.4], speed=[1.3], type=[RoadUserType.PEDESTRIAN])
    assert corrected(walks).tolist() == YAW[0].tolist()
