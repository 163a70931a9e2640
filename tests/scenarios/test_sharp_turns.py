"""Turns that networks draw sharper than the models turn are driven; what cannot be driven is left to SUMO."""

import math
from itertools import pairwise
from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_crossroads, make_scenario

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SIDE = 60.0
"""m of the street before and after the bend."""
LANE = 1.6
"""m beside the middle of a lane at which its edge is."""
SETTINGS = '<step-length value="0.4"/><end value="60"/>'


def bend(folder: Path, degrees: float) -> Path:
    """A street with one corner, and a car and a bicycle on it."""
    x, y = SIDE * (1 + math.cos(math.radians(degrees))), SIDE * math.sin(math.radians(degrees))
    nodes = f'<node id="a" x="0" y="0"/><node id="c" x="{x:.2f}" y="{y:.2f}"/>'
    edge = f'<edge id="ac" from="a" to="c" speed="13.9" shape="0,0 {SIDE},0 {x:.2f},{y:.2f}"/>'
    types = '<vType id="car"/><vType id="bicycle" vClass="bicycle"/>'
    users = "".join(
        f'<vehicle id="{kind}" type="{kind}" depart="{depart}"><route edges="ac"/></vehicle>'
        for kind, depart in (("car", 0), ("bicycle", 15))
    )
    return make_scenario(folder, nodes, edge, types + users, settings=SETTINGS)


@pytest.mark.parametrize(("degrees", "followed"), [(60, True), (90, True), (130, True), (-130, True), (172, False)])
def test_learned_road_users_keep_to_the_street_in_a_bend(tmp_path: Path, degrees: float, followed: bool) -> None:
    config = bend(tmp_path, degrees)
    with SumoSession(find_scenario(str(config))) as session:
        line = session.network.lanes[0].shape
    farthest, learned = 0.0, 0
    for event in run(RunSettings(config, takeover="car=1,bicycle=1", steps=140)):
        if isinstance(event, Decision):
            world = event.steps[-1].world
            rows = np.flatnonzero(world.learned)
            learned += len(rows)
            places = np.column_stack([world.x, world.y])[rows]
            farthest = max([farthest, *(_distance(place, line) for place in places)])
    assert farthest < LANE
    assert learned > 0
    assert (learned > 80) == followed


def test_vehicles_that_turn_right_do_not_cut_the_corner(tmp_path: Path) -> None:
    cars = "".join(
        f'<vehicle id="{depart}" depart="{depart}"><route edges="sc ce"/></vehicle>' for depart in range(0, 40, 8)
    )
    config = make_crossroads(tmp_path, cars, settings=SETTINGS)
    with SumoSession(find_scenario(str(config))) as session:
        shapes = {lane.id: lane.shape for lane in session.network.lanes}
        ends = shapes["sc_0"][-1], shapes["ce_0"][0]
        turn = next(line for line in shapes.values() if np.allclose((line[0], line[-1]), ends, atol=0.05))
    inside: list[float] = []
    for event in run(RunSettings(config, takeover="car=1", selector="rule", steps=150)):
        if isinstance(event, Decision):
            world = event.steps[-1].world
            places = np.column_stack([world.x, world.y])[world.learned]
            inside += [_distance(place, turn) for place in places if max(abs(place - 100.0)) < 7.0]
    assert len(inside) > 20
    assert max(inside) < 0.5


def _distance(place: Floats, line: Floats) -> float:
    distances = []
    for a, b in pairwise(line):
        along = np.clip(np.dot(place - a, b - a) / max(np.dot(b - a, b - a), 1e-9), 0.0, 1.0)
        distances.append(float(np.hypot(*(place - a - along * (b - a)))))
    return min(distances)


def test_spawned_vehicles_turn_around_only_where_there_is_no_other_way(tmp_path: Path) -> None:
    run_program("netgenerate", ["--grid", "--grid.number", "3", "-o", "n.net.xml"], tmp_path)
    (tmp_path / "n.sumocfg").write_text('<configuration><net-file value="n.net.xml"/></configuration>')
    with SumoSession(find_scenario(str(tmp_path))) as session:
        graph = LaneGraph(session.api, session.network)
        for seed in range(20):
            path = graph.path("A0A1_0", (), "passenger", [(0.0, -5.0)], str(seed))
            edges = [graph.lanes[lane].edge for lane in path.lanes if not lane.startswith(":")]
            assert len(edges) > 1
            assert all(a[:2] + a[2:] != b[2:] + b[:2] for a, b in pairwise(edges))


@pytest.mark.parametrize(("x", "y"), [(10, 40), (0, 0)])
def test_learned_vehicles_drive_sharp_turns_and_turnarounds(tmp_path: Path, x: int, y: int) -> None:
    nodes = f'<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="{x}" y="{y}"/>'
    edges = '<edge id="ab" from="a" to="b" speed="13.9"/><edge id="bc" from="b" to="c" speed="13.9"/>'
    if (x, y) == (0, 0):
        nodes, edges = nodes.replace('<node id="c" x="0" y="0"/>', ""), edges.replace('to="c"', 'to="a"')
    users = "".join(
        f'<vType id="{kind}" vClass="{kind}"/><vehicle id="{kind}" type="{kind}" depart="{depart}">'
        '<route edges="ab bc"/></vehicle>'
        for kind, depart in (("passenger", 0), ("bicycle", 5))
    )
    config = make_scenario(tmp_path, nodes, edges, users, settings=SETTINGS)
    with SumoSession(find_scenario(str(config))) as session:
        lanes = {lane.id: lane.shape for lane in session.network.lanes}
    line = np.concatenate([lanes["ab_0"], lanes[":b_0_0"], lanes["bc_0"]])
    learned_on, farthest = set[str](), 0.0
    for event in run(RunSettings(config, takeover="car=1,bicycle=1", steps=140)):
        if isinstance(event, Decision):
            world = event.steps[-1].world
            for row in np.flatnonzero(world.learned):
                learned_on.add(f"{world.ids[row]} on {libsumo.vehicle.getLaneID(world.ids[row])}")
                farthest = max(farthest, _distance(np.array([world.x[row], world.y[row]]), line))
    assert {
        f"{kind} on {lane}" for kind in ("passenger", "bicycle") for lane in ("ab_0", ":b_0_0", "bc_0")
    } <= learned_on
    assert farthest < 1.2
