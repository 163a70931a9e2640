"""Road users of the scenario are lent and come back to SUMO as they were."""

import math
from collections.abc import Iterator
from pathlib import Path

import libsumo
import numpy as np
import pytest

from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl
from slrl_sumo.sumo.taken_over.vehicles import MAX_LANE_OFFSET, MOVED
from tests.builders import make_scenario

VEHICLE, PERSON = np.array([False]), np.array([True])
DEFAULT_MODES = (31, 1621)


@pytest.fixture
def session() -> Iterator[SumoSession]:
    with SumoSession(find_scenario("intersection")) as session:
        yield session


def _add_car(session: SumoSession, name: str = "car", edges: tuple[str, ...] = ("in0", "out2")) -> None:
    """A car of the scenario under way on the first of `edges`, alone on the road."""
    libsumo.route.add(f"route of {name}", list(edges))
    libsumo.vehicle.add(name, f"route of {name}", typeID="passenger1", departLane="best", departSpeed="10")
    for _ in range(20):
        session.step()
        if libsumo.vehicle.getLaneID(name):
            return
    raise AssertionError("SUMO did not insert the car")


def _add_person(session: SumoSession, edges: tuple[str, ...] = ("in0", "out2"), arrival: float = 40.0) -> None:
    libsumo.person.add("walker", edges[0], 60.0, typeID="pedestrian1")
    libsumo.person.appendWalkingStage("walker", list(edges), arrival)
    libsumo.person.appendWaitingStage("walker", 3.0)
    session.step()
    session.step()


def _clear() -> None:
    """Take the scenario's own traffic away: what remains in the test is what it added."""
    for domain in (libsumo.vehicle, libsumo.person):
        for road_user in domain.getIDList():
            if road_user not in ("car", "walker"):
                domain.remove(road_user)


def _row(snapshot: Snapshot, road_user: str) -> int:
    return snapshot.ids.index(road_user)


def _carry(
    session: SumoSession, control: TakenOverControl, road_user: str, speed: float, steps: int, turn: float = 0.0
) -> None:
    """Move a road user straight on (turned by `turn` rad), step by step."""
    snapshot = session.reader.read()
    i = _row(snapshot, road_user)
    x, y, heading = float(snapshot.x[i]), float(snapshot.y[i]), float(snapshot.heading[i]) + turn
    person = snapshot.person[i : i + 1]
    for _ in range(steps):
        _clear()
        x += speed * session.step_length * math.cos(heading)
        y += speed * session.step_length * math.sin(heading)
        place = (np.array([v]) for v in (x, y, heading, speed, snapshot.length[i]))
        control.move([road_user], person, *place)
        session.step()


def test_modes_are_lifted_while_lent_and_restored_exactly(session: SumoSession) -> None:
    _add_car(session)
    libsumo.vehicle.setSpeedMode("car", 23)
    libsumo.vehicle.setLaneChangeMode("car", 597)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["car"], VEHICLE)
    assert control.ids == {"car"}
    assert libsumo.vehicle.getSpeedMode("car") == MOVED
    # libsumo keeps bits of the lane change mode that mean "as a matter of course".
    lifted = libsumo.vehicle.getLaneChangeMode("car")
    assert lifted != 597
    _carry(session, control, "car", 8.0, 5)
    assert control.hand_back(["car"], VEHICLE).tolist() == [True]
    assert libsumo.vehicle.getSpeedMode("car") == 23
    assert libsumo.vehicle.getLaneChangeMode("car") == 597
    assert control.ids == frozenset()


def test_lent_car_is_where_it_was_put_and_goes_on_from_there_along_its_route(session: SumoSession) -> None:
    _add_car(session)
    route = libsumo.vehicle.getRoute("car")
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["car"], VEHICLE)
    before = session.reader.read()
    start = float(before.x[_row(before, "car")])
    _carry(session, control, "car", 6.0, 10)
    after = session.reader.read()
    car = _row(after, "car")
    assert abs(abs(float(after.x[car]) - start) - 6.0 * 10 * session.step_length) < 0.01
    assert float(after.speed[car]) == pytest.approx(6.0, abs=0.01)
    assert control.hand_back(["car"], VEHICLE).tolist() == [True]
    session.step()
    # SUMO drives on at that speed: no jump, no braking, and faster as soon as it may.
    first = session.reader.read()
    car = _row(first, "car")
    moved = abs(float(first.x[car]) - float(after.x[_row(after, "car")]))
    assert 6.0 * session.step_length - 0.5 < moved < 6.0 * session.step_length + 1.2
    arrived: set[str] = set()
    last, fastest = "", 0.0
    for _ in range(150):
        _clear()
        if "car" in libsumo.vehicle.getIDList():
            fastest = max(fastest, libsumo.vehicle.getSpeed("car"))
            last = libsumo.vehicle.getRoadID("car")
            assert libsumo.vehicle.getRoute("car") == route
        session.step()
        arrived |= set(libsumo.simulation.getArrivedIDList())
    assert "car" in arrived
    assert last == "out2"
    assert fastest > 9.0


