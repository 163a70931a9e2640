"""Lanes bent to the lane that a route needs, by hand and on a street that is too short for lane changes."""

from pathlib import Path

import libsumo
import pytest

import slrl_sumo
from slrl_sumo.routing.junctions.bent_lane import bent_lane
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import junction_of
from slrl_sumo.routing.polyline import line_through
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_lane, make_scenario


def test_a_bent_lane_leads_to_the_target_in_the_same_directions() -> None:
    inside = make_lane(":j_4_0", (0.0, 0.0), (12.0, 0.0))
    bent = bent_lane(inside, make_lane("e_2", (12.0, 6.4), (30.0, 6.4)))
    assert bent is not None
    assert junction_of(bent.id) == junction_of(inside.id)
    assert bent.points[0] == pytest.approx((0.0, 0.0))
    assert bent.points[-1] == pytest.approx((12.0, 6.4))
    line, _ = line_through(bent.points)
    assert abs(line.at(0.1)[2]) < 0.2
    assert abs(line.at(line.end - 0.1)[2]) < 0.2
    assert bent.length == pytest.approx(line.end)


def test_a_lane_that_is_too_short_is_not_bent() -> None:
    assert bent_lane(make_lane(":j_4_0", (0.0, 0.0), (3.0, 0.0)), make_lane("e_1", (3.0, 3.2), (30.0, 3.2))) is None


NODES = (
    '<node id="s" x="0" y="-100"/><node id="a" x="0" y="0"/><node id="b" x="{end}" y="0"/><node id="e" x="150" y="0"/>'
    '<node id="n" x="{end}" y="100"/><node id="w" x="-100" y="0"/>'
)
EDGES = (
    '<edge id="sa" from="s" to="a"/><edge id="wa" from="w" to="a" numLanes="3"/>'
    '<edge id="ab" from="a" to="b" numLanes="3"/><edge id="be" from="b" to="e" numLanes="2"/>'
    '<edge id="bn" from="b" to="n"/>'
)
CONNECTIONS = (
    "<connections>"
    '<connection from="sa" to="ab" fromLane="0" toLane="0"/>'
    + "".join(f'<connection from="wa" to="ab" fromLane="{k}" toLane="{k}"/>' for k in range(3))
    + '<connection from="ab" to="be" fromLane="0" toLane="0"/><connection from="ab" to="be" fromLane="1" toLane="1"/>'
    '<connection from="ab" to="bn" fromLane="2" toLane="0"/></connections>'
)


def short_street(folder: Path, end: float) -> Path:
    """From the south, a street of three lanes up to x = `end` (m), which only its left lane leaves to the north."""
    (folder / "n.con.xml").write_text(CONNECTIONS)
    users = '<flow id="w" begin="0" end="20" period="7" from="wa" to="be" departLane="0"/>'
    users += "".join(f'<trip id="{k}" depart="{4 * k}" from="sa" to="bn"/>' for k in range(5))
    options = ("--connection-files", str(folder / "n.con.xml"))
    return make_scenario(folder, NODES.format(end=end), EDGES, users, *options)


def test_a_route_enters_a_short_street_on_the_lane_that_it_needs(tmp_path: Path) -> None:
    with SumoSession(find_scenario(str(short_street(tmp_path, 16.0))), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        assert graph.lanes["ab_0"].length < 20.0
        path = graph.path("sa_0", ("ab", "bn"), "passenger", [])
        inside = path.lanes[1]
        assert path.lanes[2:3] == ("ab_2",)
        assert path.lanes[-1] == "bn_0"
        assert graph.in_network(inside) == path.entries[0].via
        assert path.entries[0].target == "ab_0"
        assert graph.limit(inside) == graph.limit(path.entries[0].via)
        assert graph.origin(inside) == "sa_0"
        # The route that needs the right lane keeps the lane of the network.
        assert graph.path("sa_0", ("ab", "be"), "passenger", []).lanes[1] == path.entries[0].via


def test_a_street_with_room_for_lane_changes_keeps_its_lanes(tmp_path: Path) -> None:
    with SumoSession(find_scenario(str(short_street(tmp_path, 90.0))), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        path = graph.path("sa_0", ("ab", "bn"), "passenger", [])
        assert path.lanes == ("sa_0", path.entries[0].via, "ab_0")


def test_cars_pass_a_street_that_is_too_short_for_lane_changes(tmp_path: Path) -> None:
    result = slrl_sumo.run(short_street(tmp_path, 16.0), takeover="car=1", until=90.0, seed=1)
    summary = result.summary
    assert summary.arrived == summary.taken_over == 8
    assert summary.under_way == 0
    assert summary.collisions == 0
