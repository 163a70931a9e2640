"""Terms of the reward that depend on the routes of road users."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from builders import make_world, straight_routes

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.ground.tiles import Ids
from slrl_sumo.learning.rewards.transition import Transition
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

PEDESTRIAN, BICYCLE = RoadUserType.PEDESTRIAN, RoadUserType.BICYCLE


def _transition(
    before: WorldState, after: WorldState, route: RouteAhead, surface_at: Callable[[Floats, Floats], Ids]
) -> Transition:
    """Of road users on routes, on this ground."""
    n = len(route)
    road_map: Any = SimpleNamespace(surface_at=surface_at)
    road_map.beyond_own_surface = partial(RoadMap.beyond_own_surface, road_map)
    situation: Any = SimpleNamespace(context=route_context(route, before), scene=SimpleNamespace(road_map=road_map))
    decision: Any = SimpleNamespace(surface=surface_at(after.x, after.y), wrapped_around=np.zeros(n, np.bool_))
    none, ground = np.zeros(n, np.bool_), None
    return Transition(cast(Any, ground), situation, np.zeros(n, np.int64), after, decision, none, none)


@pytest.mark.parametrize(("south", "usual"), [(Surface.ROAD, -0.1), (Surface.CROSSING, 0.0)])
def test_pedestrians_pay_for_the_carriageway_beside_their_path_but_not_on_it(south: Surface, usual: float) -> None:
    def surface_at(x: Floats, y: Floats) -> np.ndarray:
        """Sidewalk north of y = 0."""
        return np.where(np.asarray(y) > 0.0, Surface.SIDEWALK, south).astype(np.uint8)

    # All are south, 2 m on; only the path of the second leads along it.
    world = make_world([2.0] * 4, -1.0, type=[PEDESTRIAN, PEDESTRIAN, BICYCLE, PEDESTRIAN])
    route = straight_routes((0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 1, 0), known=[True, True, True, False])
    transition = _transition(world, world, route, surface_at)
    assert transition.terms(["off_surface"])["off_surface"] == pytest.approx([-1.0, usual, usual, usual])


def test_pedestrians_pay_the_more_the_farther_they_are_off_all_ground() -> None:
    def surface_at(x: Floats, y: Floats) -> Ids:
        """Sidewalk north of y = 0, else nothing."""
        return np.where(np.asarray(y) > 0.0, Surface.SIDEWALK, Surface.NONE).astype(np.uint8)

    world = make_world([2.0] * 4, [-0.1, -0.6, -3.0, 0.1], type=PEDESTRIAN)
    route = straight_routes(*[(0.0, 1.0, 0.0)] * 4)
    paid = _transition(world, world, route, surface_at).terms(["off_surface"])["off_surface"]
    assert paid == pytest.approx([-1.0, -3.0, -4.0, 0.0])


def test_one_that_stands_covers_no_way_and_passes_no_line() -> None:
    """Its path begins 0.5 m behind it, and 0.3 m behind it is the line of a red light."""
    begin, end = make_world([0.5, 0.0], 0.0, type=PEDESTRIAN), make_world([0.5, 0.5], 0.0, type=PEDESTRIAN)
    route = straight_routes((0, 0, 0), (0, 0, 0), line=0.2, stop_at_signal=True)
    transition = _transition(begin, end, route, lambda x, _: np.full(len(x), Surface.SIDEWALK, np.uint8))
    transition.__dict__["_allowed"] = np.full(2, 1.25)
    terms = transition.terms(["progress", "red"])
    assert terms["progress"] == pytest.approx([0.0, 1.0])
    assert terms["red"].tolist() == [0.0, -1.0]