@pytest.mark.parametrize("aside", [0.2, 1.2])
def test_a_car_goes_on_in_the_middle_of_its_lane(session: SumoSession, aside: float) -> None:
    """SUMO itself keeps the offset of a vehicle that was moved, for ever."""
    _add_car(session)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["car"], VEHICLE)
    # To the side within 10 m, then straight on.
    turn = math.asin(aside / 10.0)
    _carry(session, control, "car", 10.0 / session.step_length, 1, turn)
    _carry(session, control, "car", 6.0, 3, -turn)
    before = libsumo.vehicle.getLanePosition("car")
    assert abs(libsumo.vehicle.getLateralLanePosition("car")) == pytest.approx(aside, abs=0.02)
    assert control.hand_back(["car"], VEHICLE).tolist() == [True]
    _clear()
    control.place_handed_back()
    session.step()
    assert (libsumo.vehicle.getLateralLanePosition("car") == 0.0) == (aside > MAX_LANE_OFFSET)
    assert libsumo.vehicle.getLanePosition("car") - before == pytest.approx(6.0 * session.step_length, abs=1.2)
    _clear()
    session.step()
    assert libsumo.vehicle.getSpeed("car") > 6.0


@pytest.mark.parametrize("name", ["walker", "car"])
def test_a_simulation_closed_after_a_hand_back_leaves_the_next_one_alone(name: str) -> None:
    """libsumo carries out a pending move in the next simulation of the process, or crashes there."""
    places = []
    for _ in range(2):
        with SumoSession(find_scenario("intersection")) as session:
            (_add_person if name == "walker" else _add_car)(session)
            user, person = [name], PERSON if name == "walker" else VEHICLE
            domain = libsumo.person if name == "walker" else libsumo.vehicle
            places.append(domain.getPosition(name))
            control = TakenOverControl(libsumo, session.network)
            control.take_over(user, person)
            _carry(session, control, name, 1.2 if name == "walker" else 8.0, 5)
            if name == "car":
                _carry(session, control, name, 10.0, 6, turn=math.pi / 2)
            assert control.hand_back(user, person, off_route=name == "car").tolist() == [True]
    assert places[0] == places[1]


def test_a_car_beside_every_road_stays_lent_until_it_is_back(session: SumoSession) -> None:
    _add_car(session)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["car"], VEHICLE)
    _carry(session, control, "car", 8.0, 2)
    # Across the road and off it.
    _carry(session, control, "car", 10.0, 6, turn=math.pi / 2)
    # SUMO still names the road, but it has the car on no lane.
    assert libsumo.vehicle.getLaneID("car") == ""
    assert control.hand_back(["car"], VEHICLE).tolist() == [False]
    assert control.ids == {"car"}
    assert libsumo.vehicle.getSpeedMode("car") == MOVED
    _carry(session, control, "car", 10.0, 6, turn=math.pi)
    assert control.hand_back(["car"], VEHICLE).tolist() == [True]
    assert (libsumo.vehicle.getSpeedMode("car"), libsumo.vehicle.getLaneChangeMode("car")) == DEFAULT_MODES


def test_vehicles_with_stops_ahead_or_of_other_kinds_are_left_alone(session: SumoSession) -> None:
    _add_car(session)
    control = TakenOverControl(libsumo, session.network)
    assert control.obstacles(["car"], VEHICLE, models=True) == ("",)
    lane = libsumo.vehicle.getLaneIndex("car")
    libsumo.vehicle.setStop("car", "in0", pos=80.0, laneIndex=lane, duration=1000.0)
    assert control.obstacles(["car"], VEHICLE, models=True) == ("stop ahead",)
    for _ in range(60):
        _clear()
        session.step()
    assert libsumo.vehicle.isStopped("car")
    assert control.obstacles(["car"], VEHICLE, models=True) == ("stop ahead",)
    libsumo.vehicle.resume("car")
    session.step()
    assert control.obstacles(["car"], VEHICLE, models=True) == ("",)
    libsumo.vehicle.setVehicleClass("car", "tram")
    assert control.obstacles(["car"], VEHICLE, models=False) == ("class tram",)


