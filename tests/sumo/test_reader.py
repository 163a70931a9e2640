"""All road users of SUMO as arrays, against libsumo's own getters."""

import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import libsumo
import numpy as np
import pytest

from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.reader import Reader, Snapshot, SpawnedPlaces
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

Copy = Callable[..., Path]

DEMAND = """<routes>
  <vType id="lorry" vClass="truck" length="7.1" width="2.4"/>
  <vType id="tram_bus" vClass="bus" length="18"/>
  <vType id="moped" vClass="moped"/>
  <vType id="bike" vClass="bicycle"/>
  <vType id="child" vClass="pedestrian" length="0.3" width="0.4"/>
  <trip id="truck" type="lorry" depart="0" from="in0" to="out1" departSpeed="max"/>
  <trip id="bus" type="tram_bus" depart="0" from="in1" to="out2" departSpeed="max"/>
  <trip id="moped" type="moped" depart="0" from="in2" to="out3"/>
  <trip id="cyclist" type="bike" depart="0" from="in3" to="out0"/>
  <person id="walker" type="child" depart="0"><walk from="in0" to="out1"/></person>
  <person id="passenger" depart="0"><ride from="in2" to="out0" lines="lift"/><walk from="out0" to="out0"/></person>
  <vehicle id="lift" depart="triggered"><route edges="in2 out0"/></vehicle>
</routes>"""


def subscribing() -> Reader:
    """A reader of the running simulation that subscribes, as over a TraCI connection."""
    domains = ("edge", "lane", "vehicle", "person", "vehicletype")
    return Reader(SimpleNamespace(**{name: getattr(libsumo, name) for name in domains}))


def equal(one: Snapshot | SpawnedPlaces, other: Snapshot | SpawnedPlaces) -> bool:
    """Whether all columns of two readings are equal."""
    names = [field.name for field in fields(one) if field.name != "spawned"]
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def rows(snapshot: Snapshot) -> dict[str, int]:
    return {road_user: row for row, road_user in enumerate(snapshot.ids)}


@pytest.fixture
def mixed(copy_scenario: Copy) -> Path:
    """The intersection with one road user of each kind, among them a passenger of a car."""
    config = copy_scenario("intersection")
    (config.parent / "intersection.rou.xml").write_text(DEMAND)
    return config


@pytest.mark.parametrize("name", ["intersection", "shared-space", "district"])
def test_it_agrees_with_the_getters_of_libsumo(name: str) -> None:
    with SumoSession(find_scenario(name)) as session:
        seen_persons = seen_vehicles = 0
        subscriber = subscribing()
        for step in range(150):
            session.step()
            if step % 10:
                continue
            snapshot, subscribed = session.reader.read(), subscriber.read()
            assert equal(snapshot, subscribed)
            vehicles, persons = libsumo.vehicle.getIDList(), libsumo.person.getIDList()
            assert snapshot.ids == (*vehicles, *persons)
            assert snapshot.person.tolist() == [False] * len(vehicles) + [True] * len(persons)
            seen_vehicles, seen_persons = seen_vehicles + len(vehicles), seen_persons + len(persons)
            for row, road_user in enumerate(snapshot.ids):
                domain = libsumo.person if snapshot.person[row] else libsumo.vehicle
                front = domain.getPosition(road_user)
                half = 0.5 * domain.getLength(road_user)
                angle = math.radians(90.0 - domain.getAngle(road_user))
                assert snapshot.x[row] == pytest.approx(front[0] - half * math.cos(angle))
                assert snapshot.y[row] == pytest.approx(front[1] - half * math.sin(angle))
                assert math.cos(snapshot.heading[row] - angle) == pytest.approx(1.0)
                assert abs(snapshot.heading[row]) <= math.pi
                assert snapshot.speed[row] == pytest.approx(max(domain.getSpeed(road_user), 0.0))
                assert snapshot.length[row] == domain.getLength(road_user)
                assert snapshot.width[row] == domain.getWidth(road_user)
                assert snapshot.sumo_type[row] == domain.getTypeID(road_user)
                place = domain.getRoadID(road_user) if snapshot.person[row] else domain.getLaneID(road_user)
                assert snapshot.lane[row] == place
                assert snapshot.lane_position[row] == pytest.approx(domain.getLanePosition(road_user))
        assert seen_persons > 10
        assert seen_vehicles > 20


def test_positions_are_centres_of_boxes(mixed: Path) -> None:
    with SumoSession(find_scenario(str(mixed))) as session:
        for _ in range(5):
            session.step()
        snapshot = session.reader.read()
        bus = rows(snapshot)["bus"]
        assert snapshot.length[bus] == 18.0
        # On a straight lane the centre lies half a length behind the front, on the centre line.
        front = libsumo.vehicle.getPosition("bus")
        x, y = libsumo.simulation.convert2D("in1", libsumo.vehicle.getLanePosition("bus"), 2)
        assert math.dist(front, (x, y)) < 0.01
        assert math.dist((snapshot.x[bus], snapshot.y[bus]), front) == pytest.approx(9.0)
        ahead = (np.cos(snapshot.heading[bus]), np.sin(snapshot.heading[bus]))
        assert (front[0] - snapshot.x[bus]) * ahead[0] + (front[1] - snapshot.y[bus]) * ahead[1] == pytest.approx(9.0)


