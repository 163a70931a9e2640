"""The driver `lane` takes road users home as SUMO's own do: in their lane, by the signals, without contacts."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_world

from slrl_sumo.agent.lane_baseline.lane_driver import LaneDriver
from slrl_sumo.scene.geometry import boxes_overlap, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl

DT = 0.4


def _world(snapshot: Snapshot, rows: list[int], time: float) -> WorldState:
    names = ("type", "x", "y", "heading", "speed", "length", "width")
    columns = {name: getattr(snapshot, name)[rows] for name in names}
    return make_world(**columns, ids=[snapshot.ids[i] for i in rows], time=time)


class Ride:
    """Some road users of an open session, driven by `lane` from now on, one SUMO step per decision."""

    def __init__(self, session: SumoSession, wanted: Callable[[str], bool]) -> None:
        assert session.substeps == 1
        self.session, self.wanted = session, wanted
        self.control, self.driver = TakenOverControl(libsumo, session.network), LaneDriver(libsumo, session.network)
        self.learned = _world(session.reader.read(), [], session.time)
        self.others = self.learned
        self.back: set[str] = set()
        self.arrived: dict[str, str] = {}
        self.road: dict[str, str] = {}
        self.collect()

    def collect(self) -> None:
        """Take over the requested road users that are not yet taken over, and read the rest."""
        snapshot = self.session.reader.read()
        own = set(self.learned.ids)
        rows = [i for i, r in enumerate(snapshot.ids) if self.wanted(r) and r not in own and r not in self.back | own]
        obstacles = self.control.obstacles([snapshot.ids[i] for i in rows], snapshot.person[rows], models=False)
        rows = [i for i, why in zip(rows, obstacles, strict=True) if not why]
        self.control.take_over([snapshot.ids[i] for i in rows], snapshot.person[rows])
        self.learned = replace(self.learned.join(_world(snapshot, rows, self.session.time)), time=self.session.time)
        own = set(self.learned.ids)
        rest = [i for i, r in enumerate(snapshot.ids) if r not in own]
        self.others = _world(snapshot, rest, self.session.time)
        for road_user, lane in zip(snapshot.ids, snapshot.lane, strict=True):
            if lane and not lane.startswith(":"):
                self.road[road_user] = lane

    def step(self) -> WorldState:
        """One decision; those near their destination go back to SUMO. The learned before the step."""
        before = self.learned
        following = self.driver.moved(before.join(self.others), len(before), DT)
        walking = following.type == RoadUserType.PEDESTRIAN
        f = following
        self.control.move(f.ids, walking, f.x, f.y, f.heading, f.speed, f.length)
        self.session.step()
        for road_user in (*libsumo.simulation.getArrivedIDList(), *libsumo.simulation.getArrivedPersonIDList()):
            self.arrived[road_user] = self.road.get(road_user, "")
        present = {*libsumo.vehicle.getIDList(), *libsumo.person.getIDList()}
        gone = [r for r in f.ids if r not in present]
        self.control.abandon(gone)
        rows = np.flatnonzero(self.driver.near_end(f.ids) & np.array([r in present for r in f.ids], np.bool_))
        done = rows[self.control.hand_back([f.ids[i] for i in rows], walking[rows])]
        self.back |= {f.ids[i] for i in done} | set(gone)
        self.driver.forget(tuple(f.ids[i] for i in done))
        self.learned = f.take(np.array([i for i, r in enumerate(f.ids) if r not in self.back], np.intp))
        self.collect()
        return before

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.step()


@contextmanager
def opened(name: str | Path, step_length: float = DT) -> Iterator[SumoSession]:
    with SumoSession(find_scenario(str(name)), step_length=step_length) as session:
        yield session


@pytest.fixture
def intersection() -> Iterator[SumoSession]:
    with opened("intersection") as session:
        yield session


def _stop_traffic(*keep: str) -> None:
    for domain in (libsumo.vehicle, libsumo.person):
        for road_user in domain.getIDList():
            if road_user not in keep:
                domain.remove(road_user)


def _add_car(
    session: SumoSession, edges: tuple[str, ...], name: str = "car", vtype: str = "passenger1", at: str = "0"
) -> None:
    libsumo.route.add(f"route of {name}", list(edges))
    libsumo.vehicle.add(name, f"route of {name}", typeID=vtype, departLane="best", departPos=at, departSpeed="5")
    for _ in range(20):
        session.step()
        if libsumo.vehicle.getLaneID(name):
            return
    raise AssertionError("SUMO did not insert the car")


def test_a_car_goes_its_route_in_its_lane_within_its_limits(intersection: SumoSession) -> None:
    _add_car(intersection, ("in0", "out3"))
    _stop_traffic("car")
    accel, decel = libsumo.vehicle.getAccel("car"), libsumo.vehicle.getDecel("car")
    limit = libsumo.lane.getMaxSpeed("in0_2") * libsumo.vehicle.getSpeedFactor("car")
    lanes = {lane.id: lane for lane in intersection.network.lanes}
    ride = Ride(intersection, lambda r: r == "car")
    speeds, beside = [], []
    for _ in range(100):
        if not len(ride.learned):
            break
        before = ride.step()
        _stop_traffic("car")
        after = ride.learned
        if len(after) and len(before):
            moved = math.hypot(after.x[0] - before.x[0], after.y[0] - before.y[0])
            assert after.speed[0] == pytest.approx(moved / DT, abs=1e-9)
            assert after.acceleration[0] == pytest.approx((after.speed[0] - before.speed[0]) / DT, abs=1e-9)
            # The box moves the way it points: no sliding.
            towards = math.atan2(after.y[0] - before.y[0], after.x[0] - before.x[0])
            if moved > 0.5:
                assert abs(float(wrap_angle(towards - after.heading[0]))) < 0.35
            speeds.append(float(after.speed[0]))
            lane = libsumo.vehicle.getLaneID("car")
            assert lane in lanes
            beside.append(abs(libsumo.vehicle.getLateralLanePosition("car")))
    # Centres cut corners a little, so that their speed changes a little faster than that of the front.
    assert max(np.diff(speeds)) / DT < accel + 0.8
    assert min(np.diff(speeds)) / DT > -decel - 0.8
    assert 0.8 * limit < max(speeds) <= limit + 1e-6
    assert max(beside) < 0.3
    for _ in range(20):
        intersection.step()
        if "car" in libsumo.simulation.getArrivedIDList():
            break
    else:
        raise AssertionError("the car did not arrive")
    assert ride.road["car"].startswith("out3")
    assert (ride.back, ride.control.ids) == ({"car"}, frozenset())


def test_a_car_waits_at_red_and_goes_at_green() -> None:
    with opened("signalised") as session:
        _add_car(session, ("in0", "out2"))
        _stop_traffic("car")
        light = libsumo.trafficlight.getIDList()[0]
        links = len(libsumo.trafficlight.getRedYellowGreenState(light))
        libsumo.trafficlight.setRedYellowGreenState(light, "r" * links)
        ride = Ride(session, lambda r: r == "car")
        for _ in range(200):
            ride.step()
            _stop_traffic("car")
        assert libsumo.vehicle.getRoadID("car") == "in0"
        left = libsumo.lane.getLength(libsumo.vehicle.getLaneID("car")) - libsumo.vehicle.getLanePosition("car")
        assert 0.5 < left < 3.0
        assert ride.learned.speed[0] < 0.05
        libsumo.trafficlight.setRedYellowGreenState(light, "G" * links)
        for _ in range(75):
            ride.step()
            _stop_traffic("car")
        assert "car" in ride.back


def test_a_car_stops_behind_a_standing_one_and_for_a_person_unknown_to_sumo(intersection: SumoSession) -> None:
    _add_car(intersection, ("in0", "out2"), "first", at="40")
    _add_car(intersection, ("in0", "out2"))
    _stop_traffic("car", "first")
    libsumo.vehicle.setSpeed("first", 0.0)
    ride = Ride(intersection, lambda r: r == "car")
    for _ in range(60):
        ride.step()
        _stop_traffic("car", "first")
    gap = libsumo.vehicle.getLeader("car", 50.0)[1] + libsumo.vehicle.getMinGap("car")
    assert ride.learned.speed[0] < 0.05
    assert 0.5 < gap < 4.0
    libsumo.vehicle.setSpeed("first", -1.0)
    # The same with a road user unknown to SUMO, 25 m further on.
    x, y, heading = float(ride.learned.x[0]), float(ride.learned.y[0]), float(ride.learned.heading[0])
    stranger = replace(
        ride.learned,
        ids=("stranger",),
        type=np.array([RoadUserType.PEDESTRIAN], np.int8),
        x=np.array([x + 25.0 * math.cos(heading)]),
        y=np.array([y + 25.0 * math.sin(heading)]),
        speed=np.zeros(1),
        length=np.array([0.3]),
        width=np.array([0.5]),
    )
    for _ in range(40):
        ride.others = ride.others.join(stranger)
        ride.step()
        _stop_traffic("car", "first")
    driven = math.hypot(ride.learned.x[0] - x, ride.learned.y[0] - y)
    front = driven + 0.5 * float(ride.learned.length[0])
    assert ride.learned.speed[0] < 0.05
    assert 21.0 < front < 25.0


def test_a_car_changes_gently_to_the_lane_that_its_route_needs(game: Path) -> None:
    with opened(game / "cross.sumocfg") as session:
        libsumo.trafficlight.setRedYellowGreenState("0", "G" * 12)
        libsumo.route.add("left turn", ["1si", "4o", "4fo"])
        libsumo.vehicle.add("car", "left turn", typeID="passenger", departLane="0", departPos="20", departSpeed="8")
        session.step()
        _stop_traffic("car")
        assert libsumo.vehicle.getLaneID("car") == "1si_0"
        wanted = {target.rpartition("_")[0] for target, *_ in libsumo.lane.getLinks("1si_0")}
        assert "4o" not in wanted
        ride = Ride(session, lambda r: r == "car")
        start, end = np.array(libsumo.lane.getShape("1si_0"))[[0, -1]]
        along = (end - start) / np.hypot(*(end - start))
        across: list[float] = []
        lanes: list[str] = []
        for _ in range(100):
            ride.step()
            _stop_traffic("car")
            if not len(ride.learned):
                break
            if libsumo.vehicle.getRoadID("car") == "1si":
                across.append(float(along[0] * ride.learned.y[0] - along[1] * ride.learned.x[0]))
                lanes.append(libsumo.vehicle.getLaneID("car"))
        assert lanes[-1] == "1si_2"
        # Fronts slide 1.5 m/s at most; centres go a bit further where the box turns.
        assert 0.8 < np.abs(np.diff(across)).max() / DT < 2.0
        assert ride.back == {"car"}
        assert ride.road["car"].startswith("4fo")


def test_all_cars_of_a_junction_arrive_where_they_wanted_to_go(game: Path) -> None:
    with opened(game / "cross.sumocfg") as session:
        goals: dict[str, str] = {}
        ride = Ride(session, lambda r: True)
        for step in range(450):
            ride.step()
            if step % 75 == 0:
                # The game's signals wait for its player.
                libsumo.trafficlight.setPhase("0", (libsumo.trafficlight.getPhase("0") + 1) % 12)
            for road_user in ride.learned.ids:
                goals.setdefault(road_user, libsumo.vehicle.getRoute(road_user)[-1])
        taken = {r: lane for r, lane in ride.arrived.items() if r in goals}
        assert len(taken) > 40
        assert {r: lane.rpartition("_")[0] for r, lane in taken.items()} == {r: goals[r] for r in taken}
        # None is lost: road users that are gone have arrived.
        present = set(libsumo.vehicle.getIDList())
        assert set(goals) - present == set(taken)


def test_cars_among_each_other_hardly_touch(intersection: SumoSession) -> None:
    ride = Ride(intersection, lambda r: not r.startswith("pedestrian"))
    met = 0
    for _ in range(750):
        ride.step()
        world = ride.learned
        if len(world) < 2:
            continue
        boxes = np.column_stack([world.x, world.y, world.heading, world.length - 0.2, world.width - 0.2])
        a, b = np.triu_indices(len(world), 1)
        met += int(boxes_overlap(boxes[a], boxes[b]).sum())
    assert len(ride.arrived) > 30
    assert met == 0


def test_walkers_keep_their_pace_and_reach_their_own_destinations(intersection: SumoSession) -> None:
    ride = Ride(intersection, lambda r: r.startswith("pedestrian"))
    goals: dict[str, tuple[float, float]] = {}
    last: dict[str, tuple[float, float]] = {}
    seen = set(libsumo.person.getIDList())
    fastest: dict[str, float] = {}
    for _ in range(1000):
        for road_user in set(libsumo.person.getIDList()) - seen:
            edge, along = libsumo.person.getEdges(road_user)[-1], libsumo.person.getStage(road_user).arrivalPos
            goals[road_user] = libsumo.simulation.convert2D(edge, along, 0)[:2]
        seen |= set(goals)
        before = ride.step()
        for road_user, speed in zip(before.ids, before.speed.tolist(), strict=True):
            if before.time > 0.0:
                fastest[road_user] = max(fastest.get(road_user, 0.0), speed)
        last.update({r: libsumo.person.getPosition(r)[:2] for r in libsumo.person.getIDList()})
    finished = {r: last[r] for r in ride.arrived if r in goals and r in ride.back}
    assert len(finished) > 10
    assert set(goals) - set(libsumo.person.getIDList()) == set(finished)
    assert max(math.dist(place, goals[r]) for r, place in finished.items()) < 3.0
    own_pace = {r: libsumo.person.getMaxSpeed(r) for r in ride.learned.ids}
    assert own_pace
    assert all(fastest[r] <= pace + 0.2 for r, pace in own_pace.items() if r in fastest)


def test_walkers_wait_at_red_crossings() -> None:
    with opened("signalised") as session:
        light = libsumo.trafficlight.getIDList()[0]
        links = len(libsumo.trafficlight.getRedYellowGreenState(light))
        libsumo.trafficlight.setRedYellowGreenState(light, "r" * links)
        ride = Ride(session, lambda r: r.startswith("pedestrian"))
        crossings = [lane for lane in session.network.lanes if "_c" in lane.id and lane.internal]
        for _ in range(1100):
            ride.step()
        world = ride.learned
        standing = world.speed < 0.01
        assert standing.sum() >= 3
        # SUMO's own walkers start on sidewalks as ours do, so that none can be on the carriageway.
        for lane in crossings:
            middle = 0.5 * (lane.shape[0] + lane.shape[-1])
            away = np.hypot(world.x - middle[0], world.y - middle[1])
            assert (away > 0.5 * lane.length - 0.5).all()


def test_what_we_added_goes_on_at_random_the_same_in_every_run() -> None:
    def track() -> list[tuple[float, float]]:
        with opened("district") as session:
            lane = next(i for i in session.network.lanes if "passenger" in i.allowed and i.length > 60.0)
            start, end = lane.shape[0], lane.shape[-1]
            heading = math.atan2(end[1] - start[1], end[0] - start[0])
            walk = next(i for i in session.network.lanes if "pedestrian" in i.allowed and i.length > 60.0)
            middle = walk.shape.mean(axis=0)
            state = make_world(
                [start[0] + 10.0 * math.cos(heading), middle[0]],
                [start[1] + 10.0 * math.sin(heading), middle[1]],
                [heading, 0.0],
                [5.0, 1.0],
                type=[RoadUserType.CAR, RoadUserType.PEDESTRIAN],
                ids=("learned_car.0", "learned_pedestrian.0"),
                time=session.time,
            )
            driver = LaneDriver(libsumo, session.network)
            session.spawned.add(state.ids, state.type, state.x, state.y)
            places = []
            for _ in range(300):
                session.spawned.move(state.ids, state.type, state.x, state.y, state.heading, state.speed, state.length)
                session.step()
                state = driver.moved(state, len(state), DT)
                places += [(float(state.x[0]), float(state.y[0])), (float(state.x[1]), float(state.y[1]))]
            assert driver.near_end(state.ids).tolist() == [False, False]
            return places

    first = track()
    cars, walkers = np.array(first[::2]), np.array(first[1::2])
    assert first == track()
    # Two minutes: the car is over several junctions, the walker has gone more than a block, and neither ever jumps.
    assert np.hypot(*np.diff(cars, axis=0).T).max() < 25.0 * DT
    assert np.hypot(*np.diff(cars, axis=0).T).sum() > 400.0
    assert np.hypot(*np.diff(walkers, axis=0).T).max() < 2.0 * DT
    assert np.hypot(*np.diff(walkers, axis=0).T).sum() > 100.0
