"""Paths of persons: which way round they go from an edge to the opposite one."""

import random
from itertools import permutations
from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_crossroads, make_scenario

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.netgen.scenario import write_scenario
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec
from slrl_sumo.routing.polyline import line_through
from slrl_sumo.routing.walking.walk_graph import WalkGraph
from slrl_sumo.routing.walking.walk_path import ASIDE, CLEARANCE, OFF_VEHICLES
from slrl_sumo.studies.flow.scenarios.junctions import crosswalk
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_the_opposite_edge_is_reached_by_the_nearer_junction(tmp_path: Path) -> None:
    """A road of 200 m to either side of a crosswalk: from its north side to its south side."""
    with SumoSession(find_scenario(str(crosswalk(tmp_path))), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        north, (south_x, south_y) = graph._lane_of["mw"], graph._lane_of["wm"].shape[0]
        (x, y), middle = north.shape[0], 170.0
        near = graph.path(("mw", "wm"), middle, 0.0, float(x) - 30.0, float(y))
        assert near is not None
        begin, _ = near.line.nearest(float(x) - 30.0, float(y), end=near.second_edge_end)
        # 30 m to the crosswalk, over it, and 30 m back: not 170 m to the end of the road and back.
        assert near.line.end - begin == pytest.approx(30.0 + 30.0 + 15.0, abs=10.0)
        assert len(near.crossings) == 1
        assert near.line.at(near.line.end)[:2] == pytest.approx((float(south_x) + middle, float(south_y)), abs=1.0)
        assert graph.path((), 0.0, 0.0, 0.0, 0.0) is None


@pytest.mark.parametrize("side", [-1.0, -0.4])
def test_persons_walk_beside_each_other_where_there_is_room(tmp_path: Path, side: float) -> None:
    with SumoSession(find_scenario(str(crosswalk(tmp_path))), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        x, y = (float(value) for value in graph._lane_of["mw"].shape[0])
        middle, beside = (graph.path(("mw", "wm"), 170.0, one, x - 30.0, y) for one in (0.0, side))
        assert middle is not None
        assert beside is not None
        sidewalk = graph._lane_of["mw"].width
        crossing = graph._internal[beside.crossings[0].crossing].width
        for s, width in (
            (beside.crossings[0].s - 20.0, sidewalk),
            (beside.crossings[0].s + 3.0, crossing),
            (beside.crossings[0].s + 30.0, sidewalk),
        ):
            aside = middle.line.nearest(*beside.line.at(s)[:2])[1]
            assert aside == pytest.approx(side * (0.5 * width - CLEARANCE - ASIDE), abs=0.05)
        # Against the direction of the lane, whose left is the walker's right.
        lane, _ = line_through(graph._lane_of["mw"].points)
        place = middle.line.at(middle.crossings[0].s - 20.0)[:2]
        assert lane.nearest(*place)[1] == pytest.approx(ASIDE, abs=0.01)


def test_persons_keep_off_the_middle_of_lanes_of_vehicles() -> None:
    with SumoSession(find_scenario("shared-space")) as session:
        graph = WalkGraph(libsumo, session.network)
        lane = next(one for one in graph._lane_of.values() if one.surface == Surface.ROAD)
        middle, _ = line_through(lane.points)
        x, y, _ = middle.at(0.5 * middle.end)
        for side, aside in ((0.0, OFF_VEHICLES), (-1.0, 0.5 * lane.width - CLEARANCE)):
            path = graph.path((lane.edge,), lane.length, side, x, y)
            assert path is not None
            assert -middle.nearest(*path.line.at(0.5 * path.line.end)[:2])[1] == pytest.approx(aside, abs=0.01)


@pytest.mark.parametrize("lefthand", [False, True])
@pytest.mark.parametrize("forward", [False, True])
def test_persons_walk_at_the_edge_of_the_carriageway(forward: bool, lefthand: bool, tmp_path: Path) -> None:
    """Against the direction of a street with two lanes they walked between both, as SUMO's do, and cars hit them."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="200" y="0"/>'
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>' for a, b in ("ab", "bc"))
    config = make_scenario(tmp_path, nodes, edges, "", *(["--lefthand"] if lefthand else []))
    with SumoSession(find_scenario(str(config)), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        lane, _ = line_through(graph._lane_of["ab"].points)
        path = graph.path(("ab", "bc") if forward else ("bc", "ab"), 50.0, -0.5, 0.0, 0.0)
        assert path is not None
        left = lane.place(*path.line.at(path.line.nearest(70.0, 0.0)[0])[:2], 0.0, lane.end)[1]
        assert (left if lefthand else -left) == pytest.approx(1.3, abs=0.01)


def test_no_path_returns_over_a_crossing() -> None:
    """Around a corner of `district`, the nearer end of a crossing is the one on the other side of the carriageway."""
    with SumoSession(find_scenario("district"), seed=1) as session:
        graph, rng = WalkGraph(libsumo, session.network), random.Random(1)
        edges = sorted(graph._lane_of)
        for edge in edges:
            path = graph.random_path(edge, True, -0.5, rng)
            assert path is not None
            ahead = np.diff(np.array([path.line.x, path.line.y]), axis=1)
            ahead /= np.hypot(*ahead)
            turns = np.sum(ahead[:, 1:] * ahead[:, :-1], axis=0)
            assert turns.min() > -0.9, edge


def test_persons_turn_on_the_walking_area_where_vehicles_may_turn_directly() -> None:
    with SumoSession(find_scenario("shared-space"), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        lanes = graph._through("in0_0", "out1_0", graph._left_by("in0", True), "")
        assert lanes == ["in0_0", ":centre_w0_0", "out1_0"]


def test_a_person_on_a_crossing_goes_on_over_it() -> None:
    """To the opposite street both ways around the junction are as long; SUMO has chosen one."""
    with SumoSession(find_scenario("intersection"), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        crossings = [f":centre_c{number}" for number in range(4)]
        begin, end = "in0", "in2"
        for here in crossings:
            x, y = graph._internal[f"{here}_0"].shape.mean(axis=0).tolist()
            path = graph.path((begin, end), 5.0, -0.5, x, y, here)
            assert path is not None
            over = [entry.crossing for entry in path.crossings]
            assert len(over) == 2
            assert f"{here}_0" in over
            _, _, distance = path.line.place(x, y, 0.0, path.line.end)
            assert distance < 3.0
        # On an edge, the shorter way: one crossing to the street beside.
        path = graph.path((begin, "in1"), 5.0, -0.5, *graph._lane_of[begin].points[0], begin)
        assert path is not None
        assert len(path.crossings) == 1


def test_from_crossing_to_crossing_no_path_lies_on_itself(tmp_path: Path) -> None:
    """At round corners two crossings end beyond the kerb, at the inner side of the corner in one place."""
    spec = IntersectionSpec(control="traffic_light", arms=4, lanes=1, arm_length=60.0, angle_spread=0.0)
    demand = DemandSpec(cars_per_hour=10.0, bicycles_per_hour=0.0, pedestrians_per_hour=10.0, duration=10.0, seed=1)
    with SumoSession(find_scenario(str(write_scenario(spec, demand, tmp_path / "made"))), seed=1) as session:
        graph, found = WalkGraph(libsumo, session.network), 0
        for begin, end in permutations([edge for edge in graph._lane_of if edge.startswith(("in", "out"))], 2):
            for side in (-1.0, -0.5, 0.0):
                path = graph.path((begin, end), 30.0, side, *graph._lane_of[begin].shape[0])
                if path is None or len(path.crossings) < 2:
                    continue
                between = np.arange(path.crossings[0].s + 4.0, path.crossings[1].s + 3.0, 0.25)
                places = np.array([path.line.at(s)[:2] for s in between])
                apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
                later = between[None] - between[:, None] > 1.5
                assert apart[later].min() > 0.4, (begin, end, side)
                found += 1
        assert found > 10


def test_a_person_off_its_path_is_led_on_from_where_it_is() -> None:
    """From every lane of the junction: it begins there, ends where the path did, and enters no crossing but by its
    begin."""
    with SumoSession(find_scenario("intersection"), seed=1) as session:
        graph, led = WalkGraph(libsumo, session.network), 0
        path = graph.path(("in0", "in1"), 10.0, -0.5, *graph._lane_of["in0"].points[0])
        assert path is not None
        s, destination = path.ends[0] + 2.0, path.line.at(path.line.end)[:2]
        for lane in graph._lanes_near("centre"):
            x, y = lane.shape.mean(axis=0).tolist()
            back = graph.back_on(path, s, -0.5, x, y)
            assert back is not None, lane.id
            assert back.line.at(back.line.end)[:2] == pytest.approx(destination, abs=0.01)
            assert back.line.place(x, y, 0.0, back.ends[0])[2] < 0.5 * lane.width
            assert all(lane.id != entry.crossing for entry in back.crossings)
            assert back.steps[-1] == path.steps[-1]
            led += lane.internal
        assert led == 8  # four crossings, four corners
        # On an edge of its walk it goes on there, at first with what is left of it.
        on_edge = graph.back_on(path, 0.5 * path.ends[0], -0.5, *path.line.at(0.5 * path.ends[0])[:2])
        assert on_edge is not None
        assert (on_edge.steps, on_edge.line.end) == (path.steps, pytest.approx(path.line.end))


def test_without_walking_areas_a_person_off_its_path_keeps_it(tmp_path: Path) -> None:
    with SumoSession(find_scenario(str(make_crossroads(tmp_path, ""))), seed=1) as session:
        graph = WalkGraph(libsumo, session.network)
        path = graph.path(("wc", "ce"), 50.0, -0.5, -80.0, 0.0)
        assert path is not None
        assert graph.back_on(path, 50.0, -0.5, -50.0, 9.0) is None