def test_of_spawned_road_users_only_the_places_are_read() -> None:
    with SumoSession(find_scenario("district")) as session:
        for _ in range(90):
            session.step()
        vehicles, persons = libsumo.vehicle.getIDList(), libsumo.person.getIDList()
        everything, spawned = session.reader.read(), frozenset((*vehicles[::2], *persons[1:], "not.inserted"))
        for reader in (session.reader, subscribing()):
            snapshot = reader.read(spawned)
            assert snapshot.ids == (*vehicles[1::2], persons[0])
            kept = [rows(everything)[road_user] for road_user in snapshot.ids]
            assert np.array_equal(snapshot.x, everything.x[kept])
            places = snapshot.spawned
            assert (places.vehicles, places.persons) == (vehicles[::2], persons[1:])
            fronts = zip(places.front_x.tolist(), places.front_y.tolist(), strict=True)
            assert list(fronts) == [libsumo.vehicle.getPosition(vehicle) for vehicle in places.vehicles]
            on = [rows(everything)[vehicle] for vehicle in places.vehicles]
            assert places.lane == tuple(everything.lane[row] for row in on)
            assert np.array_equal(places.lane_position, everything.lane_position[on])
            assert snapshot.present == everything.present == frozenset((*vehicles, *persons))


def test_road_users_have_the_types_of_the_paper(mixed: Path) -> None:
    with SumoSession(find_scenario(str(mixed))) as session:
        for _ in range(40):
            session.step()
        snapshot = session.reader.read()
    kinds = {road_user: RoadUserType(snapshot.type[row]) for road_user, row in rows(snapshot).items()}
    assert kinds == {
        "truck": RoadUserType.CAR,
        "bus": RoadUserType.CAR,
        "moped": RoadUserType.CAR,
        "lift": RoadUserType.CAR,
        "cyclist": RoadUserType.BICYCLE,
        "walker": RoadUserType.PEDESTRIAN,
    }
    assert snapshot.type.dtype == np.int8
    sizes = dict(zip(snapshot.ids, zip(snapshot.length, snapshot.width, strict=True), strict=True))
    assert sizes["truck"] == (7.1, 2.4)
    assert sizes["walker"] == (0.3, 0.4)


def test_passengers_are_left_out_until_they_get_off(mixed: Path) -> None:
    with SumoSession(find_scenario(str(mixed))) as session:
        rode = walked = 0
        for _ in range(200):
            session.step()
            ids = session.reader.read().ids
            if "passenger" not in libsumo.person.getIDList():
                continue
            if libsumo.person.getVehicle("passenger"):
                rode += 1
                assert "passenger" not in ids
            else:
                walked += 1
                assert "passenger" in ids
        assert rode > 20
        assert walked > 5


def test_an_empty_network_has_no_road_users(copy_scenario: Copy) -> None:
    config = copy_scenario("intersection")
    (config.parent / "intersection.rou.xml").write_text("<routes/>")
    with SumoSession(find_scenario(str(config))) as session:
        session.step()
        snapshot = session.reader.read()
    assert snapshot.ids == ()
    for array in (snapshot.x, snapshot.heading, snapshot.type, snapshot.person, snapshot.lane_position):
        assert array.shape == (0,)


def test_forgetting_ends_all_subscriptions_and_reading_begins_them_again() -> None:
    with SumoSession(find_scenario("district")) as session:
        for _ in range(90):
            session.step()
        reader = subscribing()
        reader.read()
        assert len(libsumo.edge.getAllContextSubscriptionResults()) == 1
        assert len(libsumo.lane.getAllContextSubscriptionResults()) == 1
        reader.forget()
        session.step()
        assert libsumo.edge.getAllContextSubscriptionResults() == {}
        assert libsumo.lane.getAllContextSubscriptionResults() == {}
        snapshot = reader.read()
        assert snapshot.ids == (*libsumo.vehicle.getIDList(), *libsumo.person.getIDList())
        assert snapshot.x[-1] == pytest.approx(libsumo.person.getPosition(snapshot.ids[-1])[0], abs=0.2)


