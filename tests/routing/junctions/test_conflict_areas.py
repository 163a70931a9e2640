"""Which ways through junctions others cross."""

from pathlib import Path

import libsumo
import pytest
from builders import make_scenario

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

NODES = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="200" y="0"/>'


def edge(begin: str, end: str, lanes: int = 1) -> str:
    return f'<edge id="{begin}{end}" from="{begin}" to="{end}" speed="13.9" numLanes="{lanes}"/>'


@pytest.mark.parametrize(
    ("nodes", "edges", "crossed"),
    [
        # A street that gets a second lane, as before a signal.
        ("", edge("a", "b") + edge("b", "c", 2), False),
        # A ramp that joins it.
        ('<node id="d" x="0" y="-60"/>', edge("a", "b") + edge("b", "c") + edge("d", "b"), False),
        # A street that crosses it.
        (
            '<node id="d" x="100" y="-90"/><node id="e" x="100" y="90"/>',
            edge("a", "b") + edge("b", "c") + edge("d", "b") + edge("b", "e"),
            True,
        ),
    ],
)
def test_ways_that_others_cross_are_told_from_those_that_they_join(
    tmp_path: Path, nodes: str, edges: str, crossed: bool
) -> None:
    config = make_scenario(tmp_path, NODES + nodes, edges, "")
    with SumoSession(find_scenario(str(config))) as session:
        graph = LaneGraph(libsumo, session.network)
        areas = ConflictAreas(graph)
        ways = [via for target, via in graph.links("ab_0") if target.startswith("bc")]
        assert ways
        assert {areas.is_crossed(via) for via in ways} == {crossed}
