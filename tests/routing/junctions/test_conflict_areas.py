"""Which ways through junctions others cross."""

import math
from pathlib import Path

import libsumo
import pytest
from builders import make_scenario

from slrl_sumo.routing.junctions.conflict_areas import CROSSED, ConflictAreas
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

NODES = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="200" y="0"/>'


def edge(begin: str, end: str, lanes: int = 1) -> str:
    return f'<edge id="{begin}{end}" from="{begin}" to="{end}" speed="13.9" numLanes="{lanes}"/>'


@pytest.mark.parametrize(
    ("nodes", "edges", "until"),
    [
        # A street that gets a second lane, as before a signal.
        ("", edge("a", "b") + edge("b", "c", 2), -math.inf),
        # A ramp that joins it.
        ('<node id="d" x="0" y="-60"/>', edge("a", "b") + edge("b", "c") + edge("d", "b"), -math.inf),
        # A street that crosses it.
        (
            '<node id="d" x="100" y="-90"/><node id="e" x="100" y="90"/>',
            edge("a", "b") + edge("b", "c") + edge("d", "b") + edge("b", "e"),
            # The middle of its lane is 1.6 m right of x = 100.
            101.6 + CROSSED,
        ),
    ],
)
def test_ways_that_others_cross_are_told_from_those_that_they_join(
    tmp_path: Path, nodes: str, edges: str, until: float
) -> None:
    config = make_scenario(tmp_path, NODES + nodes, edges, "")
    with SumoSession(find_scenario(str(config))) as session:
        graph = LaneGraph(libsumo, session.network)
        areas = ConflictAreas(graph)
        ways = [via for target, via in graph.links("ab_0") if target.startswith("bc")]
        assert ways
        for via in ways:
            begin, end = graph.lanes[via].points[0][0], graph.lanes[via].points[-1][0]
            crossed = max(until - begin, 0.0)
            assert areas.crossed_until(via) == (pytest.approx(crossed, abs=0.5) if crossed else 0.0)
            assert crossed < end - begin - 1.0
