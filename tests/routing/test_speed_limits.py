"""Where the path of a vehicle makes it stop, in the shipped scenario `intersection`."""

import math
from collections.abc import Iterator
from dataclasses import replace

import libsumo
import pytest

from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.speed_limits import LANE_END, SpeedLimits
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.routing.junctions.test_reservations import track


@pytest.fixture(scope="module")
def session() -> Iterator[SumoSession]:
    with SumoSession(find_scenario("intersection"), seed=1) as session:
        yield session


def test_a_vehicle_inside_a_junction_stops_at_the_end_of_a_lane_that_does_not_lead_on(session: SumoSession) -> None:
    graph = LaneGraph(libsumo, session.network)
    limits = SpeedLimits(graph, RightOfWay(libsumo, graph))
    inside = track(graph, "in0", "out2", -2.0, 8.0)
    wrong = replace(inside, edges=("out2", "beyond"))
    for one, stop in ((inside, math.inf), (wrong, inside.path.end - inside.s - LANE_END)):
        assert limits.lane_continues(one)
        assert limits.stop_at_lane_end(one) == pytest.approx(stop)
