"""Which lane a route needs, in a grid with short lanes for turns."""

from pathlib import Path

import libsumo

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.routing.lane_graph import CHANGE, LaneGraph
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_lanes_are_changed_before_a_short_edge_and_as_late_as_possible_otherwise(tmp_path: Path) -> None:
    drawing = ["--grid", "--grid.number", "2", "--grid.length", "180", "--grid.attach-length", "150", "-L", "3"]
    turns = ["--turn-lanes", "1", "--turn-lanes.length", "40", "--no-turnarounds", "-o", "n.net.xml"]
    run_program("netgenerate", [*drawing, *turns], tmp_path)
    (tmp_path / "n.sumocfg").write_text('<configuration><net-file value="n.net.xml"/></configuration>')
    with SumoSession(find_scenario(str(tmp_path))) as session:
        graph = LaneGraph(libsumo, session.network)
        short = next(lane for lane in graph.lanes if lane.startswith("A0A1.") and lane.endswith("_0"))
        edge = graph.lanes[short].edge
        assert graph.lanes[short].length < CHANGE < graph.lanes["A0A1_0"].length
        # To the right from the right lane of the short edge alone, straight on from each of its lanes.
        right = ("A0A1", edge, "A1B1")
        assert graph.lane_to_change_to("A0A1_2", "passenger", right) == "A0A1_1"
        assert graph.lane_to_change_to("A0A1_1", "passenger", right) == "A0A1_0"
        assert graph.lane_to_change_to("A0A1_0", "passenger", right) is None
        # Paths know it, except where the edge has one lane.
        path = graph.path("A0A1_2", right[1:], "passenger", [])
        assert (path.next_lane, path.route) == ("A0A1_1", right)
        straight = ("A0A1", edge, "A1top0")
        assert graph.lane_to_change_to("A0A1_2", "passenger", straight) is None
        # On the edge of 120 m that follows there is room for both changes.
        later = (edge, "A1B1")
        assert graph.lane_to_change_to(f"{edge}_2", "passenger", later) == f"{edge}_1"
