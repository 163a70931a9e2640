"""Lines along narrow streets, by hand and in a network of netconvert."""

from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest

from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.narrow_lanes import APART, TAPER, moved_apart
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_lane, make_scenario

WIDTH = 1.5
OUT = replace(make_lane("out_0", (0.0, -0.75), (50.0, -0.75), (100.0, -0.75)), width=WIDTH)
BACK = replace(make_lane("back_0", (100.0, 0.75), (50.0, 0.75), (0.0, 0.75)), width=WIDTH)


def lines(*lanes: Lane) -> dict[str, Floats]:
    return {lane.id: lane.shape for lane in moved_apart(lanes, lambda lane: ())}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_narrow_opposite_lanes_are_moved_apart_between_their_ends(side: float) -> None:
    # With -1 in a network where traffic keeps to the left.
    found = lines(*(replace(lane, shape=lane.shape * np.array([1.0, side])) for lane in (OUT, BACK)))
    for name, sign in (("out_0", -side), ("back_0", side)):
        x, y = found[name].T
        inside = (x >= TAPER) & (x <= 100.0 - TAPER)
        assert y[inside] == pytest.approx(sign * 0.5 * APART)
        assert y[[0, -1]] == pytest.approx(sign * 0.75)


def test_a_lane_is_moved_to_its_border_at_most() -> None:
    slim = [replace(lane, shape=lane.shape * np.array([1.0, 0.5]), width=0.75) for lane in (OUT, BACK)]
    assert lines(*slim)["out_0"][:, 1].min() == pytest.approx(-0.375 - 0.375)


def test_other_lanes_stay() -> None:
    wide = [replace(lane, shape=lane.shape * np.array([1.0, 1.8]), width=2.7) for lane in (OUT, BACK)]
    inside = replace(BACK, internal=True)
    across = replace(BACK, shape=np.array([(50.0, 20.0), (50.0, -20.0)]))
    far = replace(BACK, id="detour_0", edge="detour", shape=BACK.shape + np.array([0.0, 20.0]))
    for lanes in ([OUT], wide, [OUT, inside], [OUT, across], [OUT, far]):
        assert lines(*lanes) == {}
    # The street of the lane, not the other one between the same junctions.
    assert lines(OUT, far, BACK).keys() == {"out_0", "back_0"}


def test_the_inner_lanes_of_a_street_are_moved_apart_although_their_edges_join_other_junctions() -> None:
    # As in The Hague, where each direction is a street of its own.
    outer = replace(OUT, id="out_0", shape=OUT.shape - np.array([0.0, 3.0]), width=3.0)
    inner = replace(OUT, id="out_1", width=3.0)
    part = replace(BACK, shape=np.array([(70.0, 1.05), (30.0, 1.05)]))
    found = lines(outer, inner, part)
    assert found.keys() == {"out_1", "back_0"}
    x, y = found["out_1"].T
    beside = (x > 31.0) & (x < 69.0)
    assert y[beside] == pytest.approx(-0.75 - 0.4)
    assert y[(x < 20.0) | (x > 80.0)] == pytest.approx(-0.75)


def test_the_line_leads_onwards_at_sharp_corners() -> None:
    corner = np.array([(0.0, 0.0), (40.0, 0.0), (40.3, 0.1), (40.4, 0.4), (40.4, 40.0)])
    out = replace(OUT, shape=corner)
    back = replace(BACK, shape=corner[::-1] + np.array([-WIDTH, WIDTH]))
    for shape in lines(out, back).values():
        steps = np.diff(shape, axis=0)
        turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        assert abs(turns.sum()) == pytest.approx(0.5 * np.pi, abs=0.3)
        assert np.abs(turns).sum() < 0.5 * np.pi + 0.5


def test_paths_of_vehicles_keep_apart_on_a_narrow_street(tmp_path: Path) -> None:
    # Two streets, and a side street at the junction between them.
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}"/>'
        for name, x, y in (("a", 0, 0), ("b", 100, 0), ("c", 200, 0), ("d", 100, 80))
    )
    edges = "".join(
        f'<edge id="{way}" from="{way[0]}" to="{way[1]}" width="1.5"/>' for way in ("ab", "ba", "bc", "cb", "bd")
    )
    make_scenario(tmp_path, nodes, edges, "")
    with SumoSession(find_scenario(str(tmp_path))) as session:
        graph = LaneGraph(libsumo, session.network)
        ways = {
            way: graph.path(f"{way[0]}_0", way[1:], "passenger", []).line
            for way in (("ab", "bc"), ("cb", "ba"), ("ab", "bd"))
        }
    out, back, turn = (np.column_stack([line.x, line.y]) for line in ways.values())
    heights = [np.interp(np.arange(20.0, 180.0), *line[np.argsort(line[:, 0])].T) for line in (out, back)]
    assert heights[1] - heights[0] == pytest.approx(APART, abs=0.02)
    # A way that turns begins where the street ends.
    assert np.interp(96.0, *turn.T) == pytest.approx(-0.5 * APART, abs=0.05)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(turn, axis=0).T[::-1])))
    assert -0.1 < turns.min() < turns.max() < 0.5
