"""Background vehicles brake for learned road users, and drive on as before afterwards."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_world
from numpy.typing import NDArray

from slrl_sumo.background.lane_paths import SPACING
from slrl_sumo.background.safe_speed import STOP_SHORT
from slrl_sumo.background.yielding import LONGEST_VEHICLE_WAIT, Yielding
from slrl_sumo.netgen.scenario import scenario_files
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.geometry import boxes_overlap
from slrl_sumo.scene.route import HERE, POINTS, RouteAhead
from slrl_sumo.scene.route import SPACING as SPACING_OF_PATHS
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.speed_control import DISREGARDS_INSIDE_BIT

STEP = 0.4
NORTH, SOUTH, WEST = np.pi / 2, -np.pi / 2, np.pi
CAR = "car"
ROUTES = """<routes>
    <vType id="c" vClass="passenger" sigma="0" speedDev="0"/>
    <vehicle id="car" type="c" depart="0" departSpeed="max" departLane="best"><route edges="in3 out1"/></vehicle>
</routes>"""
LIMIT = 13.89


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

    def __init__(
        self,
        session: SumoSession,
        kind: RoadUserType,
        yields: bool = True,
        width: float | None = None,
        exclude: tuple[str, ...] = (),
    ) -> None:
        self._width = width
        self.session, self.kinds, self.ids = session, np.array([kind], np.int8), ("learned.0",)
        shape = next(lane.shape for lane in session.network.lanes if lane.id == "in3_2")
        self.x, self.y = float(shape[0, 0]), float(shape[:, 1].mean())
        self.yielding = Yielding(session.api, session.network, STEP, exclude)
        self._yields = yields
        # On the sidewalk of another street, so that SUMO does not have it on the edge of the car.
        side = next(lane.shape for lane in session.network.lanes if lane.id == "in2_0").mean(axis=0)
        self.home = float(side[0]), float(side[1]), 0.0
        session.spawned.add(self.ids, self.kinds, np.array([self.home[0]]), np.array([self.home[1]]))
        self.speeds: list[float] = []
        self.distances: list[float] = []
        self.overlap = False
        self.snapshot = session.reader.read()

    def step(self, pose: Pose, speed: float = 0.0, yaw_rate: float = 0.0, path: float | None = None) -> None:
        """One SUMO step, with the learned road user at a pose (x, y, heading), on a straight path in direction `path`
        (rad; None: without a route)."""
        user = replace(self.world(pose, speed), yaw_rate=np.array([yaw_rate]))
        context = None
        if path is not None:
            along = SPACING_OF_PATHS * (np.arange(POINTS) - HERE)
            x, y = pose[0] + along * np.cos(path), pose[1] + along * np.sin(path)
            route = replace(RouteAhead.unknown(1), known=np.ones(1, np.bool_), x=x[None], y=y[None])
            context = route_context(route, user)
        if self._yields:
            self.yielding.apply(self.snapshot, user, context)
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
        user = make_world(*pose, speed, type=self.kinds, ids=self.ids)
        return user if self._width is None else replace(user, width=np.array([self._width]))

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


def test_a_car_that_is_excluded_is_not_held(session: SumoSession) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN, exclude=("another", CAR))
    scene.stand((scene.x, scene.y, 0.0), 20.0)
    assert scene.overlap
    assert scene.yielding.interventions == 0


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


@pytest.mark.parametrize("on_route", [True, False])
def test_a_car_that_sways_on_the_opposite_lane_is_no_reason_to_brake(session: SumoSession, on_route: bool) -> None:
    scene = Scene(session, RoadUserType.CAR)
    y = scene.y + 40.0
    for _ in range(2):
        scene.step(scene.home)
    for _ in range(20):
        y -= 10.0 * STEP
        scene.step((scene.x - 3.2, y, SOUTH), 10.0, yaw_rate=0.5, path=SOUTH if on_route else None)
    assert (scene.yielding.interventions == 0) == on_route


def test_a_car_is_let_cross_without_hard_braking(session: SumoSession) -> None:
    scene = Scene(session, RoadUserType.CAR)
    for _ in range(2):
        scene.step(scene.home)
    while scene.distances[-1] > 55.0:
        scene.step(scene.home)
    # Both would be at the same place at the same time.
    x = scene.x - 7.0 * 4.0
    for _ in range(25):
        x += 7.0 * STEP
        scene.step((x, scene.y, 0.0), 7.0, path=0.0)
    assert not scene.overlap
    assert scene.yielding.interventions == 1
    assert scene.decelerations().max() < 4.6
    assert scene.speeds[-1] > 8.0


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


@pytest.mark.parametrize("width", [1.8, 2.6])
def test_a_car_passes_one_that_waits_on_its_lane_after_a_while(session: SumoSession, width: float) -> None:
    scene = Scene(session, RoadUserType.CAR, width=width)
    waiting = scene.x - 3.2, scene.y, WEST
    for k in range(60):
        scene.step(waiting if k > 1 else scene.home, path=WEST)
    assert scene.speeds[-1] < 0.1
    for _ in range(40):
        scene.step(waiting, path=WEST)
    assert scene.distances[-1] < -8.0
    # Without a route it is not known to be on its lane.
    assert scene.yielding.held == frozenset()


@pytest.mark.parametrize(("on_route", "passes"), [(True, True), (False, False)])
def test_a_car_passes_an_oncoming_one_that_stands_on_its_lane_at_once(
    session: SumoSession, on_route: bool, passes: bool
) -> None:
    """Some networks draw the lanes of both directions over each other, and each would wait for the other."""
    scene = Scene(session, RoadUserType.CAR)
    for k in range(60):
        scene.step((scene.x - 1.7, scene.y, SOUTH) if k > 1 else scene.home, path=SOUTH if on_route else None)
    beside = np.array(scene.speeds)[np.abs(scene.distances) < 4.0]
    if passes:
        assert scene.distances[-1] < -8.0
        assert beside.min() == pytest.approx(2.0, abs=0.3)
    else:
        assert scene.speeds[-1] < 0.1


def test_a_car_slows_down_beside_one_that_stands_close(session: SumoSession) -> None:
    scene = Scene(session, RoadUserType.PEDESTRIAN)
    scene.stand((scene.x + 1.15, scene.y, 0.0), 20.0)
    beside = np.array(scene.speeds)[np.abs(scene.distances) < 1.0]
    assert len(beside)
    assert 1.5 < beside.min() < 3.0
    assert not scene.overlap
    assert scene.distances[-1] < 0.0


def test_a_car_that_waits_in_a_junction_beside_a_learned_one_goes_on(session: SumoSession) -> None:
    """SUMO keeps 0.1 m from its leader in a junction, also where that comes from beside it and waits itself."""
    scene, vehicle = Scene(session, RoadUserType.CAR), session.api.vehicle
    scene.step(scene.home)
    at_first = vehicle.getSpeedMode(CAR)
    vehicle.setSpeed(CAR, 4.0)
    while not vehicle.getLaneID(CAR).startswith(":"):
        scene.step(scene.home)
    vehicle.setSpeed(CAR, 0.0)
    for _ in range(round(1.2 * LONGEST_VEHICLE_WAIT / STEP)):
        scene.step(scene.home)
        # Far away is no learned one that it could wait for.
        assert vehicle.getSpeedMode(CAR) == at_first
    x, y = vehicle.getPosition(CAR)
    for _ in range(2):
        scene.step((x + 6.0, y, SOUTH))
    assert vehicle.getSpeedMode(CAR) == at_first | DISREGARDS_INSIDE_BIT
    vehicle.setSpeed(CAR, -1.0)
    while vehicle.getLaneID(CAR).startswith(":") or vehicle.getLanePosition(CAR) < vehicle.getLength(CAR):
        assert vehicle.getSpeedMode(CAR) == at_first | DISREGARDS_INSIDE_BIT
        scene.step(scene.home)
    scene.step(scene.home)
    assert vehicle.getSpeedMode(CAR) == at_first


def test_so_does_one_that_has_not_left_the_junction_with_its_rear(session: SumoSession) -> None:
    """On a street of 0.2 m between two junctions a vehicle stands in both."""
    scene, vehicle = Scene(session, RoadUserType.CAR), session.api.vehicle
    scene.step(scene.home)
    at_first, here = vehicle.getSpeedMode(CAR), ""
    vehicle.setSpeed(CAR, 4.0)
    while not here.startswith("out"):
        scene.step(scene.home)
        here = vehicle.getLaneID(CAR)
    vehicle.setSpeed(CAR, 0.0)
    scene.step(scene.home)
    assert vehicle.getLanePosition(CAR) < vehicle.getLength(CAR)
    x, y = vehicle.getPosition(CAR)
    for _ in range(round(1.2 * LONGEST_VEHICLE_WAIT / STEP)):
        scene.step((x + 6.0, y, SOUTH))
    assert vehicle.getSpeedMode(CAR) == at_first | DISREGARDS_INSIDE_BIT
