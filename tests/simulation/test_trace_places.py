"""Edges and positions of learned persons in a trace."""

import numpy as np
from builders import make_world

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.trace_places import TracePlaces
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane


def lane(name: str, points: list[tuple[float, float]]) -> Lane:
    allowed, shape = frozenset({"pedestrian"}), np.array(points, np.float64)
    return Lane(name, name.rpartition("_")[0], shape, 2.0, 10.0, 2.0, allowed, name.startswith(":"), Surface.SIDEWALK)


NETWORK = Network((lane("street_0", [(0, 0), (10, 0)]), lane(":j_w0_0", [(10, -3), (20, -3), (20, 3), (10, 3)])), ())
CAR, PEDESTRIAN = RoadUserType.CAR, RoadUserType.PEDESTRIAN


def users(*x: float) -> WorldState:
    """A car and pedestrians, whose fronts are at `x`."""
    kinds = np.array([CAR] + [PEDESTRIAN] * (len(x) - 1), np.int8)
    world = make_world(np.array(x), 0.0, 0.0, 1.0, type=kinds, learned=True, ids=[f"u{k}" for k in range(len(x))])
    front = np.where(kinds == PEDESTRIAN, 0.5 * world.length, 0.0)
    return make_world(np.array(x) - front, 0.0, 0.0, 1.0, type=kinds, learned=True, ids=world.ids, length=world.length)


def places(n: int) -> Places:
    person = np.arange(n) > 0
    return Places(("t",) * n, ("sumos",) * n, np.full(n, 7.0), person)


def test_learned_persons_are_where_they_stand_and_all_others_where_sumo_has_them() -> None:
    found = TracePlaces(NETWORK).of_learned(places(5), users(4.0, 4.0, 15.0, 25.0))
    # The fifth one is SUMO's own.
    assert found.lane == ("sumos", "street", ":j_w0", "", "sumos")
    np.testing.assert_allclose(found.lane_position, [7.0, 4.0, 0.0, 0.0, 7.0], atol=1e-9)


def test_on_a_walking_area_positions_are_the_way_walked_on_it() -> None:
    trace = TracePlaces(NETWORK)
    along = [trace.of_learned(places(2), users(0.0, x)).lane_position[1] for x in (9.0, 12.0, 15.0, 13.0, 9.0, 12.0)]
    np.testing.assert_allclose(along, [9.0, 0.0, 3.0, 5.0, 9.0, 0.0], atol=1e-9)


def test_a_network_without_lanes_for_persons_has_them_nowhere() -> None:
    found = TracePlaces(Network((), ())).of_learned(places(2), users(0.0, 5.0))
    assert found.lane == ("sumos", "")
