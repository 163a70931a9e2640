"""Background vehicles brake for learned road users, and drive on as before afterwards."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_world
from numpy.typing import NDArray

from netgen.scenario import scenario_files
from netgen.specs import DemandSpec, IntersectionSpec
from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.yielding import MOMENTS, STOP_SHORT, Yielding, safe_speeds
from slrl_sumo.scene.geometry import boxes_overlap
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

STEP = 0.4
NORTH, SOUTH = np.pi / 2, -np.pi / 2
CAR = "car"
ROUTES = """<routes>
    <vType id="c" vClass="passenger" sigma="0" speedDev="0"/>
    <vehicle id="car" type="c" depart="0" departSpeed="max" departLane="best"><route edges="in3 out1"/></vehicle>
</routes>"""
LIMIT = 13.89
NEVER, ALWAYS = np.full((1, len(MOMENTS)), np.inf), np.full((1, len(MOMENTS)), 20.0)
LIMITS = np.array([[2.6, 4.5, 9.0]])
"""m/s²: acceleration, deceleration, emergency deceleration of SUMO's passenger cars."""


def one_speed(enter: float, speed: float, leading: float = 0.0) -> tuple[float, bool]:
    first = NEVER.copy()
    first[0, 0] = enter
    target, hard = safe_speeds(first, first + 5.0, np.array([speed]), np.full_like(first, leading), LIMITS, STEP)
    return float(target[0]), bool(hard[0])


def stopped_after(enter: float, speed: float, decelerations: list[float] | None = None) -> float:
    """How far a vehicle drives that takes the safe speed of every step (SUMO's way of stepping)."""
    driven = 0.0
    while speed > 0.01:
        following = min(one_speed(enter - driven, speed)[0], speed)
        if decelerations is not None:
            decelerations.append((speed - following) / STEP)
        speed = following
        driven += speed * STEP
    return driven


def test_nothing_in_the_way_sets_no_speed() -> None:
    assert one_speed(np.inf, 10.0) == (np.inf, False)


def test_safe_speeds_stop_short_of_obstacles_and_brake_comfortably_where_there_is_room() -> None:
    decelerations: list[float] = []
    driven = stopped_after(40.0, 13.9, decelerations)
    assert 40.0 - STOP_SHORT - 0.6 < driven <= 40.0 - STOP_SHORT + 1e-6
    assert max(decelerations) <= 4.5 + 1e-6


@pytest.mark.parametrize("gap", [13.0, 17.0, 20.0])
def test_they_brake_harder_only_where_that_is_needed_and_no_harder_than_the_vehicle_can(gap: float) -> None:
    decelerations: list[float] = []
    assert stopped_after(gap, 13.9, decelerations) <= gap
    assert 4.5 < max(decelerations) <= 9.0 + 1e-6


def test_without_room_they_brake_as_hard_as_the_vehicle_can() -> None:
    speed, hard = one_speed(3.0, 13.9)
    assert speed == pytest.approx(13.9 - 9.0 * STEP)
    assert hard


def test_a_leader_that_drives_away_may_be_followed() -> None:
    standing, _ = one_speed(15.0, 10.0)
    behind, _ = one_speed(15.0, 10.0, leading=8.0)
    assert standing < behind
    assert one_speed(STOP_SHORT + 8.0 * STEP, 8.0, leading=8.0)[0] == pytest.approx(8.0)


def test_a_road_user_gone_before_the_vehicle_comes_is_no_reason_to_brake() -> None:
    enter = NEVER.copy()
    enter[0, 1:3] = 30.0
    args = np.array([5.0]), np.zeros_like(enter), LIMITS, STEP
    assert safe_speeds(enter, enter + 6.0, *args)[0][0] == np.inf
    # ... but a road user that stays is one as soon as the distance asks for it.
    enter[0, -1] = 2.0
    assert safe_speeds(enter, enter + 6.0, *args)[0][0] < 5.0


def test_a_road_user_that_comes_after_the_vehicle_is_no_reason_to_brake() -> None:
    enter = NEVER.copy()
    enter[0, -1] = 2.0
    args = np.zeros_like(enter), LIMITS, STEP
    # At 10 m/s the rear is past after 0.8 s, long before the last moment.
    assert safe_speeds(enter, enter + 6.0, np.array([10.0]), *args)[0][0] == np.inf
    assert safe_speeds(enter, enter + 6.0, np.array([4.0]), *args)[0][0] < 4.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("yielding")
    files = scenario_files(IntersectionSpec(arm_length=150.0), DemandSpec(), "one")
    for name, content in {**files, "one.rou.xml": ROUTES.encode()}.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def session(folder: Path) -> Iterator[SumoSession]:
    with SumoSession(find_scenario(str(folder)), step_length=STEP) as session:
        yield session


