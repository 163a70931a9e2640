"""Lanes, junctions and the surfaces that they make."""

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import libsumo
import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Ribbon, Surface
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_scenario


def network(name: str) -> Network:
    with SumoSession(find_scenario(name)) as session:
        return session.network


@pytest.fixture(scope="module")
def intersection() -> Network:
    return network("intersection")


@pytest.fixture(scope="module")
def shared_space() -> Network:
    return network("shared-space")


def by_id(network: Network) -> dict[str, Lane]:
    return {lane.id: lane for lane in network.lanes}


def test_every_lane_is_what_libsumo_says() -> None:
    with SumoSession(find_scenario("intersection")) as session:
        assert [lane.id for lane in session.network.lanes] == list(libsumo.lane.getIDList())
        for lane in session.network.lanes:
            assert lane.edge == libsumo.lane.getEdgeID(lane.id)
            assert lane.width == libsumo.lane.getWidth(lane.id)
            assert lane.length == libsumo.lane.getLength(lane.id)
            assert lane.max_speed == libsumo.lane.getMaxSpeed(lane.id)
            assert np.array_equal(lane.shape, np.array(libsumo.lane.getShape(lane.id)))
            assert lane.internal == lane.id.startswith(":")
            assert lane.allowed == set(libsumo.lane.getAllowed(lane.id))


def test_each_part_of_a_street_has_its_surface(intersection: Network) -> None:
    lanes = by_id(intersection)
    assert lanes["in0_0"].surface == Surface.SIDEWALK
    assert lanes["in0_1"].surface == Surface.CYCLEWAY
    assert lanes["in0_2"].surface == Surface.ROAD
    crossings = [lane for lane in intersection.lanes if lane.surface == Surface.CROSSING]
    assert len(crossings) == 4
    assert all(lane.internal and lane.allowed == {"pedestrian"} for lane in crossings)
    walking_areas = [lane for lane in intersection.lanes if "_w" in lane.id]
    assert len(walking_areas) == 8
    assert all(lane.surface == Surface.SIDEWALK for lane in walking_areas)


def test_the_ground_is_painted_with_them(intersection: Network) -> None:
    roadmap = RoadMap(intersection.surfaces())
    expected = {
        Surface.SIDEWALK: ["in0_0", "out2_0"],
        Surface.CYCLEWAY: ["in1_1", "out3_1"],
        Surface.ROAD: ["in0_2", ":centre_10_0"],
        Surface.CROSSING: [":centre_c0_0", ":centre_c3_0"],
    }
    for surface, names in expected.items():
        for name in names:
            ends = by_id(intersection)[name].shape
            x, y = 0.5 * (ends[0] + ends[-1])
            assert roadmap.surface_at(np.array([x]), np.array([y])).tolist() == [surface], name


def test_walking_areas_are_filled_and_lanes_are_ribbons(intersection: Network) -> None:
    shapes = intersection.surfaces().shapes
    count = Counter((type(shape), shape.surface) for shape in shapes)
    # The other four have no width.
    assert count[Area, Surface.SIDEWALK] == 4
    assert count[Area, Surface.ROAD] == len(intersection.junctions)
    assert count[Ribbon, Surface.CROSSING] == 4
    widths = {shape.width for shape in shapes if isinstance(shape, Ribbon) and shape.surface == Surface.CYCLEWAY}
    assert widths == {1.5}
    # Later shapes lie on earlier ones: crossings on carriageway, carriageway on cycle lanes.
    ribbons = [shape.surface for shape in shapes if isinstance(shape, Ribbon)]
    order = [Surface.SIDEWALK, Surface.CYCLEWAY, Surface.ROAD, Surface.CROSSING]
    assert sorted(ribbons, key=order.index) == ribbons


def test_a_walking_area_of_no_width_is_as_wide_as_a_sidewalk(intersection: Network) -> None:
    # Where a street ends, it is a line between the ends of the sidewalks; SUMO's persons turn up to 1 m beyond it.
    line = by_id(intersection)[":arm2_w0_0"]
    assert line.width == 2.0
    assert line.shape[:, 0].tolist() == [0.0] * 4
    beyond, y = np.array([-1.3, -0.8, -0.3]), np.linspace(line.shape[:, 1].min(), line.shape[:, 1].max(), 10)
    found = RoadMap(intersection.surfaces()).surface_at(np.tile(beyond, 10), np.repeat(y, 3)).reshape(10, 3)
    assert found.tolist() == [[Surface.NONE, Surface.SIDEWALK, Surface.SIDEWALK]] * 10


