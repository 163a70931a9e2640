"""Corrections of the steering inside a mode: towards the path, within bounds, and not at a stand."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_world, straight_routes

from slrl_sumo.agent.steering import (
    LATERAL,
    MOST,
    SHARE,
    SHARP,
    TIGHTER,
    TURNING,
    TURNS,
    steering_residual,
    with_steering,
)
from slrl_sumo.lookahead.mode_paths import mode_paths
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.capability import SPEEDS, STOPPING, Capability
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CURVATURE = np.full(3, 0.2)
YAW = np.array([[-0.3, 0.0, 0.3]])


def corrected(users: WorldState, known: bool = True) -> Floats:
    """Yaw rates with the correction, of a road user beside the x axis that keeps its speed."""
    context = route_context(straight_routes((float(users.x[0]), 0.0, 0.0), known=known), users)
    paths = mode_paths(users, np.full((1, 3), 0.2), YAW, np.full(1, 20.0), on_route=True)
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


def test_modes_of_pedestrians_that_hardly_turn_turn_further() -> None:
    def turning(*yaw: float, speed: float = 1.3) -> list[float]:
        user = make_world([0.0], [0.0], heading=[1.5], speed=[speed], type=[RoadUserType.PEDESTRIAN])
        context, modes = route_context(straight_routes((0.0, 0.0, 0.0)), user), np.array([yaw])
        paths = mode_paths(user, np.zeros((1, len(yaw))), modes, np.full(1, 2.0), on_route=True)
        residual = steering_residual(context, user, np.array([0]), paths, modes, CURVATURE)
        return (modes + residual)[0].tolist()

    # To either side in proportion, also at a stand.
    for speed in (0.0, 1.3):
        assert turning(-0.2, -0.1, 0.0, 0.05, 0.1, speed=speed) == pytest.approx(
            [-TURNS, -0.5 * TURNS, 0.0, 0.5, TURNS]
        )
    # Modes that turn enough are left alone, and so are those of which one turns farther.
    assert turning(-SHARP, 0.0, SHARP) == [-SHARP, 0.0, SHARP]
    assert turning(-0.1, 0.0, 2.0) == pytest.approx([-TURNS, 0.0, 2.0])
    # Nothing makes one turn that does not turn at all.
    assert turning(0.0, 0.0) == [0.0, 0.0]


def test_at_a_stand_and_without_a_route_nothing_changes() -> None:
    standing = make_world([0.0], [0.4], speed=[0.0])
    context = route_context(straight_routes((0.0, 0.0, 0.0)), standing)
    paths = mode_paths(standing, np.zeros((1, 3)), np.zeros((1, 3)), np.full(1, 20.0), on_route=True)
    assert not steering_residual(context, standing, np.array([0]), paths, np.zeros((1, 3)), CURVATURE).any()
    assert corrected(make_world([0.0], [0.4], speed=[5.0]), known=False).tolist() == YAW[0].tolist()


def test_in_a_tight_turn_vehicles_steer_as_sharply_as_the_turn_is() -> None:
    user = make_world([0.0], [0.4], speed=[2.0])
    # The path leads to the other direction, as that of a turnaround.
    turned = replace(user, heading=np.array([2.0]))
    context = route_context(straight_routes((0.0, 0.0, 0.0)), turned)
    for tight in (0.0, 0.6):
        known = replace(context, route=replace(context.route, tight_curvature=np.array([tight])))
        paths = mode_paths(turned, np.zeros((1, 3)), YAW, np.full(1, 20.0), on_route=True)
        yaw = (YAW + steering_residual(known, turned, np.array([0]), paths, YAW, CURVATURE))[0]
        # As sharply as recorded, or a little sharper than the turn.
        assert -yaw.min() <= (max(0.2, (1.0 + TIGHTER) * tight)) * 2.0 + 1e-9
        assert (-yaw.min() > 1.0) == (tight > 0.0)


def test_part_of_the_correction_counts_as_what_the_modes_can_do() -> None:
    models = Capability(np.full((3, 2, len(SPEEDS)), 0.1), np.tile(STOPPING, (3, 1)))
    bundle = load_bundle("intersection")
    sharpest = with_steering(models, bundle).sharpest
    assert np.array_equal(sharpest[RoadUserType.PEDESTRIAN], models.sharpest[RoadUserType.PEDESTRIAN])
    more = sharpest[RoadUserType.CAR, 0] - 0.1
    for speed in (1.0, 4.0, 10.0, 30.0):
        by_hand = SHARE * min(MOST, LATERAL / speed) / max(speed, TURNING)
        assert more[SPEEDS.searchsorted(speed)] == pytest.approx(by_hand)
    # No sharper than recorded, and nothing where they cannot turn at all.
    wide = Capability(np.full((3, 2, len(SPEEDS)), float(bundle.max_curvature[0])), models.stopping)
    assert np.array_equal(with_steering(wide, bundle).sharpest[0], wide.sharpest[0])
    straight = Capability(np.zeros((3, 2, len(SPEEDS))), models.stopping)
    assert not with_steering(straight, bundle).sharpest.any()
