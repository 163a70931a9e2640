"""Priority between vehicles that SUMO drives and learned ones."""

from collections.abc import Iterator
from pathlib import Path

import libsumo
import pytest

from slrl_sumo.routing.junctions.occupants import USUAL
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_scenario, make_world
from tests.routing.junctions.test_reservations import track


@pytest.fixture(scope="module")
def minor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LaneGraph]:
    """The lanes of a junction of a main and a minor road; vehicle "n" of SUMO's comes near on the minor one."""
    folder: Path = tmp_path_factory.mktemp("minor")
    ends = {"n": (0, 80), "s": (0, -80), "e": (80, 0), "w": (-80, 0)}
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in ends.items())
    edges = "".join(
        f'<edge id="{way}_{name}" from="{begin}" to="{end}" priority="{2 if name in "ew" else 1}" speed="13.9"/>'
        for name in ends
        for way, begin, end in (("in", name, "c"), ("out", "c", name))
    )
    centre = '<node id="c" x="0" y="0" type="priority"/>'
    users = '<vehicle id="n" depart="0"><route edges="in_n out_s"/></vehicle>'
    config = make_scenario(folder, nodes + centre, edges, users)
    with SumoSession(find_scenario(str(config)), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        while session.time < 30.0:
            session.step()
            if "n" in libsumo.vehicle.getIDList() and libsumo.vehicle.getLanePosition("n") > 58.0:
                yield graph
                return
    pytest.fail("the vehicle did not come near")


@pytest.mark.parametrize(("start", "end", "free"), [("in_s", "out_w", False), ("in_s", "out_n", True)])
def test_of_two_that_have_to_yield_one_goes_first(minor: LaneGraph, start: str, end: str, free: bool) -> None:
    # SUMO's goes straight on: first of one that turns left, although both have to yield to the main road.
    right_of_way = RightOfWay(libsumo, minor)
    assert libsumo.vehicle.getSpeed("n") > 5.0
    link = next((target, via) for target, via in minor.links("in_n_0") if minor.lanes[target].edge == "out_s")
    assert not right_of_way.has_priority("in_n_0", *link)
    one = track(minor, start, end, 2.0, 3.0)
    assert right_of_way.goes_first("in_n_0", one.path.entries[0]) != free
    reservations = JunctionReservations(libsumo, minor, lambda _: None, right_of_way)
    reservations.renew(make_world())
    assert reservations.request_entry("car", one, one.path.entries[0], priority=False, size=USUAL) == free
