"""Vehicles that SUMO drives, as occupants of a junction: where they wait inside, others pass, as SUMO's do."""

import math
from collections.abc import Iterator
from pathlib import Path

import libsumo
import pytest

from slrl_sumo.routing.junctions.conflict_areas import Way
from slrl_sumo.routing.junctions.meeting import stand_off
from slrl_sumo.routing.junctions.occupants import UNUSED, USUAL, Occupant
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.studies.flow.scenarios.junctions import left_turns
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_world
from tests.routing.junctions.test_reservations import track


@pytest.fixture(scope="module")
def waiting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[LaneGraph, str, str]]:
    """The lanes, a vehicle of SUMO's that waits inside a junction for opposing traffic, and its lane."""
    folder: Path = tmp_path_factory.mktemp("left-turns")
    with SumoSession(find_scenario(str(left_turns(folder))), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        while session.time < 120.0:
            session.step()
            for vehicle in libsumo.vehicle.getIDList():
                lane = libsumo.vehicle.getLaneID(vehicle)
                inside = lane.startswith(":") and any(via for _, via in graph.links(lane))
                if inside and libsumo.vehicle.getWaitingTime(vehicle) > 1.0:
                    yield graph, vehicle, lane
                    return
    pytest.fail("no vehicle waited inside the junction")


def test_a_vehicle_that_waits_inside_needs_no_room_for_its_turn(waiting: tuple[LaneGraph, str, str]) -> None:
    graph, vehicle, lane = waiting
    reservations = JunctionReservations(libsumo, graph, lambda _: None, RightOfWay(libsumo, graph))
    reservations.renew(make_world())
    occupant = dict(reservations._occupants(lane.rsplit("_", 2)[0], ""))[vehicle]
    assert occupant.needs_turning_room is False
    start = graph.lanes[graph.origin(lane)].edge
    opposite = {"in_n": "in_s", "in_s": "in_n", "in_e": "in_w", "in_w": "in_e"}[start]
    oncoming = track(graph, opposite, start.replace("in", "out"), 10.0, 6.0)
    line = oncoming.path.entries[0]
    assert reservations.request_entry("car", oncoming, line, priority=True, size=USUAL)


def test_one_inside_does_not_wait_for_one_of_sumos_that_stands_as_long(waiting: tuple[LaneGraph, str, str]) -> None:
    graph, vehicle, lane = waiting
    assert libsumo.vehicle.getWaitingTime(vehicle) < UNUSED
    reservations = JunctionReservations(libsumo, graph, lambda _: None, RightOfWay(libsumo, graph))
    reservations.renew(make_world())
    theirs = dict(reservations._occupants(lane.rsplit("_", 2)[0], ""))[vehicle]
    mine = theirs._replace(idle=True, entry_time=5.0)
    assert not stand_off(mine, theirs)
    assert stand_off(mine, theirs._replace(idle=True))
    # Outside it waits, and inside as long as it has just stopped, or for persons.
    assert not stand_off(mine._replace(entry_time=math.inf), theirs._replace(idle=True))
    assert not stand_off(mine._replace(idle=False), theirs._replace(idle=True))
    assert not stand_off(mine, theirs._replace(idle=True, is_pedestrian=True))


def test_vehicles_in_a_turn_swing_out_unless_they_wait() -> None:
    turning = Occupant(Way((), "", turns=True), (), 5.0, USUAL, 0.0, 0.0, yields=False, idle=False)
    assert turning.half_width(turns=True) == pytest.approx(USUAL.turning)
    straight = turning.half_width(turns=False)
    assert (
        straight
        == turning._replace(needs_turning_room=False).half_width(turns=True)
        == pytest.approx(0.5 * (USUAL.width + 0.1))
    )
