"""Terms of the reward that depend on the routes of road users."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import make_world, straight_routes

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.learning.rewards.transition import Transition
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

PEDESTRIAN, BICYCLE = RoadUserType.PEDESTRIAN, RoadUserType.BICYCLE


@pytest.mark.parametrize(("south", "usual"), [(Surface.ROAD, -0.1), (Surface.CROSSING, 0.0)])
def test_pedestrians_pay_for_the_carriageway_beside_their_path_but_not_on_it(south: Surface, usual: float) -> None:
    def surface_at(x: Floats, y: Floats) -> np.ndarray:
        """Sidewalk north of y = 0."""
        return np.where(np.asarray(y) > 0.0, Surface.SIDEWALK, south).astype(np.uint8)

    # All are south, 2 m on; only the path of the second leads along it.
    world = make_world([2.0] * 4, -1.0, type=[PEDESTRIAN, PEDESTRIAN, BICYCLE, PEDESTRIAN])
    route = straight_routes((0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 1, 0), known=[True, True, True, False])
    before: Any = SimpleNamespace(
        context=SimpleNamespace(route=route), scene=SimpleNamespace(road_map=SimpleNamespace(surface_at=surface_at))
    )
    decision: Any = SimpleNamespace(surface=surface_at(world.x, world.y), wrapped_around=np.zeros(4, np.bool_))
    none = np.zeros(4, np.bool_)
    ground: Any = None
    transition = Transition(ground, before, np.zeros(4, np.int64), world, decision, none, none)
    assert transition.terms(["off_surface"])["off_surface"] == pytest.approx([-1.0, usual, usual, usual])
