"""Leaders of road users, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_levels, make_routes, make_world

from slrl_sumo.perception.leaders import ALIKE, BESIDE, BRAKES, NEAREST, SIDE_GAP, STANDING, Leaders, leaders, way_code
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.route import AHEAD, HERE, POINTS, SPACING, RouteAhead, on_path, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

Box = tuple[float, float, float, float, float, float]
"""x, y, heading, speed, length, width."""
EGO: Box = (0.0, 0.0, 0.0, 8.0, 5.0, 1.8)


def world(*boxes: Box) -> WorldState:
    x, y, heading, speed, length, width = np.array(boxes, np.float64).T
    return make_world(x, y, heading, speed, length=length, width=width)


def eastwards(*y: float) -> RouteAhead:
    return make_routes(ALONG, np.array(y)[:, None])


def found_by(route: RouteAhead, crowd: WorldState, *, aside: float = 0.0, levels: Levels = FLAT) -> Leaders:
    """The leaders of followers that are `aside` m to the left of their paths."""
    return leaders(route, crowd, np.full(len(route), aside), levels=levels)


def of_one(*others: Box) -> list[float]:
    """Gap and speed."""
    found = found_by(eastwards(0.0), world(EGO, *others))
    return [float(found[0][0]), float(found[1][0])]


def test_the_nearest_one_on_the_path_leads() -> None:
    # Boxes of 5 m: 20 m between centres are a gap of 15 m; the bicycle is 12 - 2.5 - 0.8 m away.
    car, bicycle = (20.0, 0.0, 0.0, 4.0, 5.0, 1.8), (12.0, 0.5, 0.1, 5.0, 1.6, 0.65)
    assert of_one(car) == pytest.approx([15.0, 4.0])
    c, s = np.cos(0.1), np.sin(0.1)
    expected = pytest.approx([12.0 - 2.5 - 0.5 * (1.6 * c + 0.65 * s), 5.0 * c])
    assert of_one(car, bicycle) == expected
    assert of_one(bicycle, car) == expected
    # Boxes that overlap along the path: no room at all.
    assert of_one((4.0, 0.0, 0.0, 0.0, 5.0, 1.8))[0] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("other", "leads"),
    [
        ((20.0, 2.0, 0.0, 5.0, 5.0, 1.8), True),  # 0.2 m between the sides
        ((20.0, 2.1, 0.0, 5.0, 5.0, 1.8), False),  # 0.3 m
        ((20.0, -2.1, 0.0, 5.0, 5.0, 1.8), False),
        ((20.0, -2.0, 0.0, 5.0, 5.0, 1.8), True),
        ((20.0, 1.85, 0.0, 0.0, 5.0, 1.8), False),  # stands: nothing between the sides is needed
        ((20.0, 1.75, 0.0, 0.0, 5.0, 1.8), True),
        ((20.0, 3.0, 1.0, 5.0, 5.0, 1.8), True),  # turned into the path
        ((-10.0, 0.0, 0.0, 9.0, 5.0, 1.8), False),  # behind
        ((0.2, 0.5, 0.0, 0.0, 0.3, 0.5), False),  # beside
        ((20.0, 0.0, np.pi, 5.0, 5.0, 1.8), False),  # comes towards us
        ((20.0, 0.0, np.pi, 0.4, 5.0, 1.8), True),  # stands there
        ((20.0, 0.0, 0.5 * np.pi, 1.4, 0.3, 0.5), False),  # walks across
        ((20.0, 0.0, 0.5 * np.pi, 0.0, 0.3, 0.5), True),
        ((42.0, 0.0, 0.0, 5.0, 5.0, 1.8), True),  # its rear is within sight
        ((43.0, 0.0, 0.0, 5.0, 5.0, 1.8), False),
    ],
)
def test_which_road_user_leads(other: Box, leads: bool) -> None:
    assert np.isfinite(of_one(other)[0]) == leads


@pytest.mark.parametrize(("further", "first"), [(60.0, 17.0), (40.0, 0.0)])
def test_one_that_stands_beyond_the_leader_is_seen_in_time(further: float, first: float) -> None:
    """The leader may be about to leave the path: cars at 17 m/s met the end of a queue that it had hidden."""
    leader, standing = (18.0, 0.0, 0.0, 17.0, 5.0, 1.8), (further, 0.0, 0.0, 0.0, 5.0, 1.8)
    found = found_by(eastwards(0.0), world(EGO, leader, standing))
    assert (found.gap[0], found.speed[0], found.row[0]) == (13.0, 17.0, 1)
    stops = {17.0: 13.0 + 17.0**2 / (2.0 * BRAKES), 0.0: further - 5.0}
    assert (found.stop[0], found.stop_speed[0]) == (pytest.approx(min(stops.values())), first)
    assert stops[first] == min(stops.values())


@pytest.mark.parametrize(
    ("heading", "speed", "leads"),
    [(0.0, 0.0, True), (np.pi, 0.0, False), (np.pi / 2, 0.0, False), (0.0, 0.6, False), (0.0, 0.4, True)],
)
def test_pedestrians_wait_behind_others_that_wait_and_walk_round_all_others(
    heading: float, speed: float, leads: bool
) -> None:
    scene = world((0.0, 0.0, 0.0, 1.3, 0.2, 0.5), (3.0, 0.2, heading, speed, 0.2, 0.5))
    walking = replace(scene, type=np.full(2, RoadUserType.PEDESTRIAN, np.int8))
    assert np.isfinite(found_by(eastwards(0.0), walking)[0][0]) == leads
    # Drivers stop for whoever stands in their way.
    assert np.isfinite(found_by(eastwards(0.0), scene)[0][0])
    # A road user with room to pass has no leader, and pedestrians need less than cars.
    beside = replace(walking, y=np.array([0.0, 0.65]))
    assert np.isinf(found_by(eastwards(0.0), beside)[0][0])


def test_gaps_are_along_the_path() -> None:
    # 15 m eastwards, then north; the leader is 10 m up there.
    x, y = np.minimum(ALONG, 15.0), np.maximum(ALONG - 15.0, 0.0)
    route = replace(eastwards(0.0), x=x[None], y=y[None])
    found = found_by(route, world(EGO, (15.0, 10.0, 0.5 * np.pi, 3.0, 5.0, 1.8), (25.0, 0.0, 0.0, 3.0, 5.0, 1.8)))
    assert (found[0][0], found[1][0]) == (pytest.approx(20.0), pytest.approx(3.0))


def test_each_has_its_own_leader_and_none_without_a_route() -> None:
    three = world(
        EGO, (15.0, 0.0, 0.0, 6.0, 5.0, 1.8), (30.0, 0.0, 0.0, 2.0, 5.0, 1.8), (45.0, 0.0, 0.0, 2.0, 5.0, 1.8)
    )
    route = replace(eastwards(0.0, 0.0, 0.0), known=np.array([True, True, False]))
    route = replace(route, x=route.x + np.array([[0.0], [15.0], [30.0]]))
    found = found_by(route, three)
    gap, speed = found.gap, found.speed
    assert gap.tolist() == [pytest.approx(10.0), pytest.approx(10.0), np.inf]
    assert speed.tolist() == [pytest.approx(6.0), pytest.approx(2.0), 0.0]
    assert found.row.tolist() == [1, 2, -1]
    alone = found_by(eastwards(0.0), world(EGO)).gap
    assert alone.tolist() == [np.inf]


def crooked(n: int, rng: np.random.Generator, share: float) -> RouteAhead:
    """Paths through a place of 60 m x 60 m, with a `share` of sharp corners, some of which turn right round; winding,
    and their points not quite as far apart as they should be."""
    turns = np.where(rng.random((n, POINTS)) < share, rng.choice([-3.1, -1.6, -0.8, 0.8, 1.6, 3.1], (n, POINTS)), 0.0)
    turns += rng.normal(0.0, 0.15, (n, 1)) * np.sin(rng.uniform(0.1, 0.5, (n, 1)) * ALONG)
    heading = rng.uniform(-np.pi, np.pi, (n, 1)) + turns.cumsum(axis=1)
    step = SPACING * rng.uniform(0.9, 1.49, (n, 1))
    x, y = (step * np.cos(heading)).cumsum(axis=1), (step * np.sin(heading)).cumsum(axis=1)
    place = rng.uniform(0.0, 60.0, (2, n, 1))
    x, y = x - x[:, HERE, None] + place[0], y - y[:, HERE, None] + place[1]
    return make_routes(x, y, known=rng.random(n) < 0.9)


@pytest.mark.parametrize("share", [0.0, 0.08])
def test_a_quick_look_leaves_out_no_leader(share: float) -> None:
    rng = np.random.default_rng(1)
    followed = 0
    for _ in range(20):
        route = crooked(40, rng, share)
        sizes = np.array([[5.0, 1.8], [1.6, 0.65], [0.5, 0.5], [18.0, 2.5]])[rng.integers(0, 4, 60)]
        x, y = rng.uniform(0.0, 60.0, (2, 60))
        x[:40], y[:40] = route.x[:, HERE], route.y[:, HERE]
        heading, speed = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.0, 8.0, 60) * (rng.random(60) < 0.6)
        crowd = world(*zip(x, y, heading, speed, sizes[:, 0], sizes[:, 1], strict=True))
        found, expected = found_by(route, crowd), of_everybody(route, crowd)
        assert np.allclose(found[0], expected[0], atol=1e-9)
        assert np.allclose(found[1], expected[1], atol=1e-9)
        followed += int(np.isfinite(found[0]).sum())
    assert followed > 300


def of_everybody(route: RouteAhead, crowd: WorldState) -> tuple[Floats, Floats]:
    """Leaders by a look at all road users near the middle of a path."""
    gap, speed = np.full(len(route), np.inf), np.zeros(len(route))
    for i in np.flatnonzero(route.known):
        for j in range(len(crowd)):
            apart = np.hypot(crowd.x[j] - route.x[i, POINTS // 2], crowd.y[j] - route.y[i, POINTS // 2])
            if j == i or apart > 0.75 * AHEAD + 10.0:
                continue
            one = np.array([i])
            along, aside, direction = (
                float(c[0, 0]) for c in on_path(route, crowd.x[j : j + 1, None], crowd.y[j : j + 1, None], one)
            )
            turn = float(wrap_angle(crowd.heading[j] - direction))
            c, s = abs(np.cos(turn)), abs(np.sin(turn))
            length, width = crowd.length[j], crowd.width[j]
            beside = abs(aside) - 0.5 * (s * length + c * width) - 0.5 * crowd.width[i]
            between = along - 0.5 * (c * length + s * width) - 0.5 * crowd.length[i]
            kind = crowd.type[i]
            stands = kind != RoadUserType.PEDESTRIAN and crowd.speed[j] < STANDING
            leads = abs(turn) < ALIKE or stands
            ahead = NEAREST[kind] < along < AHEAD + 0.5 * length
            passes = between < 0.0 and beside > -BESIDE
            if beside < (0.0 if stands else SIDE_GAP[kind]) and ahead and leads and not passes and between < gap[i]:
                gap[i], speed[i] = between, max(crowd.speed[j] * np.cos(turn), 0.0)
    return gap, speed


def test_a_road_user_beside_the_follower_does_not_lead_but_is_in_its_way() -> None:
    # 3 m ahead between centres of boxes of 5 m: they overlap along the path.
    grazing, across = (3.0, 1.7, 0.0, 0.0, 5.0, 1.8), (3.0, 1.0, 0.0, 0.0, 5.0, 1.8)
    for other, leads in ((grazing, False), (across, True)):
        found = found_by(eastwards(0.0), world(EGO, other))
        assert np.isfinite(found.gap[0]) == leads
        assert found.in_way.tolist() == [way_code(0, 1, 2)]
    far = found_by(eastwards(0.0), world(EGO, (20.0, 0.0, 0.0, 0.0, 5.0, 1.8)))
    assert far.in_way.tolist() == []


@pytest.mark.parametrize(("gap", "leads"), [(1.0, True), (4.0, True), (7.0, False)])
def test_one_that_changes_lanes_has_to_pass_the_end_of_its_queue(gap: float, leads: bool) -> None:
    # It stands on the lane beside its new one, 3.2 m to the right of it, as does the one before it.
    changing, before = (0.0, -3.2, 0.0, 0.0, 5.0, 1.8), (5.0 + gap, -3.2, 0.0, 0.0, 5.0, 1.8)
    found = found_by(eastwards(0.0), world(changing, before), aside=-3.2)
    assert found.row.tolist() == ([1] if leads else [-1])
    # A vehicle in the new lane leads as ever, one beyond that lane does not.
    new, beyond = (5.0 + gap, 0.0, 0.0, 0.0, 5.0, 1.8), (5.0 + gap, 3.2, 0.0, 0.0, 5.0, 1.8)
    assert found_by(eastwards(0.0), world(changing, new), aside=-3.2).gap[0] == pytest.approx(gap)
    assert found_by(eastwards(0.0), world(changing, beyond), aside=-3.2).row.tolist() == [-1]


@pytest.mark.parametrize(("speed", "seen"), [(0.0, 40.0), (10.9, 40.0), (14.0, 60.0), (25.0, 169.5), (40.0, 250.0)])
def test_fast_vehicles_see_as_far_as_they_need_to_stop_in_comfort(speed: float, seen: float) -> None:
    # 25² / (2 * 2.2) + 1.1 * 25 = 169.5 m.
    spacing = spacing_at(speed)
    route = make_routes(ALONG * spacing, spacing=spacing)
    for x, leads in ((seen + 1.0, True), (seen + 4.0, False)):
        found = found_by(route, world(EGO, (x, 0.5, 0.0, 0.0, 5.0, 1.8)))
        assert found.row[0] == (1 if leads else -1)
        assert found.gap[0] == pytest.approx(x - 5.0 if leads else np.inf)


def test_a_road_user_on_a_bridge_above_the_path_neither_leads_nor_is_in_the_way() -> None:
    levels = make_levels()
    # A street crosses at x = 0; the follower is 15 m before it, and one stands on the bridge, one in its own street.
    route, there = eastwards(0.0), (1.0, 1.5, 0.5 * np.pi, 0.0, 5.0, 1.8)
    route = replace(route, x=route.x - 9.0)
    follower = (-9.0, 0.0, 0.0, 8.0, 5.0, 1.8)
    flat = found_by(route, world(follower, there))
    assert flat.gap[0] == pytest.approx(10.0 - 2.5 - 0.9)
    assert len(flat.in_way) == 1
    above = found_by(route, world(follower, there), levels=levels)
    assert np.isinf(above.gap[0])
    assert len(above.in_way) == 0
    # In the street itself one leads on all levels, also behind the one on the bridge.
    both = found_by(route, world(follower, there, (6.0, 0.0, 0.0, 3.0, 5.0, 1.8)), levels=levels)
    assert both.gap[0] == pytest.approx(10.0)
    assert both.row[0] == 2
