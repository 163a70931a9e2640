"""Limits, closed lanes and routes that change while a vehicle is on its way."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import libsumo
import numpy as np
import pytest
from builders import make_world

from slrl_sumo.routing.lane_graph import LOOKS
from slrl_sumo.routing.routes import Routes
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.types import DECISION_INTERVAL, SPAWNED_PREFIX
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

LANE_END = 3.0
"""m before the end of a lane that does not lead on at which vehicles wait."""
Ahead = Callable[[], tuple[RouteAhead, VehicleTrack]]


@pytest.fixture
def session() -> Iterator[SumoSession]:
    """A car stands 15 m before the junction, on its way straight on."""
    with SumoSession(find_scenario("intersection"), step_length=DECISION_INTERVAL) as opened:
        libsumo.route.add("way", ["in1", "out3"])
        libsumo.route.add("other way", ["in1", "out2"])
        place = libsumo.lane.getLength("in1_2") - 15.0
        libsumo.vehicle.add("car", "way", typeID="passenger1", departLane="2", departPos=f"{place:.3f}")
        libsumo.vehicle.setSpeed("car", 0.0)
        libsumo.vehicle.setLaneChangeMode("car", 0)
        while "car" not in libsumo.vehicle.getIDList() or libsumo.vehicle.getLaneID("car") != "in1_2":
            opened.step()
        yield opened


@pytest.fixture
def ahead(session: SumoSession) -> Ahead:
    """The route of the car when it has looked at all lanes, and its track."""
    routes = Routes(libsumo, session.network)

    def now() -> tuple[RouteAhead, VehicleTrack]:
        for _ in range(LOOKS - 1):
            look()
        return look()

    def look() -> tuple[RouteAhead, VehicleTrack]:
        snapshot = session.reader.read()
        row = snapshot.ids.index("car")
        names = ("type", "x", "y", "heading", "speed", "length", "width")
        columns = {name: getattr(snapshot, name)[[row]] for name in names}
        route = routes.ahead(make_world(**columns, ids=["car"], time=session.time), 1)
        track = routes._vehicles.get("car")
        assert track is not None
        return route, track

    return now


def _allow(edge: str, classes: list[str]) -> None:
    for number in range(libsumo.edge.getLaneNumber(edge)):
        libsumo.lane.setAllowed(f"{edge}_{number}", classes)


def test_a_speed_limit_counts_while_it_is_shown(ahead: Ahead) -> None:
    before = ahead()[0].desired_speed[0]
    usual, factor = libsumo.lane.getMaxSpeed("in1_2"), libsumo.vehicle.getSpeedFactor("car")
    assert before == pytest.approx(usual * factor)
    libsumo.lane.setMaxSpeed("in1_2", 4.0)
    assert ahead()[0].desired_speed[0] == pytest.approx(4.0 * factor)
    libsumo.lane.setMaxSpeed("in1_2", usual)
    assert ahead()[0].desired_speed[0] == before


def test_a_vehicle_waits_before_a_closed_edge_until_it_is_open(ahead: Ahead) -> None:
    open_, _ = ahead()
    assert open_.stop[0] == math.inf
    left = libsumo.lane.getLength("in1_2") - libsumo.vehicle.getLanePosition("car")
    _allow("out3", ["authority"])
    closed, track = ahead()
    assert closed.stop[0] == pytest.approx(left - LANE_END, abs=0.1)
    assert track.path.lanes == ("in1_2",)
    _allow("out3", ["passenger"])
    assert ahead()[0].stop[0] == math.inf


def test_where_one_lane_is_closed_the_path_leads_over_another_one(ahead: Ahead) -> None:
    target = next(lane for lane in ahead()[1].path.lanes if lane.startswith("out3"))
    libsumo.lane.setDisallowed(target, ["passenger"])
    route, track = ahead()
    assert target not in track.path.lanes
    # It changes to the lane that leads on, or waits before the end of its own.
    assert any(lane.startswith("out3") for lane in track.path.lanes) or route.stop[0] < 15.0


def test_a_route_that_changes_on_its_edge_is_followed(session: SumoSession, ahead: Ahead) -> None:
    assert {lane.rsplit("_", 1)[0] for lane in ahead()[1].path.lanes} >= {"in1", "out3"}
    libsumo.vehicle.setRoute("car", ["in1", "out2"])
    _, track = ahead()
    assert track.edges == ("out2",)
    assert not any(lane.startswith("out3") for lane in track.path.lanes)


def test_added_cars_do_not_enter_closed_edges(session: SumoSession) -> None:
    """They have no route: they take another way, and wait where there is none."""
    routes = Routes(libsumo, session.network)
    snapshot = session.reader.read()
    row = snapshot.ids.index("car")
    columns = {name: getattr(snapshot, name)[[row]] for name in ("type", "x", "y", "heading", "speed")}
    world = make_world(**columns, ids=[f"{SPAWNED_PREFIX}car.0"], time=session.time)
    libsumo.vehicle.add(world.ids[0], "way", typeID="passenger1")
    routes.ahead(world, 1)
    track = routes._vehicles.get(world.ids[0])
    assert track is not None
    for _ in range(4):
        ends = {lane.rsplit("_", 1)[0] for lane in track.path.lanes if lane.startswith("out")}
        if not ends:
            break
        for edge in ends:
            _allow(edge, ["authority"])
        for _ in range(LOOKS):
            route = routes.ahead(replace(world, time=world.time + 1.0), 1)
        assert not ends & {lane.rsplit("_", 1)[0] for lane in track.path.lanes}
    assert np.isfinite(route.stop[0])
