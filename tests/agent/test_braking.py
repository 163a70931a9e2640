"""Corrections of the braking inside the mode that brakes hardest, up to what was recorded."""

import numpy as np
import pytest

from slrl_sumo.agent.braking import braking_residual, with_braking
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.capability import STOPPING, capability_of
from slrl_sumo.scene.types import RoadUserType


def test_only_the_hardest_mode_brakes_harder_and_never_less_hard() -> None:
    acceleration = np.array([[0.5, -0.6, 0.0], [-3.0, -1.0, 1.0], [0.2, 0.1, 0.3]])
    corrected = acceleration + braking_residual(acceleration, np.array([-2.5, -2.5, -1.2]))
    np.testing.assert_allclose(corrected, [[0.5, -2.5, 0.0], [-3.0, -1.0, 1.0], [0.2, -1.2, 0.3]])
    assert braking_residual(np.zeros((0, 20)), np.zeros(0)).shape == (0, 20)


@pytest.mark.parametrize("name", ["intersection", "shared-space"])
def test_all_types_of_the_shipped_bundles_can_stop(name: str) -> None:
    """The models of shared-space alone take 20 m for a car from 4 m/s, 8 m for a bicycle, 3 m on foot from 1 m/s."""
    bundle = load_bundle(name)
    models = capability_of(bundle)
    stopping = with_braking(models, bundle).stopping
    assert (stopping <= models.stopping + 1e-9).all()
    assert (np.diff(stopping, axis=1) > 0.0).all()
    for kind, speed, most in (
        (RoadUserType.CAR, 4.0, 3.5),
        (RoadUserType.BICYCLE, 4.0, 4.6),
        (RoadUserType.PEDESTRIAN, 1.0, 0.6),
    ):
        assert np.interp(speed, STOPPING, stopping[kind]) <= most
