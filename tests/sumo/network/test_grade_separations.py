"""Streets that cross without a junction, in networks of netconvert."""

import subprocess
from pathlib import Path

import numpy as np
import sumo

from slrl_sumo.scene.levels import apart
from slrl_sumo.sumo.net_file import read_net_file
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.grade_separations import CROSSING_REACH, FROM_ENDS, LEVEL_SPACING

CROSS = {"w": (-100.0, 0.0), "e": (100.0, 0.0), "s": (0.0, -100.0), "n": (0.0, 100.0)}
EAST, NORTH = (1.0, 0.0), (0.0, 1.0)


def network(folder: Path, nodes: dict[str, tuple[float, float]], *edges: str, lanes: int = 1) -> Network:
    """Edges named by their two nodes; netconvert moves the origin to the south-west."""
    files = {
        "nod": "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in nodes.items()),
        "edg": "".join(
            f'<edge id="{one}" from="{one[0]}" to="{one[1]}" numLanes="{lanes}" speed="20"/>' for one in edges
        ),
    }
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "--offset.disable-normalization"]
    for (kind, content), root, option in zip(files.items(), ("nodes", "edges"), ("-n", "-e"), strict=True):
        (folder / f"{kind}.xml").write_text(f"<{root}>{content}</{root}>")
        command += [option, str(folder / f"{kind}.xml")]
    net = folder / "one.net.xml"
    subprocess.run([*command, "-o", str(net)], check=True, capture_output=True)
    return read_net_file(net)


def test_streets_that_cross_without_a_junction_are_on_two_levels(tmp_path: Path) -> None:
    both = network(tmp_path, CROSS, "we", "sn", lanes=2)
    assert {one.edges for one in both.grade_separations} == {("sn", "we")}
    # Two lanes of each: four crossings, which lie to the right of the lines between the nodes.
    assert len(both.grade_separations) == 4
    assert all(0.0 < one.x < 6.4 and -6.4 < one.y < 0.0 for one in both.grade_separations)
    assert apart(both.levels, 3.2, -3.2, *EAST, 3.2, -3.2, *NORTH)
    assert not apart(both.levels, 3.2, -3.2, *EAST, 13.2, -3.2, *EAST)
    reach = np.hypot(both.levels.x - 3.2, both.levels.y + 3.2)
    assert CROSSING_REACH - 2.0 * LEVEL_SPACING < reach.max() < CROSSING_REACH + 4.0
    assert both.surfaces().levels is both.levels


def test_no_levels_where_streets_meet_lie_side_by_side_or_touch_at_their_ends(tmp_path: Path) -> None:
    for nodes, edges in (
        (CROSS | {"m": (0.0, 0.0)}, ("wm", "me", "sm", "mn")),
        (CROSS | {"a": (-100.0, 4.0), "b": (100.0, -4.0)}, ("we", "ab")),
        (CROSS | {"a": (0.0, FROM_ENDS - 2.5)}, ("we", "na")),
    ):
        flat = network(tmp_path, nodes, *edges)
        assert flat.grade_separations == ()
        assert len(flat.levels.x) == 0


def test_a_street_under_a_junction_is_on_another_level_than_the_junction_and_its_lanes(tmp_path: Path) -> None:
    """As in RESCO's ingolstadt21: a street crosses 3.5 m after the begin of a lane, and under the ways of junctions."""
    nodes = CROSS | {"m": (0.0, 0.0), "a": (-100.0, 11.0), "b": (100.0, 11.0), "c": (-100.0, 3.5), "d": (100.0, 3.5)}
    crossroads = ("wm", "mw", "me", "em", "sm", "ms", "nm", "mn")
    beside = network(tmp_path, nodes, *crossroads, "ab")
    assert {one.edges for one in beside.grade_separations} == {("ab", "mn"), ("ab", "nm")}
    ends = {lane.id: lane.shape for lane in beside.lanes}
    (_, y), _ = ends["mn_0"]
    assert y < 11.0 - 1.6 < y + FROM_ENDS
    under = network(tmp_path, nodes, *crossroads, "cd")
    inside = {edge for one in under.grade_separations for edge in one.edges if edge.startswith(":m_")}
    assert len(inside) >= 4
    assert apart(under.levels, 1.6, 1.9, *NORTH, 1.6, 1.9, *EAST)
    # Ways of one junction stay on one level.
    assert not apart(under.levels, 1.6, -1.6, *NORTH, 1.6, -1.6, *EAST)


def test_a_street_that_ends_on_another_one_is_on_its_level(tmp_path: Path) -> None:
    flat = network(tmp_path, CROSS | {"a": (0.0, -1.6 - FROM_ENDS + 1.0)}, "we", "na")
    assert flat.grade_separations == ()


def test_three_streets_above_one_another_have_three_levels_and_bridges_reach_beyond_their_edges(tmp_path: Path) -> None:
    # The bridge over the street eastwards is an edge of 16 m, with others before and after it.
    nodes = CROSS | {"a": (0.0, -8.0), "b": (0.0, 8.0), "x": (-70.0, -70.0), "y": (70.0, 70.0)}
    stacked = network(tmp_path, nodes, "we", "sa", "ab", "bn", "xy")
    assert {one.edges for one in stacked.grade_separations} == {("ab", "we"), ("ab", "xy"), ("we", "xy")}
    assert sorted(set(stacked.levels.level.tolist())) == [1, 2, 3]
    # A lorry that has its middle 12 m behind the bridge still covers a part of it.
    assert apart(stacked.levels, 1.6, 12.0, *NORTH, 0.0, -1.6, *EAST)