Pose = tuple[float, float, float]


class Scene:
    """One car on its way north along x = `x`, and one learned road user beside or on its way."""

    def __init__(self, session: SumoSession, kind: RoadUserType, yields: bool = True) -> None:
        self.session, self.kinds, self.ids = session, np.array([kind], np.int8), ("learned.0",)
        shape = next(lane.shape for lane in session.network.lanes if lane.id == "in3_2")
        self.x, self.y = float(shape[0, 0]), float(shape[:, 1].mean())
        self.yielding = Yielding(session.api, session.network, STEP)
        self._yields = yields
        # On the sidewalk of another street, so that SUMO does not have it on the edge of the car.
        side = next(lane.shape for lane in session.network.lanes if lane.id == "in2_0").mean(axis=0)
        self.home = float(side[0]), float(side[1]), 0.0
        session.spawned.add(self.ids, self.kinds, np.array([self.home[0]]), np.array([self.home[1]]))
        self.speeds: list[float] = []
        self.distances: list[float] = []
        self.overlap = False
        self.snapshot = session.reader.read()

    def step(self, pose: Pose, speed: float = 0.0) -> None:
        """One SUMO step, with the learned road user at a pose (x, y, heading)."""
        user = self.world(pose, speed)
        if self._yields:
            self.yielding.apply(self.snapshot, user)
        self.session.spawned.move(self.ids, self.kinds, user.x, user.y, user.heading, user.speed, user.length)
        self.session.step()
        self.snapshot = self.session.reader.read()
        if CAR in self.snapshot.ids:
            row = self.snapshot.ids.index(CAR)
            car = box(self.snapshot, row)
            here = np.array([[*pose, float(user.length[0]), float(user.width[0])]])
            self.overlap |= bool(boxes_overlap(car, here)[0])
            self.speeds.append(float(self.snapshot.speed[row]))
            self.distances.append(self.y - float(self.snapshot.y[row]) - 0.5 * float(self.snapshot.length[row]))

    def world(self, pose: Pose, speed: float) -> WorldState:
        return make_world(*pose, speed, type=self.kinds, ids=self.ids)

    def stand(self, pose: Pose, seconds: float) -> None:
        # A person can only be brought to another edge after it has departed.
        for k in range(round(seconds / STEP)):
            self.step(self.home if k < 2 else pose)

    def decelerations(self) -> NDArray[np.float64]:
        return -np.diff(self.speeds) / STEP


def box(snapshot: Snapshot, row: int) -> NDArray[np.float64]:
    values = snapshot.x, snapshot.y, snapshot.heading, snapshot.length, snapshot.width
    return np.array([[float(value[row]) for value in values]])


@pytest.mark.parametrize("beside", [0.0, 0.9])
def test_a_person_on_the_lane_is_run_over_without_yielding(session: SumoSession, beside: float) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN, yields=False)
    scene.stand((scene.x + beside, scene.y, 0.0), 20.0)
    assert scene.overlap


@pytest.mark.parametrize("beside", [0.0, 0.9, -0.9])
def test_a_car_stops_for_a_person_in_the_middle_or_at_the_edge_of_its_lane(session: SumoSession, beside: float) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN)
    scene.stand((scene.x + beside, scene.y, 0.0), 20.0)
    assert not scene.overlap
    assert scene.speeds[-1] < 0.1
    assert 0.5 * STOP_SHORT < scene.distances[-1] < 3.0
    assert scene.yielding.held == {CAR}
    assert scene.yielding.interventions == 1
    # There was room: nothing but ordinary braking.
    assert scene.decelerations().max() < 4.6


def test_a_learned_car_at_the_lanes_edge_is_not_driven_into(session: SumoSession) -> None:
    scene = Scene(session, RoadUserType.CAR)
    scene.stand((scene.x + 1.6, scene.y, NORTH), 20.0)
    assert not scene.overlap
    assert scene.speeds[-1] < 0.1


