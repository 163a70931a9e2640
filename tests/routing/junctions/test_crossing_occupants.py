"""Pedestrians on crossings keep vehicles out of the junction, in `crosswalk` (bench) and `intersection`."""

import math
from collections.abc import Iterator
from pathlib import Path

import libsumo
import numpy as np
import pytest

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.junctions.crossing_occupants import CrossingOccupants
from slrl_sumo.routing.junctions.occupants import UNUSED, Size
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.studies.flow.scenarios.junctions import crosswalk
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_world
from tests.routing.junctions.test_reservations import track

SIZE = Size(5.0, 1.8)


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[LaneGraph]:
    """A street along y = 0 between x = 0 and 400 m, with a crossing at 200 m, where pedestrians have priority."""
    with SumoSession(find_scenario(str(crosswalk(tmp_path))), seed=1) as session:
        yield LaneGraph(libsumo, session.network)


def walker(y: float, heading: float, speed: float = 1.4, x: float = 200.0, time: float = 1.0) -> WorldState:
    return make_world(
        [x], [y], heading=heading, speed=speed, type=RoadUserType.PEDESTRIAN, length=0.25, width=0.5, time=time
    )


def occupants(graph: LaneGraph, *worlds: WorldState) -> dict[str, object]:
    found = CrossingOccupants(libsumo, graph, ConflictAreas(graph))
    for one in worlds:
        found.renew(one)
    return dict(found.of(":m"))


def may_enter(graph: LaneGraph, world: WorldState, before: float, speed: float) -> bool:
    """Whether a car to the east, on the southern lane, may pass the line before the crossing."""
    reservations = JunctionReservations(libsumo, graph, lambda _: None, RightOfWay(libsumo, graph))
    reservations.renew(world)
    car = track(graph, "wm", "me", before, speed)
    return reservations.request_entry("car", car, car.path.entries[0], priority=False, size=SIZE)


NORTH, SOUTH = 0.5 * math.pi, -0.5 * math.pi


def test_those_on_a_crossing_or_about_to_step_on_it_are_occupants(graph: LaneGraph) -> None:
    assert occupants(graph, walker(0.0, NORTH))
    assert occupants(graph, walker(0.0, SOUTH, 0.0))
    assert occupants(graph, walker(-3.9, NORTH))
    # Past the kerb, along the pavement, waiting at the kerb, or on the carriageway elsewhere.
    assert not occupants(graph, walker(-3.9, SOUTH))
    assert not occupants(graph, walker(-3.9, 0.0))
    assert not occupants(graph, walker(-3.9, NORTH, 0.0))
    assert not occupants(graph, walker(0.0, NORTH, x=150.0))


def test_a_car_waits_for_a_pedestrian_that_it_would_meet(graph: LaneGraph) -> None:
    # The car's lane is the one at y = -1.6 m.
    assert not may_enter(graph, walker(-2.0, NORTH), before=4.0, speed=5.0)
    assert not may_enter(graph, walker(1.0, SOUTH), before=10.0, speed=5.0)
    assert not may_enter(graph, walker(-1.6, NORTH, 0.0), before=2.0, speed=0.0)
    # Gone by then, or already beyond the lane.
    assert may_enter(graph, walker(0.0, NORTH), before=10.0, speed=5.0)
    assert may_enter(graph, walker(-1.0, NORTH), before=40.0, speed=8.0)


def test_a_pedestrian_that_has_stood_beside_the_lane_for_long_lets_cars_pass(graph: LaneGraph) -> None:
    reservations = JunctionReservations(libsumo, graph, lambda _: None, RightOfWay(libsumo, graph))
    car = track(graph, "wm", "me", 2.0, 0.5)
    answers = []
    for time in (1.0, 1.0 + UNUSED + 0.4):
        reservations.renew(walker(0.6, SOUTH, 0.2, time=time))
        line = car.path.entries[0]
        answers.append(reservations.request_entry("car", car, line, priority=False, size=SIZE))
    assert answers == [False, True]


def test_one_that_waits_for_its_signal_at_an_end_of_a_crossing_is_no_occupant() -> None:
    with SumoSession(find_scenario("signalised"), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        shape = next(lane.shape for lane in session.network.lanes if lane.id == ":centre_c0_0")
        (x, y), along = shape[0], (shape[-1] - shape[0]) / np.hypot(*(shape[-1] - shape[0]))
        length = float(np.hypot(*(shape[-1] - shape[0])))
        heading = math.atan2(along[1], along[0])

        def occupied(metres: float, state: str, speed: float = 0.0) -> bool:
            light = libsumo.trafficlight.getIDList()[0]
            links = len(libsumo.trafficlight.getRedYellowGreenState(light))
            libsumo.trafficlight.setRedYellowGreenState(light, state * links)
            place = np.array([x, y]) + metres * along
            found = CrossingOccupants(libsumo, graph, ConflictAreas(graph))
            found.renew(walker(place[1], heading, speed, x=place[0]))
            return bool(found.of(":centre"))

        for end in (0.4, length - 0.4):
            assert [occupied(end, state) for state in "rG"] == [False, True]
            assert occupied(end, "r", speed=1.0)
        assert [occupied(0.5 * length, state) for state in "rG"] == [True, True]