def test_subscriptions_of_others_are_neither_widened_nor_cancelled() -> None:
    with SumoSession(find_scenario("district")) as session:
        for _ in range(90):
            session.step()
        vehicle, person = libsumo.vehicle.getIDList()[-1], libsumo.person.getIDList()[-1]
        libsumo.vehicle.subscribe(vehicle, (libsumo.constants.VAR_SPEED,))
        libsumo.person.subscribe(person, (libsumo.constants.VAR_POSITION,))
        reader = subscribing()
        for act in (reader.read, reader.forget, session.reader.read, session.reader.forget):
            act()
            session.step()
            assert set(libsumo.vehicle.getAllSubscriptionResults()) == {vehicle}
            assert set(libsumo.vehicle.getSubscriptionResults(vehicle)) == {libsumo.constants.VAR_SPEED}
            assert set(libsumo.person.getAllSubscriptionResults()) == {person}
            assert set(libsumo.person.getSubscriptionResults(person)) == {libsumo.constants.VAR_POSITION}


def test_vehicles_on_no_lane_and_parked_ones_are_read(mixed: Path) -> None:
    with SumoSession(find_scenario(str(mixed))) as session:
        libsumo.route.add("r", ["in0"])
        libsumo.vehicle.add("parked", "r", departPos="20", departSpeed="0")
        libsumo.vehicle.setStop("parked", "in0", pos=60, laneIndex=2, flags=1)
        for _ in range(40):
            # Far from every lane: SUMO maps it nowhere.
            if "truck" in libsumo.vehicle.getIDList():
                libsumo.vehicle.moveToXY("truck", "", -1, -200.0, 300.0, 90.0, 2, 5.0)
            session.step()
        snapshot = session.reader.read()
        truck, parked = rows(snapshot)["truck"], rows(snapshot)["parked"]
        assert libsumo.vehicle.isStoppedParking("parked")
        reader = subscribing()
        assert np.array_equal(reader.read().x, snapshot.x)
        assert "truck" not in libsumo.edge.getContextSubscriptionResults(min(libsumo.edge.getIDList()))
        assert (snapshot.x[truck] + 0.5 * 7.1, snapshot.y[truck]) == pytest.approx((-200.0, 300.0))
        assert (snapshot.lane[truck], snapshot.lane_position[truck]) == ("", 0.0)
        assert (snapshot.x[parked] - 0.5 * snapshot.length[parked], snapshot.y[parked]) == pytest.approx(
            libsumo.vehicle.getPosition("parked"), abs=1e-6
        )


def test_a_road_user_that_returns_with_the_same_id_is_read(bare_network: Callable[[str], Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c"/>')
    with SumoSession(find_scenario(str(config)), step_length=0.4) as session:
        libsumo.route.add("r", ["ab"])
        lengths = []
        for speed in (13.0, 9.0):
            libsumo.vehicle.add("again", "r", departSpeed=str(speed))
            session.step()
            snapshot = session.reader.read()
            assert snapshot.ids == ("again",)
            lengths.append(snapshot.speed[0])
            while session.reader.read().ids:
                session.step()
        assert lengths == pytest.approx([13.0, 9.0])


def test_reading_right_after_forgetting_reads_all_road_users() -> None:
    with SumoSession(find_scenario("intersection")) as session:
        for _ in range(40):
            session.step()
        reader = subscribing()
        before = reader.read()
        reader.forget()
        after = reader.read()
        assert len(before.ids) > 3
        assert after.ids == before.ids
        assert np.array_equal(after.x, before.x)


def test_a_vehicle_without_an_angle_keeps_its_heading(monkeypatch: pytest.MonkeyPatch) -> None:
    with SumoSession(find_scenario("intersection")) as session:
        for _ in range(20):
            session.step()
        before = session.reader.read()
        monkeypatch.setattr(libsumo.vehicle, "getAngle", lambda vehicle: float("nan"))
        now = session.reader.read()
        assert now.ids == before.ids
        assert (~now.person).sum() > 0
        for name in ("x", "y", "heading"):
            assert np.array_equal(getattr(now, name), getattr(before, name))
        session.reader = Reader(libsumo)
        assert np.isfinite(session.reader.read().x).all()


@pytest.mark.parametrize("place", [(float("inf"), 0.0), (5.0, float("-inf")), (float("nan"), 5.0)])
def test_a_vehicle_at_infinity_is_on_no_network(monkeypatch: pytest.MonkeyPatch, place: tuple[float, float]) -> None:
    with SumoSession(find_scenario("intersection")) as session:
        for _ in range(20):
            session.step()
        vehicles = libsumo.vehicle.getIDList()
        assert vehicles
        monkeypatch.setattr(libsumo.vehicle, "getPosition", lambda vehicle: place)
        assert set(session.reader.read().ids).isdisjoint(vehicles)


def test_speeds_and_positions_that_are_no_numbers_are_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    with SumoSession(find_scenario("intersection")) as session:
        for _ in range(20):
            session.step()
        for name in ("getSpeed", "getLanePosition"):
            monkeypatch.setattr(libsumo.vehicle, name, lambda vehicle: float("nan"))
        snapshot = session.reader.read()
        assert (~snapshot.person).any()
        assert (snapshot.speed[~snapshot.person] == 0.0).all()
        assert (snapshot.lane_position[~snapshot.person] == 0.0).all()