def test_a_shared_space_is_road_for_all_types(shared_space: Network) -> None:
    lanes = [lane for lane in shared_space.lanes if not lane.internal]
    assert len(lanes) == 8
    for lane in lanes:
        assert lane.surface == Surface.ROAD
        assert {"passenger", "bicycle", "pedestrian"} <= lane.allowed
    assert not any(lane.surface == Surface.CROSSING for lane in shared_space.lanes)


def test_permissions_are_told_apart_where_one_of_sumos_lists_is_empty(bare_network: Callable[..., Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c" allow="rail"/>')
    with SumoSession(find_scenario(str(config))) as session:
        lanes = by_id(session.network)
    assert {"passenger", "bicycle", "pedestrian", "bus", "truck"} <= lanes["ab_0"].allowed
    assert lanes["ab_0"].surface == Surface.ROAD
    assert lanes["bc_0"].allowed == {"rail"}
    assert lanes["bc_0"].surface == Surface.NONE


def test_footpaths_and_cycle_tracks_alone_are_no_road(bare_network: Callable[..., Path]) -> None:
    config = bare_network(
        '<edge id="ab" from="a" to="b" allow="pedestrian bicycle delivery emergency"/>'
        '<edge id="bc" from="b" to="c" allow="bicycle"/>'
    )
    with SumoSession(find_scenario(str(config))) as session:
        lanes = by_id(session.network)
    assert lanes["ab_0"].surface == Surface.SIDEWALK
    assert lanes["bc_0"].surface == Surface.CYCLEWAY


def test_a_city_network_has_lanes_of_every_kind(game: Path) -> None:
    with SumoSession(find_scenario(str(game / "fkk_in.sumocfg"))) as session:
        closed = 0
        for lane in session.network.lanes:
            allowed, disallowed = libsumo.lane.getAllowed(lane.id), libsumo.lane.getDisallowed(lane.id)
            assert lane.allowed == set(allowed)
            assert not lane.allowed & set(disallowed)
            if not allowed:
                closed += 1
                assert lane.surface == Surface.NONE
        surfaces = {lane.surface for lane in session.network.lanes}
    assert closed > 0
    assert surfaces == set(Surface)


def test_the_junctions_of_a_signal() -> None:
    with SumoSession(find_scenario("signalised")) as session:
        assert list(session.network.signal_junctions.values()) == [("centre",)]


def test_a_lane_that_is_nowhere_is_named_with_its_scenario(copy_scenario: Callable[..., Path]) -> None:
    config = copy_scenario("intersection")
    net = next(config.parent.glob("*.net.xml"))
    net.write_text(re.sub(r'(<lane id="in0_2"[^>]* shape=")[^ ]*', r"\g<1>1e30,5", net.read_text()))
    with (
        pytest.raises(InputError, match=r"^.*\.sumocfg: lane in0_2 has a point .* correct the network$"),
        SumoSession(find_scenario(str(config))),
    ):
        pass


def test_the_network_ends_where_no_edge_leaves_a_junction(tmp_path: Path) -> None:
    """Two carriageways end at one junction, which netconvert draws over 25 m (Leeds)."""
    nodes = "".join(f'<node id="{n}" x="{x}" y="{y}"/>' for n, x, y in (("a", 0, 0), ("b", 0, 40), ("c", 200, 20)))
    edges = '<edge id="ac" from="a" to="c"/><edge id="bc" from="b" to="c"/>'
    make_scenario(tmp_path, nodes, edges, "")
    with SumoSession(find_scenario(str(tmp_path))) as session:
        network = session.network
    ends = {lane.id: tuple(lane.shape[-1]) for lane in network.lanes if not lane.internal}
    assert {tuple(row[:2]) for row in network.exits} >= set(ends.values())
    at_c = RoadMap(network.surfaces()).surface_at(np.array([199.5]), np.array([20.0]))
    assert at_c[0] == Surface.NONE
