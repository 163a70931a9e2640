"""Learned road users are in SUMO where they were put."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import libsumo
import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, RoadUserType
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.spawned import LEARNED_TYPES

Copy = Callable[..., Path]
Floats = NDArray[np.float64]

TOLERANCE = 0.01
"""m"""


class Group:
    """Road users in an open session, moved to wherever `x`, `y`, `heading` and `speed` are set."""

    def __init__(self, session: SumoSession, kinds: list[int], x: Floats, y: Floats) -> None:
        self.session = session
        self.kinds = np.array(kinds, np.int8)
        self.ids = tuple(f"learned_{kind}.{number}" for number, kind in enumerate(kinds))
        self.x, self.y = np.array(x, np.float64), np.array(y, np.float64)
        self.heading, self.speed = np.zeros(len(kinds)), np.full(len(kinds), 1.0)
        session.spawned.add(self.ids, self.kinds, self.x, self.y)
        self.move()

    def move(self) -> None:
        """One SUMO step with all road users moved."""
        length = DEFAULT_LENGTH[self.kinds]
        self.session.spawned.move(self.ids, self.kinds, self.x, self.y, self.heading, self.speed, length)
        self.session.step()

    def check(self) -> None:
        """All are in SUMO's answer, at the place, heading and with the box that was asked for."""
        snapshot = self.session.reader.read()
        row = {road_user: i for i, road_user in enumerate(snapshot.ids)}
        assert set(self.ids) <= set(row), f"lost {set(self.ids) - set(row)}"
        at = [row[road_user] for road_user in self.ids]
        away = np.hypot(snapshot.x[at] - self.x, snapshot.y[at] - self.y)
        assert away.max() < TOLERANCE, dict(zip(self.ids, away, strict=True))
        assert np.abs(wrap_angle(snapshot.heading[at] - self.heading)).max() < 0.01
        assert snapshot.person[at].tolist() == [kind == RoadUserType.PEDESTRIAN for kind in self.kinds]
        assert np.array_equal(snapshot.length[at], DEFAULT_LENGTH[self.kinds])
        assert np.array_equal(snapshot.width[at], DEFAULT_WIDTH[self.kinds])
        assert [snapshot.sumo_type[i] for i in at] == [LEARNED_TYPES[kind] for kind in self.kinds]


@contextmanager
def opened(config: str, step_length: float | None = None) -> Iterator[SumoSession]:
    with SumoSession(find_scenario(config), step_length=step_length) as session:
        yield session


@pytest.fixture(params=["lanes", "sublane"])
def quiet_intersection(request: pytest.FixtureRequest, copy_scenario: Copy) -> str:
    """The intersection without traffic, with SUMO's usual lane model and with its sublane model."""
    extra = '<lateral-resolution value="0.8"/>' if request.param == "sublane" else ""
    config = copy_scenario("intersection", (".sumocfg", "<processing>", f"<processing>{extra}"))
    (config.parent / "intersection.rou.xml").write_text("<routes/>")
    return str(config)


def test_all_stand_where_asked_two_steps_after_being_added(quiet_intersection: str) -> None:
    rng = np.random.default_rng(3)
    with opened(quiet_intersection) as session:
        kinds = [kind for kind in range(3) for _ in range(20)]
        # Anywhere: on lanes, on pavements, on the grass between the arms, in the junction.
        group = Group(session, kinds, rng.uniform(5, 195, 60), rng.uniform(5, 195, 60))
        group.heading = rng.uniform(-np.pi, np.pi, 60)
        group.move()
        group.check()
        for _ in range(25):
            group.x += rng.uniform(-3, 3, 60)
            group.y += rng.uniform(-3, 3, 60)
            group.heading = wrap_angle(group.heading + rng.uniform(-1, 1, 60))
            group.move()
            group.check()


def test_all_may_jump_across_the_network_and_stand_there(quiet_intersection: str) -> None:
    rng = np.random.default_rng(4)
    with opened(quiet_intersection) as session:
        group = Group(session, [0, 1, 2] * 8, rng.uniform(5, 195, 24), rng.uniform(5, 195, 24))
        for _ in range(10):
            group.x, group.y = rng.uniform(0, 200, 24), rng.uniform(0, 200, 24)
            group.speed[:] = 0.0
            for _ in range(4):
                group.move()
                group.check()


