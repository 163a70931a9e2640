"""Where vehicles of a recording are expected to go: on a lane that forks, beside a sidewalk."""

import numpy as np
import pytest
from builders import make_recording, make_world

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.expected_routes import ExpectedRoutes, routes_ahead
from slrl_sumo.scene.route import HERE, POINTS
from slrl_sumo.sumo.network.lanes import Lane

CARS = frozenset({"passenger"})


def _lane(name: str, *points: tuple[float, float], allowed: frozenset[str] = CARS) -> Lane:
    shape = np.array(points, np.float64)
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    return Lane(f"{name}_0", name, shape, 3.2, length, 13.9, allowed, False, Surface.ROAD)


LANES = (
    _lane("in", (0.0, 0.0), (100.0, 0.0)),
    _lane("left", (100.0, 0.0), (110.0, 3.0), (115.0, 15.0), (115.0, 200.0)),
    _lane("on", (100.0, 0.0), (300.0, 0.0)),
    _lane("cycles", (100.0, 0.0), (300.0, -1.0), allowed=frozenset({"bicycle"})),
    _lane("walk", (0.0, 5.0), (300.0, 5.0), allowed=frozenset({"pedestrian"})),
)
FOLLOWING = {"in_0": ("left_0", "cycles_0", "on_0", "elsewhere_0")}


@pytest.fixture(scope="module")
def routes() -> ExpectedRoutes:
    return ExpectedRoutes(LANES, FOLLOWING)


def test_vehicles_go_straight_on_at_the_highest_speed_of_the_last_2_seconds(routes: ExpectedRoutes) -> None:
    speed = np.array([8.0, 8.0, 12.0, 10.0, 9.0, 8.0, 7.0, 6.0, 5.0])
    x = 50.0 + np.cumsum(0.4 * speed)
    made = make_recording((x, 0.5, 0.0), (np.full(9, 20.0), 0.0, 0.0))
    braking, standing = routes.of(made, np.array([8, 17]))
    assert braking is not None
    assert standing is not None
    assert braking.desired == pytest.approx(9.0)  # 12 m/s is longer ago
    assert standing.desired == 0.0
    world = make_world(x=[x[-1], 20.0], speed=[5.0, 0.0])
    ahead = routes_ahead([braking, standing], world)
    assert ahead.known.all()
    np.testing.assert_allclose(ahead.desired_speed, [9.0, 0.0])
    np.testing.assert_allclose(ahead.y, 0.0, atol=1e-9)
    np.testing.assert_allclose(ahead.x[:, HERE], [x[-1], 20.0])
    assert np.isinf(ahead.stop).all()
    # It is found again wherever it goes.
    for then in (x[-1] + 2.0, x[-1] + 4.0, x[-1] + 6.0):
        ahead = routes_ahead([None, braking], make_world(x=[0.0, then], speed=5.0))
        assert ahead.known.tolist() == [False, True]
        assert ahead.x[1, HERE] == pytest.approx(then)
        assert ahead.x.shape == (2, POINTS)


def test_what_a_recording_holds_later_does_not_matter(routes: ExpectedRoutes) -> None:
    x = 60.0 + 3.0 * np.arange(20)
    straight = make_recording((x, 0.0, 0.0))
    turning = make_recording((x, np.where(np.arange(20) > 8, 20.0, 0.0), np.where(np.arange(20) > 8, 1.5, 0.0)))
    (one,), (other,) = (routes.of(made, np.array([8])) for made in (straight, turning))
    assert one == other


@pytest.mark.parametrize(
    ("pose", "kind"),
    [
        ((50.0, 0.0, np.pi), 0),  # against the lane
        ((50.0, 0.0, 1.0), 0),
        ((50.0, 4.0, 0.0), 0),  # beside it
        ((-20.0, 0.0, 0.0), 0),  # before it
        ((50.0, 0.0, 0.0), 1),  # not for bicycles
        ((50.0, 5.0, 0.0), 2),  # pedestrians have none
    ],
)
def test_nothing_is_expected_of_road_users_off_the_lanes(
    routes: ExpectedRoutes, pose: tuple[float, float, float], kind: int
) -> None:
    x, y, heading = pose
    made = make_recording((np.full(6, x), y, heading), type=kind)
    assert routes.of(made, np.array([5])) == [None]


def test_in_a_junction_the_lane_of_its_own_direction_counts(routes: ExpectedRoutes) -> None:
    made = make_recording((np.full(6, 113.0), 10.0, 1.2))
    (one,) = routes.of(made, np.array([5]))
    assert one is not None
    assert one.line.at(one.line.end)[2] == pytest.approx(np.pi / 2)


def test_without_lanes_nothing_is_expected() -> None:
    made = make_recording((np.full(6, 50.0), 0.0, 0.0))
    assert ExpectedRoutes((), {}).of(made, np.array([5])) == [None]
