"""Ends of lanes past the begin of the next lane, by hand and in a network of netconvert."""

import re
from pathlib import Path

import libsumo
import pytest
from builders import make_lane, make_scenario

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.sumo.network.lane_ends import cut_back
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

STREET = make_lane("street_0", (0.0, 0.0), (50.0, 0.0))
CORNER = make_lane("corner_0", (48.0, -1.0), (48.0, -50.0))
AHEAD = make_lane("ahead_0", (54.0, 0.0), (90.0, 0.0))
BACK = make_lane("back_0", (48.0, 3.2), (0.0, 3.2))
VIA = make_lane(":n_0_0", (50.0, 0.0), (48.0, -1.0))


@pytest.mark.parametrize(("lanes", "end"), [([CORNER], 48.0), ([CORNER, AHEAD], None), ([BACK], None), ([AHEAD], None)])
def test_a_lane_ends_where_all_lanes_after_it_begin(lanes: list[Lane], end: float | None) -> None:
    links = {STREET.id: [(lane.id, VIA.id) for lane in lanes]}
    found = {
        lane.id: lane
        for lane in cut_back({lane.id: lane for lane in (STREET, VIA, *lanes)}, lambda name: links.get(name, []))
    }
    if end is None:
        assert not found
        return
    assert found[STREET.id].points == ((0.0, 0.0), (end, 0.0))
    assert found[VIA.id].points == ((end, 0.0), CORNER.points[0])
    assert found[STREET.id].length == STREET.length


def test_paths_lead_nowhere_back(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="100" y="-90"/>'
    config = make_scenario(tmp_path, nodes, '<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c"/>', "")
    net = (tmp_path / "n.net.xml").read_text()
    end = re.findall(r'id="ab_0".*? shape=".* (.*?),(.*?)"', net)[0]
    begin = float(re.findall(r'id="bc_0".*? shape="(.*?),', net)[0])
    # The lane ends before the next one begins: now it leads 1.6 m past the next one.
    (tmp_path / "n.net.xml").write_text(net.replace(",".join(end), f"{begin + 1.6:.2f},{end[1]}"))
    with SumoSession(find_scenario(str(config))) as session:
        path = LaneGraph(libsumo, session.network).path("ab_0", ("bc",), "passenger", [])
        assert (path.lanes[0], path.lanes[-1]) == ("ab_0", "bc_0")
        assert max(path.line.x) == pytest.approx(begin, abs=0.05)
        assert path.ends[0] == pytest.approx(begin, abs=0.05)