@pytest.mark.parametrize("step_length", [0.4, 0.1])
def test_persons_walk_over_many_edges(quiet_intersection: str, step_length: float) -> None:
    """Round the junction on pavements, across carriageways and walking areas: always there, no walk ends."""
    with opened(quiet_intersection, step_length) as session:
        around = np.linspace(0.0, 4 * np.pi, 400)
        group = Group(session, [2, 2], np.array([112.0, 124.0]), np.array([100.0, 100.0]))
        edges = set()
        for angle in around:
            group.x = 100 + np.array([12.0, 24.0]) * np.cos(angle)
            group.y = 100 + np.array([12.0, 24.0]) * np.sin(angle)
            group.heading = wrap_angle(np.full(2, angle + np.pi / 2))
            group.move()
            group.check()
            edges.add(libsumo.person.getRoadID(group.ids[1]))
        assert len(edges) >= 8


def test_bicycles_ride_on_the_cycle_lane(quiet_intersection: str) -> None:
    with opened(quiet_intersection) as session:
        lane = next(each for each in session.network.lanes if each.id == "in0_1")
        ends = lane.shape
        along = (ends[-1] - ends[0]) / np.hypot(*(ends[-1] - ends[0]))
        group = Group(session, [1], ends[:1, 0] + 5 * along[0], ends[:1, 1] + 5 * along[1])
        group.heading[:] = np.arctan2(along[1], along[0])
        group.speed[:] = 5.0
        for _ in range(30):
            group.x += 2.0 * along[0]
            group.y += 2.0 * along[1]
            group.move()
            group.check()
            assert libsumo.vehicle.getRoadID(group.ids[0]) == "in0"
        assert libsumo.vehicle.getSpeed(group.ids[0]) == pytest.approx(5.0)


def test_a_car_is_on_its_lane_with_the_speed_that_was_given(quiet_intersection: str) -> None:
    with opened(quiet_intersection) as session:
        lane = next(each for each in session.network.lanes if each.id == "in2_2")
        begin, end = lane.shape[0], lane.shape[-1]
        along = (end - begin) / np.hypot(*(end - begin))
        group = Group(session, [0], begin[:1] + 10 * along[0], begin[1:2] + 10 * along[1])
        group.heading[:] = np.arctan2(along[1], along[0])
        for number in range(20):
            group.speed[:] = 4.0 + 0.2 * number
            group.x += 0.4 * group.speed * along[0]
            group.y += 0.4 * group.speed * along[1]
            group.move()
            group.check()
            assert libsumo.vehicle.getLaneID(group.ids[0]) == "in2_2"
            assert libsumo.vehicle.getSpeed(group.ids[0]) == pytest.approx(group.speed[0])


def test_learned_road_users_stay_among_traffic_for_a_minute() -> None:
    """Standing on each other, in front of background traffic and beside every lane: none is removed."""
    rng = np.random.default_rng(8)
    for name in ("intersection", "shared-space"):
        with opened(name) as session:
            group = Group(session, [0, 1, 2] * 12, rng.uniform(80, 120, 36), rng.uniform(80, 120, 36))
            background = 0
            for number in range(150):
                if number % 15 == 0:
                    group.x, group.y = rng.uniform(60, 140, 36), rng.uniform(60, 140, 36)
                group.move()
                if number % 5 == 0:
                    group.check()
                background = max(background, len(session.reader.read().ids) - 36)
            assert background > 3


def test_networks_without_carriageway_hold_cyclists_and_walkers(bare_network: Callable[[str], Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b" allow="bicycle pedestrian"/>')
    with opened(str(config), 0.4) as session:
        group = Group(session, [1, 2], np.array([20.0, 40.0]), np.array([-1.0, -2.0]))
        for _ in range(20):
            group.x += 1.0
            group.move()
            group.check()


def test_removed_road_users_are_gone_and_may_return(quiet_intersection: str) -> None:
    with opened(quiet_intersection) as session:
        group = Group(session, [0, 1, 2], np.array([98.0, 95.0, 90.0]), np.array([30.0, 40.0, 50.0]))
        group.move()
        group.check()
        session.spawned.remove((*group.ids, "no_users"))
        session.step()
        assert session.reader.read().ids == ()
        again = Group(session, [0, 1, 2], np.array([60.0, 50.0, 40.0]), np.array([98.0, 95.0, 90.0]))
        again.move()
        again.check()