@pytest.mark.parametrize("yields", [True, False])
def test_a_crossing_pedestrian_is_let_pass(session: SumoSession, yields: bool) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN, yields=yields)
    walked = 0.0
    for _ in range(60):
        # So that both would be at the same place at the same time.
        if scene.distances and scene.distances[-1] < 57.0:
            walked += 1.3 * STEP
        scene.step((scene.x + 5.4 - walked, scene.y, np.pi), 1.3 if walked else 0.0)
    assert scene.overlap != yields
    # After that it goes on.
    assert scene.yielding.held == frozenset()
    assert scene.speeds[-1] > 8.0
    assert (scene.yielding.interventions > 0) == yields
    assert scene.decelerations().max() <= 9.0 + 1e-6


@pytest.mark.parametrize(
    ("kind", "beside", "heading"),
    [
        (RoadUserType.CAR, -3.2, SOUTH),
        (RoadUserType.BICYCLE, 2.35, NORTH),
        (RoadUserType.PEDESTRIAN, 4.1, NORTH),
        (RoadUserType.PEDESTRIAN, 3.2, 0.0),
    ],
    ids=["opposite lane", "cycle lane", "sidewalk", "kerb"],
)
def test_a_road_user_beside_the_path_does_not_slow_it(
    session: SumoSession, kind: RoadUserType, beside: float, heading: float
) -> None:
    scene = Scene(session, kind)
    scene.stand((scene.x + beside, scene.y, heading), 10.0)
    assert min(scene.distances) < -10.0
    assert scene.yielding.interventions == 0
    assert min(scene.speeds) > LIMIT - 0.1


def test_a_released_car_has_its_own_speed_mode_and_drives_on(session: SumoSession) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN)
    for _ in range(2):
        scene.step(scene.home)
    session.api.vehicle.setSpeedMode(CAR, 23)
    while scene.distances[-1] > 18.0:
        scene.step(scene.home)
    # It appears so near that only hard braking helps, for which the mode has to change.
    modes = set()
    for _ in range(20):
        scene.step((scene.x, scene.y, 0.0))
        modes.add(session.api.vehicle.getSpeedMode(CAR))
    assert not scene.overlap
    assert 4.6 < scene.decelerations().max() <= 9.0 + 1e-6
    assert 23 & ~4 in modes
    assert scene.speeds[-1] < 0.1
    for _ in range(20):
        scene.step(scene.home)
    assert session.api.vehicle.getSpeedMode(CAR) == 23
    assert scene.yielding.held == frozenset()
    assert scene.speeds[-1] > LIMIT - 0.1


def held_car(session: SumoSession) -> tuple[Scene, Pose]:
    scene = Scene(session, RoadUserType.PEDESTRIAN)
    pose = (scene.x, scene.y, 0.0)
    scene.stand(pose, 20.0)
    assert scene.yielding.held == {CAR}
    return scene, pose


def test_release_gives_all_back(session: SumoSession) -> None:
    scene, pose = held_car(session)
    scene.yielding.release()
    assert scene.yielding.held == frozenset()
    # Yielding is over: the person's presence no longer holds the car.
    scene._yields = False
    for _ in range(15):
        scene.step(pose)
    assert scene.speeds[-1] > 5.0


def test_a_held_vehicle_that_has_gone_is_forgotten(session: SumoSession) -> None:
    scene, pose = held_car(session)
    session.api.vehicle.remove(CAR)
    scene.snapshot = session.reader.read()
    scene.step(pose)
    assert CAR not in scene.snapshot.ids
    assert scene.yielding.held == frozenset()


def test_vehicles_that_are_ours_are_never_touched(session: SumoSession) -> None:
    scene, pose = held_car(session)
    calls: list[str] = []
    setting: Callable[..., None] = session.api.vehicle.setSpeed
    person = scene.world(pose, 0.0)
    both = person.join(replace(person, ids=(CAR,)))
    with pytest.MonkeyPatch.context() as patch:

        def noted(vehicle: str, speed: float) -> None:
            calls.append(vehicle)
            setting(vehicle, speed)

        patch.setattr(session.api.vehicle, "setSpeed", noted)
        scene.yielding.apply(scene.snapshot, both)
        assert scene.yielding.held == frozenset()
        scene.yielding.apply(scene.snapshot, both)
        assert calls == []
        scene.yielding.apply(scene.snapshot, person)
        assert calls == [CAR]


def test_ways_are_sampled_closer_than_the_distance_kept() -> None:
    assert SPACING < STOP_SHORT