@pytest.mark.parametrize("vehicle_class", ["bus", "truck", "motorcycle", "moped", "scooter", "emergency"])
def test_models_of_cars_move_no_vehicles_that_sumo_drives_otherwise(session: SumoSession, vehicle_class: str) -> None:
    _add_car(session)
    control = TakenOverControl(libsumo, session.network)
    libsumo.vehicle.setVehicleClass("car", vehicle_class)
    assert control.obstacles(["car"], VEHICLE, models=True) == (f"class {vehicle_class}",)
    # The lane follower drives as the vehicle type says.
    assert control.obstacles(["car"], VEHICLE, models=False) == ("",)


@pytest.mark.parametrize(("vehicle_class", "length", "width", "why"), [
    ("passenger", 5.6, 2.0, ""), ("delivery", 5.2, 1.9, ""), ("taxi", 5.0, 1.8, ""),
    ("passenger", 12.0, 1.8, "size"), ("delivery", 6.5, 2.16, "size"), ("passenger", 5.0, 2.5, "size"),
])  # fmt: skip
def test_models_of_cars_move_no_vehicles_larger_than_recorded_cars(
    session: SumoSession, vehicle_class: str, length: float, width: float, why: str
) -> None:
    _add_car(session)
    libsumo.vehicle.setVehicleClass("car", vehicle_class)
    libsumo.vehicle.setLength("car", length)
    libsumo.vehicle.setWidth("car", width)
    control = TakenOverControl(libsumo, session.network)
    assert control.obstacles(["car"], VEHICLE, models=True) == (why,)


def test_persons_that_walk_may_be_taken_those_that_wait_or_ride_may_not(session: SumoSession) -> None:
    _add_person(session)
    libsumo.person.add("waiter", "in0", 20.0, typeID="pedestrian1")
    libsumo.person.appendWaitingStage("waiter", 1000.0)
    _add_car(session, "taxi")
    libsumo.vehicle.setStop("taxi", "in0", pos=60.0, laneIndex=libsumo.vehicle.getLaneIndex("taxi"), duration=100.0)
    libsumo.person.add("rider", "in0", 62.0, typeID="pedestrian1")
    libsumo.person.appendDrivingStage("rider", "out2", "taxi")
    for _ in range(30):
        session.step()
    assert libsumo.person.getVehicle("rider") == "taxi"
    control = TakenOverControl(libsumo, session.network)
    people = np.array([True, True, True])
    assert control.obstacles(["walker", "waiter", "rider"], people, models=True) == ("", "no walk", "no walk")


def test_a_lent_walker_comes_back_where_it_is_and_reaches_its_own_destination(session: SumoSession) -> None:
    _add_person(session)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["walker"], PERSON)
    before = libsumo.person.getPosition("walker")
    # A little to the left of where SUMO walks, along the sidewalk.
    _carry(session, control, "walker", 1.2, 20, turn=0.02)
    there = libsumo.person.getPosition("walker")
    assert math.dist(before, there) == pytest.approx(1.2 * 20 * session.step_length, abs=0.01)
    assert control.hand_back(["walker"], PERSON).tolist() == [True]
    assert control.ids == frozenset()
    control.place_handed_back()
    session.step()
    assert math.dist(there, libsumo.person.getPosition("walker")) < 0.3
    last = 0.0
    for _ in range(400):
        _clear()
        if "walker" not in libsumo.person.getIDList() or libsumo.person.getStage("walker", 0).type != 2:
            break
        here, last = libsumo.person.getRoadID("walker"), libsumo.person.getLanePosition("walker")
        session.step()
    # The stage after the walk is still there: the walker waits at its destination.
    assert here == "out2"
    assert last == pytest.approx(40.0, abs=2.0)
    assert libsumo.person.getStage("walker", 0).type == 1


