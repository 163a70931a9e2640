"""Trips and emissions, against what SUMO itself says of them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from lxml import etree

from slrl_sumo.metrics.traffic.trips import Trips
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.background_state import Differences, background_world
from slrl_sumo.studies.compare.run import Emissions
from slrl_sumo.sumo.emissions import emission_rates
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession


class Watched(NamedTuple):
    """What was seen of a run, and what SUMO says of it."""

    trips: Trips
    infos: dict[str, etree._Element]
    worlds: list[WorldState]
    classes: dict[str, str]


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    """100 s of `signalised`: our trips, and SUMO's tripinfo of those that arrived."""
    file = tmp_path_factory.mktemp("trips") / "tripinfo.xml"
    classes: dict[str, str] = {}
    words = ["--tripinfo-output", str(file), "--device.emissions.probability", "1"]
    with SumoSession(with_options(find_scenario("signalised"), words), seed=2, keep_outputs=True) as session:
        trips, differences, worlds = Trips(session.api, session.step_length), Differences(), []
        for _ in range(round(100 / session.step_length)):
            session.step()
            world = differences.complete(background_world(session.reader.read(), session.time, frozenset()))
            trips.update(world, session.time)
            worlds.append(world)
            classes |= {i: session.api.vehicle.getEmissionClass(i) for i in session.api.vehicle.getIDList()}
    infos = {str(info.get("id")): info for info in etree.parse(str(file)).getroot().iter("tripinfo")}
    return Watched(trips, infos, worlds, classes)


def test_trips_are_those_of_sumo(watched: Watched) -> None:
    trips, infos = watched.trips, watched.infos
    arrived = {i for i, trip in trips.all.items() if trip.arrived is not None and trip.type != RoadUserType.PEDESTRIAN}
    assert arrived == set(infos)
    assert len(arrived) > 8
    for road_user, info in infos.items():
        trip = trips.all[road_user]
        assert trip.sumo_type == info.get("vType")
        assert trip.departed == pytest.approx(float(info.get("depart")))
        assert trip.departure_delay == pytest.approx(float(info.get("departDelay")), abs=0.01)
        assert trip.arrived is not None
        assert trip.arrived - trip.departed == pytest.approx(float(info.get("duration")))
        # We do not see the step in which it arrives, and SUMO counts a part of that in which it departs.
        assert trip.time_loss == pytest.approx(float(info.get("timeLoss")), abs=0.5)
        assert trip.standing == pytest.approx(float(info.get("waitingTime")), abs=0.41)
        assert trip.distance == pytest.approx(float(info.get("routeLength")), abs=20.0)
    assert sum(trip.stops for trip in trips.all.values()) > 3


def test_walkers_have_trips(watched: Watched) -> None:
    walkers = [trip for trip in watched.trips.all.values() if trip.type == RoadUserType.PEDESTRIAN]
    assert len(walkers) > 5
    assert all(trip.departure_delay == 0.0 for trip in walkers)
    for trip in walkers:
        assert 0.0 <= trip.time_loss <= 100.0


def test_emissions_are_those_of_sumos_devices(watched: Watched) -> None:
    exhaust = Emissions(SimpleNamespace(vehicle=SimpleNamespace(getEmissionClass=watched.classes.get)))
    for world in watched.worlds:
        exhaust.add(world.take(np.array([i for i, name in enumerate(world.ids) if name in watched.infos], np.intp)))
    record = exhaust.record()
    for ours, theirs, unit in (("co2", "CO2_abs", 1e3), ("nox", "NOx_abs", 1e3), ("fuel", "fuel_abs", 1e3)):
        total = sum(float(info.find("emissions").get(theirs)) for info in watched.infos.values()) / unit
        # We do not see the step in which a vehicle arrives, nor which part of one it was there.
        assert record[ours] == pytest.approx(total, rel=0.03), ours
    driven = sum(
        float(info.get("routeLength")) for i, info in watched.infos.items() if not watched.classes[i].startswith("Zero")
    )
    assert record["metres"] == pytest.approx(driven, rel=0.05)
    assert record["unknown"] == []


def test_rates_are_those_of_a_running_sumo() -> None:
    with SumoSession(find_scenario("signalised"), seed=1) as session:
        for _ in range(100):
            session.step()
        vehicle = session.api.vehicle
        seen = {i: vehicle.getEmissionClass(i) for i in vehicle.getIDList()}
        (name,) = {name for name in seen.values() if not name.startswith("Zero")}
        mine = [i for i, kind in seen.items() if kind == name]
        speed, acceleration = (np.array([get(i) for i in mine]) for get in (vehicle.getSpeed, vehicle.getAcceleration))
        expected = {
            "co2": [vehicle.getCO2Emission(i) for i in mine],
            "nox": [vehicle.getNOxEmission(i) for i in mine],
            "pmx": [vehicle.getPMxEmission(i) for i in mine],
            "fuel": [vehicle.getFuelConsumption(i) for i in mine],
        }
    assert len(mine) > 2
    rates = emission_rates(name, speed=speed, acceleration=acceleration)
    assert rates is not None
    for pollutant, values in expected.items():
        assert rates[pollutant] == pytest.approx(values, rel=1e-4), pollutant


def test_a_class_without_data_has_no_rates() -> None:
    assert emission_rates("PHEMlight/none", speed=np.ones(1), acceleration=np.zeros(1)) is None
    assert emission_rates("Zero/default", speed=np.ones(3), acceleration=np.zeros(3))["co2"].tolist() == [0.0] * 3
    assert len(emission_rates("HBEFA4/PC_petrol_Euro-4", speed=np.zeros(0), acceleration=np.zeros(0))["co2"]) == 0


class Stub:
    """A network of one vehicle that wants 10 m/s."""

    def __init__(self) -> None:
        self.simulation = SimpleNamespace(getArrivedIDList=lambda: self.gone, getArrivedPersonIDList=tuple)
        self.person = SimpleNamespace(getIDList=tuple)
        self.vehicle = SimpleNamespace(
            getIDList=lambda: () if self.gone else ("car",),
            getAllowedSpeed=lambda name: 10.0,
            getDepartDelay=lambda name: 1.5,
            getTypeID=lambda name: "lorry@car",
        )
        self.gone: tuple[str, ...] = ()


def test_a_speed_that_sways_about_the_limit_is_one_stop() -> None:
    api = Stub()
    trips = Trips(api, 0.5)
    alone = replace(empty_world(), ids=("car",), type=np.zeros(1, np.int8))
    speeds = (0.0, 5.0, 10.0, 0.05, 0.0, 0.2, 0.0, 0.0, 0.2, 0.05, 8.0, 0.0, 12.0, 0.0, 0.0)
    for step, speed in enumerate(speeds, start=1):
        trips.update(replace(alone, speed=np.array([speed])), 100.0 + 0.5 * step)
    api.gone = ("car",)
    trips.update(replace(alone, speed=np.zeros(1)), 108.0)
    (trip,) = trips.all.values()
    # It stands at the begin, which is no stop; then once with a little swaying; for 0.5 s, which is too short; and in
    # the end for 1 s.
    assert (trip.sumo_type, trip.departed, trip.arrived, trip.departure_delay) == ("lorry", 100.0, 107.5, 1.5)
    assert trip.stops == 2
    assert trip.standing == pytest.approx(0.5 * 9)
    assert trip.distance == pytest.approx(0.5 * 35.5)
    # 15 steps, less what was driven in terms of 10 m/s, where 12 m/s count as 10.
    assert trip.time_loss == pytest.approx(0.5 * (15 - 3.35))
