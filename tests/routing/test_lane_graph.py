"""Which lane a route needs, in a grid with short lanes for turns."""

from pathlib import Path

import libsumo

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.routing.lane_graph import CHANGE, STOP_LINE, WAITS_APART, LaneGraph, junction_of
from slrl_sumo.routing.polyline import line_through
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


def test_a_car_waits_inside_a_junction_where_it_is_clear_of_others() -> None:
    with SumoSession(find_scenario("district"), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        earlier = 0
        for lane in [lane.id for lane in graph.lanes.values() if not lane.internal and lane.admits("passenger")]:
            for target, via in graph.links(lane):
                path = graph.path(lane, (graph.lanes[target].edge,), "passenger", []) if via else None
                if path is None or len(path.entries) < 2 or path.entries[1].lane != via:
                    continue
                stop = path.entries[1].stop_line - STOP_LINE
                assert path.ends[0] <= stop <= path.ends[1] - STOP_LINE + 0.01
                assert path.entries[0].waits == path.entries[1].stop_line
                if stop > path.ends[1] - STOP_LINE - 0.1:
                    continue
                earlier += 1
                x, y, _ = path.line.at(stop)
                for other in graph.inside[junction_of(via)]:
                    origin = graph.origin(other)
                    if origin == other or graph.lanes[origin].edge == graph.lanes[lane].edge:
                        continue  # a pedestrian crossing, or a way from the same street
                    assert (
                        line_through(graph.lanes[other].shape.tolist())[0].place(x, y, 0.0, 1e3)[2] > WAITS_APART - 0.2
                    )
        assert earlier


def test_walking_areas_are_no_ways_through_junctions() -> None:
    with SumoSession(find_scenario("district"), seed=1) as session:
        inside = [lane for lanes in LaneGraph(libsumo, session.network).inside.values() for lane in lanes]
    assert any("_c" in lane for lane in inside)
    assert not any("_w" in lane for lane in inside)
