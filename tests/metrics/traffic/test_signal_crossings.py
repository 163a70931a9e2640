"""Red-light violations, against signals of a made intersection in real SUMO."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from builders import make_scenario, make_world

from slrl_sumo.metrics.traffic.signal_crossings import SignalCrossings, outside_by, shortened
from slrl_sumo.netgen.scenario import write_scenario
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec
from slrl_sumo.routing.walking.walking_area import distance_to
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl


@pytest.fixture
def made(tmp_path: Path) -> Scenario:
    """A small intersection with signals, crossings and traffic of all types."""
    spec = IntersectionSpec(control="traffic_light", lanes=2, arm_length=60.0)
    demand = DemandSpec(
        cars_per_hour=700.0, bicycles_per_hour=300.0, pedestrians_per_hour=900.0, duration=200.0, seed=3
    )
    return find_scenario(str(write_scenario(spec, demand, tmp_path / "made")))


def world_of(session: SumoSession) -> WorldState:
    return background_world(session.reader.read(), session.time, frozenset())


def first_at_red(session: SumoSession, signal_crossings: SignalCrossings) -> str:
    """Drive on until a car stands first at a red light; its id."""
    for _ in range(500):
        session.step()
        world = world_of(session)
        signal_crossings.update(world, world.ids)
        for vehicle in session.api.vehicle.getIDList():
            signal = session.api.vehicle.getNextTLS(vehicle)
            at_line = signal and signal[0][2] < 4.0 and signal[0][3] == "r"
            if at_line and session.api.vehicle.getSpeed(vehicle) < 0.1 and vehicle.startswith("passenger"):
                return str(vehicle)
    raise AssertionError("no car has come to a red light")


def test_sumos_own_road_users_run_no_red_light_and_pass_once_each(made: Scenario) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings = SignalCrossings(session.api, session.network)
        found = []
        through = set()
        for _ in range(500):
            session.step()
            world = world_of(session)
            found += signal_crossings.update(world, world.ids)
            for vehicle in session.api.vehicle.getIDList():
                if session.api.vehicle.getRoadID(vehicle).startswith("out"):
                    through.add(vehicle)
    wheels = [p for p in found if p.type != RoadUserType.PEDESTRIAN]
    walkers = [p for p in found if p.type == RoadUserType.PEDESTRIAN]
    assert len(walkers) > 10
    assert {p.lane.rsplit("_", 2)[1][0] for p in walkers} == {"c"}
    assert not [p for p in found if p.aspect == "red"]
    # A road user behind the junction has passed its signal, once.
    assert len(through) > 20
    times = Counter(p.road_user for p in wheels)
    assert through <= times.keys()
    assert set(times.values()) == {1}


@pytest.mark.parametrize("way", ["heedless", "moved on its lane", "moved beside every lane"])
def test_a_car_that_goes_at_red_is_one_run(made: Scenario, way: str) -> None:
    with SumoSession(made, seed=2) as session:
        api, signal_crossings = session.api, SignalCrossings(session.api, session.network)
        control = TakenOverControl(api, session.network)
        car = first_at_red(session, signal_crossings)
        lane = api.vehicle.getLaneID(car)
        if way == "heedless":
            api.vehicle.setSpeedMode(car, 0)
            api.vehicle.setSpeed(car, 8.0)
        else:
            control.take_over((car,), np.zeros(1, np.bool_))
        start = world_of(session)
        start = start.take(np.array([start.ids.index(car)]))
        found, distance = [], 0.0
        # Off to the left, while its route turns right: there the car is on no lane for SUMO.
        side = 12.0 if way == "moved beside every lane" else 0.0
        for step in range(16):
            if way != "heedless":
                distance += 8.0 * session.step_length
                c, s = np.cos(start.heading), np.sin(start.heading)
                aside = side * min(1.0, (step + 1) / 2.0)
                x, y = start.x + distance * c - aside * s, start.y + distance * s + aside * c
                speed = np.full(1, 8.0)
                control.move((car,), np.zeros(1, np.bool_), x, y, start.heading, speed, start.length)
            session.step()
            world = world_of(session)
            if car in world.ids:
                found += signal_crossings.update(world, (car,))
    assert [(p.road_user, p.aspect, p.lane) for p in found] == [(car, "red", lane)]


@pytest.mark.parametrize(
    ("before", "after", "aspect"), [("r", "G", "green"), ("y", "r", "yellow"), ("r", "r", "red"), ("G", "r", "green")]
)
def test_a_light_that_changes_in_the_step_of_the_passage_counts_as_the_more_permissive(
    made: Scenario, before: str, after: str, aspect: str
) -> None:
    with SumoSession(made, seed=2) as session:
        light, signal_crossings = session.api.trafficlight, SignalCrossings(session.api, session.network)
        car = first_at_red(session, signal_crossings)
        signal = light.getIDList()[0]
        size = len(light.getRedYellowGreenState(signal))
        light.setRedYellowGreenState(signal, before * size)
        session.api.vehicle.setSpeedMode(car, 0)
        session.api.vehicle.setSpeed(car, 0.0)
        session.step()
        assert signal_crossings.update(world_of(session), (car,)) == []
        light.setRedYellowGreenState(signal, after * size)
        session.api.vehicle.setSpeed(car, 15.0)
        session.step()
        assert [p.aspect for p in signal_crossings.update(world_of(session), (car,))] == [aspect]


def test_a_moved_car_that_stands_on_the_stop_line_passes_once(made: Scenario) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings, control = (
            SignalCrossings(session.api, session.network),
            TakenOverControl(session.api, session.network),
        )
        car = first_at_red(session, signal_crossings)
        world = world_of(session)
        control.take_over((car,), np.zeros(1, np.bool_))
        start = world.take(np.array([world.ids.index(car)]))
        found, lanes = [], []
        for distance in (4.0, 0.0, 4.0, 0.0, 4.0):
            x, y = start.x + distance * np.cos(start.heading), start.y + distance * np.sin(start.heading)
            control.move((car,), np.zeros(1, np.bool_), x, y, start.heading, np.zeros(1), start.length)
            session.step()
            lanes.append(session.api.vehicle.getLaneID(car))
            found += signal_crossings.update(world_of(session), (car,))
    assert [lane.startswith(":") for lane in lanes] == [True, False, True, False, True]
    assert [p.aspect for p in found] == ["red"]


def test_a_moved_car_that_stands_exactly_on_the_stop_line_has_not_passed(made: Scenario) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings, control = (
            SignalCrossings(session.api, session.network),
            TakenOverControl(session.api, session.network),
        )
        car = first_at_red(session, signal_crossings)
        line = session.api.vehicle.getNextTLS(car)[0][2]
        world = world_of(session)
        control.take_over((car,), np.zeros(1, np.bool_))
        start = world.take(np.array([world.ids.index(car)]))
        found = []
        for distance in (line + 0.05, line + 0.05, line + 2.0):
            x, y = start.x + distance * np.cos(start.heading), start.y + distance * np.sin(start.heading)
            control.move((car,), np.zeros(1, np.bool_), x, y, start.heading, np.zeros(1), start.length)
            session.step()
            assert session.api.vehicle.getLaneID(car).startswith(":"), "so SUMO has it"
            found.append([p.aspect for p in signal_crossings.update(world_of(session), (car,))])
    assert found == [[], [], ["red"]]


@pytest.mark.parametrize(
    ("route", "places", "aspects"),
    [
        # Before a turnaround it steers before the line, and SUMO has it on the lane of the turnaround.
        ("wc cw", ((-0.6, 1.0), (-0.5, 1.0), (0.8, 1.6), (1.2, 2.0)), [[], [], ["red"], []]),
        # The route ends at the line.
        ("wc", ((-0.6, 0.0), (1.5, 0.0), (4.0, 0.0)), [[], [], []]),
    ],
)
def test_only_a_car_whose_front_is_past_the_line_on_its_route_passes(
    route: str, places: tuple[tuple[float, float], ...], aspects: list[list[str]], tmp_path: Path
) -> None:
    ends = (("w", -100, 0), ("e", 100, 0), ("n", 0, 100))
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, x, y in ends)
    nodes += '<node id="c" x="0" y="0" type="traffic_light"/>'
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ("wc", "cw", "ce", "ec", "nc", "cn"))
    users = f'<route id="r" edges="{route}"/><vehicle id="car" route="r" depart="0" departPos="60" departSpeed="0"/>'
    with SumoSession(find_scenario(str(make_scenario(tmp_path, nodes, edges, users))), seed=1) as session:
        api, control = session.api, TakenOverControl(session.api, session.network)
        crossings = SignalCrossings(api, session.network)
        api.trafficlight.setRedYellowGreenState("c", "r" * len(api.trafficlight.getRedYellowGreenState("c")))
        session.step()
        assert crossings.update(world_of(session), ("car",)) == []
        control.take_over(("car",), np.zeros(1, np.bool_))
        end_x, end_y = next(lane for lane in session.network.lanes if lane.id == "wc_0").shape[-1]
        found, lanes = [], []
        for ahead, aside in places:
            # The centre of the car, 5 m long.
            x, y = np.array([end_x + ahead - 2.5]), np.array([end_y + aside])
            control.move(("car",), np.zeros(1, np.bool_), x, y, np.zeros(1), np.full(1, 0.6), np.full(1, 5.0))
            session.step()
            lanes.append(api.vehicle.getLaneID("car"))
            found.append([p.aspect for p in crossings.update(world_of(session), ("car",))])
    assert lanes[0].startswith(":") == (route == "wc cw"), "so SUMO has it"
    assert found == aspects


def test_a_turn_beside_the_signal_is_no_passage(game: Path) -> None:
    # Bicycles turn right there without a signal, while the rest of their lane has red.
    with SumoSession(find_scenario(str(game / "fkk_in.sumocfg")), seed=1) as session:
        signal_crossings = SignalCrossings(session.api, session.network)
        found, turned = [], False
        for _ in range(100):
            session.step()
            world = world_of(session)
            found += signal_crossings.update(world, world.ids)
            turned |= "4_right.0" in world.ids and session.api.vehicle.getLaneID("4_right.0") == ":gneJ21_0_0"
    assert turned
    assert len(found) > 2
    assert "4_right.0" not in {p.road_user for p in found if p.lane == "30399663#1_1"}


def test_the_same_car_held_until_green_is_none(made: Scenario) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings = SignalCrossings(session.api, session.network)
        car = first_at_red(session, signal_crossings)
        found = []
        for _ in range(300):
            session.step()
            found += signal_crossings.update(world_of(session), (car,))
            if found:
                break
    assert [p.aspect for p in found] == ["green"]


def test_a_person_that_waits_at_the_kerb_has_not_gone_and_one_that_walks_has(made: Scenario) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings = SignalCrossings(session.api, session.network)
        crossing = next(lane for lane in session.network.lanes if lane.id == ":centre_c0_0")
        signal, index = next(
            (signal, i)
            for signal in session.api.trafficlight.getIDList()
            for i, links in enumerate(session.api.trafficlight.getControlledLinks(signal))
            if any(link[1] == crossing.id for link in links)
        )
        a, b = crossing.shape[0], crossing.shape[-1]
        along = (b - a) / np.hypot(*(b - a))
        session.step()
        world = world_of(session)
        while session.api.trafficlight.getRedYellowGreenState(signal)[index] != "r" or not len(world):
            session.step()
            world = world_of(session)
            signal_crossings.update(world, ())

        def at(metres: float) -> WorldState:
            x, y = a + metres * along
            return make_world(x, y, speed=1.0, type=RoadUserType.PEDESTRIAN, ids=("person",), time=session.time)

        def go(metres: float) -> list[str]:
            return [p.aspect for p in signal_crossings.update(at(metres), ("person",))]

        assert [go(metres) for metres in (-3.0, -0.5, 0.4, 0.4, -0.2)] == [[]] * 5
        assert [go(metres) for metres in (0.5, 1.2, 2.0, 1.2, 0.5, -1.0, 2.0)] == [[], ["red"], [], [], [], [], []]
        # Gone and come again.
        assert [go(metres) for metres in (-3.5, 2.0)] == [[], ["red"]]


@pytest.mark.parametrize(("off", "aspect"), [(True, "green"), (False, "red")])
def test_a_person_that_leaves_the_walking_area_at_green_may_reach_the_crossing_at_red(
    made: Scenario, off: bool, aspect: str
) -> None:
    with SumoSession(made, seed=2) as session:
        signal_crossings = SignalCrossings(session.api, session.network)
        crossing = next(one for one in signal_crossings._crossings if one.lane == ":centre_c0_0")
        (x, y), step = crossing.line[0], crossing.line[-1] - crossing.line[0]
        along = step / np.hypot(*step)
        # Beyond the kerb, and not yet on the crossing.
        ahead = -np.arange(0.05, 3.0, 0.05)[:, None] * along
        aside = np.arange(-0.9, 1.0, 0.1)[:, None, None] * crossing.half_width * np.array([-along[1], along[0]])
        places = (np.array([x, y]) + ahead + aside).reshape(-1, 2)
        away = np.min([np.abs(distance_to(one, places)) for one in crossing.walking_areas], axis=0)
        inside = np.any([distance_to(one, places) <= 0.0 for one in crossing.walking_areas], axis=0)
        place = places[np.argmax(np.where(inside != off, away, -1.0))]
        signal, index = crossing.link.signal, crossing.link.index

        def go(to: Floats) -> list[str]:
            world = make_world(*to, speed=1.0, type=RoadUserType.PEDESTRIAN, ids=("person",), time=session.time)
            return [p.aspect for p in signal_crossings.update(world, ("person",))]

        def wait_for(states: str) -> None:
            session.step()
            while session.api.trafficlight.getRedYellowGreenState(signal)[index] not in states:
                session.step()

        wait_for("G")
        go(place)
        while session.api.trafficlight.getRedYellowGreenState(signal)[index] == "G":
            assert go(place) == []
            session.step()
        # It is seen where it is in each step.
        assert go(place) == []
        session.step()
        assert go(place) == []
        assert go(crossing.line[0] + 2.0 * along) == [aspect]


def test_a_ribbon_has_straight_ends_and_a_shortened_line_keeps_its_corner() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    x, y = np.array([5.0, 5.0, -1.0, 10.0, 10.0, 13.0]), np.array([1.0, 3.0, 0.0, 9.0, 12.0, 0.0])
    assert outside_by(x, y, line, 2.0) == pytest.approx([-1.0, 1.0, 1.0, -1.0, 2.0, 1.0])
    assert shortened(line, 4.0).tolist() == [[4.0, 0.0], [10.0, 0.0], [10.0, 6.0]]
    assert shortened(line[:2], 9.0) == pytest.approx(np.array([[10.0 / 3.0, 0.0], [20.0 / 3.0, 0.0]]))