@pytest.mark.parametrize(("aside", "off_route"), [(-1.3, False), (1.1, False), (1.3, True), (3.0, True)])
def test_a_walker_beside_its_sidewalk_goes_back_onto_it(session: SumoSession, aside: float, off_route: bool) -> None:
    """0.1 m beside it SUMO lets persons stand for ever, and farther beside it their walk is over at once."""
    _add_person(session)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["walker"], PERSON)
    # The sidewalk leads west, 2 m wide, with its middle at y = 100.7.
    for x in (128.0, 127.5, 127.0):
        _clear()
        control.move(["walker"], PERSON, *(np.array([v]) for v in (x, 100.7 + aside, math.pi, 1.25, 0.2)))
        session.step()
    assert control.hand_back(["walker"], PERSON, off_route=off_route).tolist() == [True]
    control.place_handed_back()
    session.step()
    x, y = libsumo.person.getPosition("walker")
    assert x == pytest.approx(126.9, abs=0.2)
    assert y == pytest.approx(100.7 + math.copysign(1.0, aside), abs=0.1)
    for _ in range(10):
        _clear()
        session.step()
    assert x - libsumo.person.getPosition("walker")[0] > 2.0


@pytest.mark.parametrize(
    ("direction", "aside", "beyond"), [(0.0, 0.0, -0.2), (1.0, -1.2, 0.17), (1.0, 1.1, 0.4), (-1.2, -1.2, 0.4)]
)
def test_a_walker_that_has_just_come_onto_its_street_walks_on(
    tmp_path: Path, direction: float, aside: float, beyond: float
) -> None:
    """Exactly at the end of an edge SUMO ends a walk at once, or lets persons stand for ever."""
    along = np.array([math.cos(direction), math.sin(direction)])
    places = {name: 200.0 + m * along for name, m in (("a", 0.0), ("b", 60.0), ("c", 120.0))}
    nodes = "".join(f'<node id="{name}" x="{x:.2f}" y="{y:.2f}"/>' for name, (x, y) in places.items())
    edges = "".join(f'<edge id="{i}" from="{i[0]}" to="b" numLanes="1" speed="5"/>' for i in ("ab", "cb"))
    walk = '<person id="walker" depart="0" departPos="40"><walk edges="ab cb"/></person>'
    config = make_scenario(tmp_path, nodes, edges, walk, "--walkingareas")
    with SumoSession(find_scenario(str(config))) as session:
        for _ in range(3):
            session.step()
        control = TakenOverControl(libsumo, session.network)
        control.take_over(["walker"], PERSON)
        end = next(lane for lane in session.network.lanes if lane.edge == "cb").shape[-1]
        for before in (1.5, 1.0, 0.5, beyond):
            x, y = end - before * along + aside * np.array([-along[1], along[0]])
            control.move(["walker"], PERSON, *(np.array([v]) for v in (x, y, direction, 1.25, 0.2)))
            session.step()
        assert control.hand_back(["walker"], PERSON).tolist() == [True]
        control.place_handed_back()
        for _ in range(20):
            session.step()
        assert (np.array(libsumo.person.getPosition("walker")) - end) @ along > 9.0


def test_a_walker_on_a_crossing_goes_back_only_on_the_next_sidewalk(session: SumoSession) -> None:
    _add_person(session)
    control = TakenOverControl(libsumo, session.network)
    for _ in range(200):
        _clear()
        session.step()
        if "_c" in libsumo.person.getRoadID("walker"):
            break
    assert "_c" in libsumo.person.getRoadID("walker")
    control.take_over(["walker"], PERSON)
    _carry(session, control, "walker", 1.2, 2)
    assert control.hand_back(["walker"], PERSON).tolist() == [False]
    assert control.ids == {"walker"}
    # Detaching cannot wait for that.
    assert control.release() == ()
    assert control.ids == frozenset()


def test_road_users_that_have_gone_are_forgotten_and_the_rest_released(session: SumoSession) -> None:
    _add_car(session)
    _add_person(session)
    control = TakenOverControl(libsumo, session.network)
    control.take_over(["car", "walker"], np.array([False, True]))
    _carry(session, control, "car", 8.0, 1)
    _carry(session, control, "walker", 1.2, 1)
    control.abandon(["car", "absent"])
    assert control.ids == {"walker"}
    control.take_over(["car"], VEHICLE)
    libsumo.person.remove("walker")
    assert control.release() == ()
    assert control.ids == frozenset()
