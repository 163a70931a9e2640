"""Vehicles that turn around are as slow as their turn, and others come."""

from pathlib import Path

import libsumo
import pytest

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.junctions.occupants import Size
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_crossroads, make_track, make_world

SIZE = Size(5.0, 1.8)


def track(graph: LaneGraph, start: str, before: float, speed: float) -> VehicleTrack:
    """A car on its way to the edge "cw", so many m before the junction."""
    path = graph.path(f"{start}_0", ("cw",), "passenger", [])
    return make_track(path, path.entries[0].stop_line - before, speed, ("cw",))


@pytest.mark.parametrize(("before", "may"), [(39.0, False), (95.0, True)])
def test_a_car_that_turns_around_is_as_slow_as_its_turn(tmp_path: Path, before: float, may: bool) -> None:
    # It comes at 6.9 m/s, and may turn at 3.65 m/s: it is gone after 5 s. The other one comes at 13.2 m/s.
    config = make_crossroads(tmp_path, "", "--default.speed", "13.9", centre='type="priority"')
    with SumoSession(find_scenario(str(config))) as session:
        graph = LaneGraph(libsumo, session.network)
        turns, comes = track(graph, "wc", 9.4, 6.9), track(graph, "ec", before, 13.2)
        reservations = JunctionReservations(libsumo, graph, {"comes": comes}.get, RightOfWay(libsumo, graph))
        reservations.renew(make_world(time=1.0))
        first, line = comes.path.entries[0], turns.path.entries[0]
        assert reservations.request_entry("comes", comes, first, priority=True, size=SIZE, too_late=True)
        assert reservations.request_entry("turns", turns, line, priority=False, size=SIZE) == may
        assert ConflictAreas(graph).way((line.via,)).pace == graph.lanes[line.via].max_speed < 4.0
