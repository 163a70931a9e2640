"""Which lane a route needs, in a grid with short lanes for turns."""

from pathlib import Path

import libsumo
import pytest
from builders import make_scenario

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.routing.lane_graph import HALF_CAR, WAITS_APART, LaneGraph
from slrl_sumo.routing.lane_path import STOP_LINE, junction_of
from slrl_sumo.routing.polyline import line_through
from slrl_sumo.routing.route_lane_changes import CHANGE
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
        times = [graph.lanes[lane].length / graph.lanes[lane].max_speed for lane in (short, "A0A1_0")]
        assert times[0] < CHANGE < times[1]
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
                    way = line_through(graph.lanes[other].shape.tolist())[0]
                    cars = graph.lanes[other].admits("passenger")
                    assert way.place(x, y, 0.0, 1e3)[2] > (HALF_CAR if cars else 0.0) + HALF_CAR + WAITS_APART - 0.2
        assert earlier


def test_the_stop_line_of_a_lane_that_is_drawn_into_a_junction_is_before_the_ways_of_others(tmp_path: Path) -> None:
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="priority"/>'
        for name, x, y in (("west", -100, 0), ("east", 100, 0), ("south", 0, -100), ("north", 0, 100), ("middle", 0, 0))
    )
    edges = "".join(
        f'<edge id="{begin}_{end}" from="{begin}" to="{end}" numLanes="1" speed="13.9"/>'
        for begin, end in (("west", "middle"), ("middle", "east"), ("south", "middle"), ("middle", "north"))
    )
    # From the south around the end of the western lane, as the ways of cyclists are in some networks.
    around = "1.6,-8 -14,-5 -14,2 1.6,8"
    (tmp_path / "bent.con.xml").write_text(
        f'<connections><connection from="south_middle" to="middle_north" fromLane="0" toLane="0" shape="{around}"/>'
        '<connection from="west_middle" to="middle_east" fromLane="0" toLane="0"/></connections>'
    )
    scenario = make_scenario(
        tmp_path, nodes, edges, "", "--connection-files", "bent.con.xml", "--offset.disable-normalization"
    )
    with SumoSession(find_scenario(str(scenario))) as session:
        graph = LaneGraph(libsumo, session.network)
        path = graph.path("west_middle_0", ("middle_east",), "passenger", [])
        x, _, _ = path.line.at(path.entries[0].stop_line)
        assert x - STOP_LINE == pytest.approx(-14.0 - 2.0 * HALF_CAR - WAITS_APART, abs=0.6)
        assert path.ends[0] - path.entries[0].stop_line > 3.0
        other = graph.path("south_middle_0", ("middle_north",), "passenger", [])
        assert other.entries[0].stop_line == pytest.approx(other.ends[0])


def test_walking_areas_are_no_ways_through_junctions() -> None:
    with SumoSession(find_scenario("district"), seed=1) as session:
        inside = [lane for lanes in LaneGraph(libsumo, session.network).inside.values() for lane in lanes]
    assert any("_c" in lane for lane in inside)
    assert not any("_w" in lane for lane in inside)


def test_without_a_destination_a_lane_that_ends_is_left_for_the_lane_beside(tmp_path: Path) -> None:
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", 200), ("c", 400)))
    edges = '<edge id="ab" from="a" to="b" numLanes="2"/><edge id="bc" from="b" to="c"/>'
    make_scenario(tmp_path, nodes, edges, "")
    with SumoSession(find_scenario(str(tmp_path))) as session:
        graph = LaneGraph(libsumo, session.network)
        onward = {lane: bool(graph.links(lane)) for lane in ("ab_0", "ab_1")}
        assert sorted(onward.values()) == [False, True]
        for lane, continues in onward.items():
            other = "ab_1" if lane == "ab_0" else "ab_0"
            path = graph.path(lane, (), "passenger", [], seed="learned_car.0")
            assert path.next_lane == (None if continues else other)
