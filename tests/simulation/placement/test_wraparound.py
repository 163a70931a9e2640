"""Road users that leave the scene come back on its other side."""

from functools import cache

import numpy as np
import pytest
from builders import make_world
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.contacts import contact_pairs
from slrl_sumo.scene.geometry import from_ego, to_ego, wrap_angle
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.placement.spawn import starting_points
from slrl_sumo.simulation.placement.wraparound import left_scene, reinsert, start_anew
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

Row = tuple[int, float, float, float, float]


@cache
def scene(name: str) -> tuple[RoadMap, tuple[LanePoints, ...]]:
    with SumoSession(find_scenario(name)) as session:
        return RoadMap(session.network.surfaces()), starting_points(session.network)


def world(rows: list[Row], length: float | None = None) -> WorldState:
    """Rows of type, x, y, heading, speed."""
    kind, x, y, heading, speed = np.array(rows, np.float64).reshape(-1, 5).T
    ids = [f"{length}{i}" for i in range(len(rows))]
    return make_world(x, y, heading, speed, type=kind, acceleration=0.5, length=length, ids=ids)


def test_road_users_on_the_ground_or_near_it_stay() -> None:
    roadmap, points = scene("intersection")
    for source in points:
        rows: list[Row] = [(0, x, y, h, 5.0) for x, y, h in zip(source.x, source.y, source.heading, strict=True)]
        assert not left_scene(world(rows), roadmap).any()
    # Beside the pavement, which ends 7 m from the middle of the street.
    assert not left_scene(world([(0, 40.0, 100 + 7 + 5, 0.0, 1.0)]), roadmap).any()


def test_road_users_outside_the_network_or_far_from_every_surface_have_left() -> None:
    roadmap, _ = scene("intersection")
    x0, y0, x1, y1 = roadmap.bounds
    rows: list[Row] = [
        (0, x0 - 1, 100, np.pi, 10),
        (1, x1 + 1, 100, 0, 4),
        (2, 100, y1 + 0.5, np.pi / 2, 1),
        (0, 100, y0 - 20, 0, 10),
        # On the grass between two arms, inside the bounding box.
        (2, 40, 160, 0, 1),
        (0, 100, 100, 0, 10),
    ]
    assert left_scene(world(rows), roadmap).tolist() == [True, True, True, True, True, False]
    # With a rim, a little outside, off the end of an arm, is not leaving; far off, or on the grass, is.
    assert left_scene(world(rows), roadmap, rim=3.0).tolist() == [False, False, False, True, True, False]


def outside(roadmap: RoadMap, kinds: list[int]) -> WorldState:
    """One of each kind just outside each of the four ends of the arms, heading out."""
    x0, y0, x1, y1 = roadmap.bounds
    rows: list[Row] = []
    for kind in kinds:
        # Each on its right-hand side: the lane that leads out of the scene there.
        off = (1.6, 4.0, 6.0)[kind]
        rows += [
            (kind, x1 + 1, 100 - off, 0.0, 30.0),
            (kind, 100 + off, y1 + 1, np.pi / 2, 30.0),
            (kind, x0 - 1, 100 + off, np.pi, 30.0),
            (kind, 100 - off, y0 - 1, -np.pi / 2, 30.0),
        ]
    return world(rows)


@pytest.mark.parametrize("name", ["intersection", "shared-space", "signalised"])
def test_all_return_legally_on_the_other_side_in_the_same_direction(name: str) -> None:
    roadmap, points = scene(name)
    before = outside(roadmap, [0, 1, 2])
    gone = left_scene(before, roadmap)
    assert gone.all()
    after = reinsert(before, gone, empty_world(), points, roadmap)
    assert not left_scene(after, roadmap).any()
    assert after.ids == before.ids
    x0, y0, x1, y1 = roadmap.bounds
    middle = 0.5 * np.array([x0 + x1, y0 + y1])
    for row, kind in enumerate(before.type):
        ahead = np.array([np.cos(before.heading[row]), np.sin(before.heading[row])])
        old, new = np.array([before.x[row], before.y[row]]), np.array([after.x[row], after.y[row]])
        assert (old - middle) @ ahead > 0
        assert (new - middle) @ ahead < -0.3 * (x1 - x0)
        assert abs(wrap_angle(after.heading[row] - before.heading[row])) < 0.2
        nearest = points[kind].nearest(after.x[row : row + 1], after.y[row : row + 1])[0, 0]
        assert (points[kind].x[nearest], points[kind].y[nearest]) == (after.x[row], after.y[row])
        turn = abs(wrap_angle(points[kind].heading[nearest] - after.heading[row]))
        if kind == RoadUserType.PEDESTRIAN:
            turn = min(turn, np.pi - turn)
        assert turn < 1e-6
        # As fast as before, up to what is allowed there.
        assert after.speed[row] == points[kind].lanes[points[kind].lane[nearest]].max_speed


def test_slow_road_users_keep_their_speed_and_those_that_stay_are_not_touched() -> None:
    roadmap, points = scene("intersection")
    before = world([(0, 250.0, 98.4, 0.0, 3.0), (2, 100.0, 100.0, 0.4, 1.0), (0, 100.0, 95.0, 1.0, 2.0)])
    after = reinsert(before, np.array([True, False, False]), empty_world(), points, roadmap)
    assert after.speed.tolist() == [3.0, 1.0, 2.0]
    for name in ("x", "y", "heading"):
        assert getattr(after, name)[1:].tolist() == getattr(before, name)[1:].tolist()
    assert before.x[0] == 250.0


def test_without_leavers_nothing_changes() -> None:
    roadmap, points = scene("intersection")
    before = world([(0, 100.0, 98.4, 0.0, 3.0)])
    after = reinsert(before, np.zeros(1, np.bool_), empty_world(), points, roadmap)
    assert (after.x.tolist(), after.y.tolist(), after.heading.tolist()) == ([100.0], [98.4], [0.0])


def check_apart(after: WorldState, others: WorldState) -> None:
    all_users = after.join(others)
    assert contact_pairs(all_users)[1].tolist() == []


@pytest.mark.parametrize("kind", list(RoadUserType))
def test_many_that_leave_at_once_do_not_land_on_each_other(kind: RoadUserType) -> None:
    roadmap, points = scene("intersection")
    x1 = roadmap.bounds[2]
    before = world([(int(kind), x1 + 1 + i, 97.0, 0.0, 3.0) for i in range(5)])
    after = reinsert(before, np.ones(5, np.bool_), empty_world(), points, roadmap)
    check_apart(after, empty_world())
    assert (after.x < 100).all()


def entry(points: LanePoints, roadmap: RoadMap, heading: float) -> NDArray[np.intp]:
    """Points of the lanes that lead in `heading`, those at the edge of the scene first."""
    same = np.flatnonzero(np.abs(wrap_angle(points.heading - heading)) < 0.3)
    along = np.cos(heading) * points.x[same] + np.sin(heading) * points.y[same]
    return np.asarray(same[np.argsort(along)], np.intp)


@pytest.mark.parametrize("name", ["intersection", "shared-space"])
@pytest.mark.parametrize("kind", list(RoadUserType))
@pytest.mark.parametrize("other", list(RoadUserType))
def test_no_road_user_lands_on_one_that_stands_at_the_entry(name: str, kind: RoadUserType, other: RoadUserType) -> None:
    roadmap, points = scene(name)
    rows = entry(points[other], roadmap, 0.0)[:36:12]  # wide lanes have several points side by side
    standing = world([(int(other), points[other].x[r], points[other].y[r], 0.0, 0.0) for r in rows])
    before = world([(int(kind), roadmap.bounds[2] + 1, 98.0, 0.0, 3.0)])
    for crowd in ((before, standing), (before.join(standing), empty_world())):
        gone = np.arange(len(crowd[0])) == 0
        check_apart(reinsert(crowd[0], gone, crowd[1], points, roadmap), crowd[1])


def test_a_jam_over_all_near_entries_is_not_landed_on() -> None:
    """Every entry in reach is taken: then elsewhere, but never onto another road user."""
    roadmap, points = scene("intersection")
    rows = entry(points[0], roadmap, 0.0)[:40:3]
    jam = world([(0, points[0].x[r], points[0].y[r], 0.0, 0.0) for r in rows])
    assert len(contact_pairs(jam)[1]) == 0
    before = world([(0, roadmap.bounds[2] + 1, 98.4, 0.0, 3.0)])
    check_apart(reinsert(before, np.ones(1, np.bool_), jam, points, roadmap), jam)


def test_no_road_user_lands_on_a_long_bus() -> None:
    roadmap, points = scene("intersection")
    row = entry(points[0], roadmap, 0.0)[6]
    bus = world([(0, points[0].x[row], points[0].y[row], 0.0, 0.0)], length=24.0)
    before = world([(0, roadmap.bounds[2] + 1, 98.4, 0.0, 3.0)])
    check_apart(reinsert(before, np.ones(1, np.bool_), bus, points, roadmap), bus)


def test_a_fast_car_returns_with_the_room_to_stop_behind_a_queue_and_to_be_followed() -> None:
    """Behind a queue at the entry, at 14 m/s, it would need 63 m; before a fast follower it must not be slow."""
    roadmap, points = scene("intersection")
    rows = entry(points[0], roadmap, 0.0)
    along = points[0].x[rows]
    queue = [(0, along.min() + 30.0 + 7.0 * i, points[0].y[rows[0]], 0.0, 0.0) for i in range(3)]
    leaver = (0, roadmap.bounds[2] + 1, 98.4, 0.0, 13.9)
    after = reinsert(world([leaver, *queue]), np.arange(4) == 0, empty_world(), points, roadmap)
    ahead, aside = to_ego(after.x[1:] - after.x[0], after.y[1:] - after.y[0], after.heading[0])
    before_it = (ahead > 0.0) & (np.abs(aside) < 1.5)
    if before_it.any():
        gap = ahead[before_it].min() - 5.0
        assert after.speed[0] + after.speed[0] ** 2 / 4.0 <= gap + 0.1
    assert after.speed[0] > 1.0
    # It may not stand, or crawl, 15 m before one that goes at 13.9 m/s.
    follower = (0, along.min(), points[0].y[rows[0]], 0.0, 13.9)
    slow = (0, roadmap.bounds[2] + 1, 98.4, 0.0, 2.0)
    after = reinsert(world([slow, follower]), np.arange(2) == 0, empty_world(), points, roadmap)
    ahead, aside = to_ego(after.x[0] - after.x[1:], after.y[0] - after.y[1:], 0.0)
    assert abs(aside[0]) > 1.5 or ahead[0] < 0.0 or ahead[0] - 5.0 >= 13.9 + (13.9**2 - 4.0) / 4.0 - 0.1


def test_driving_off_the_end_of_a_street_is_leaving_and_leaving_it_sideways_is_not() -> None:
    with SumoSession(find_scenario("district")) as session:
        network = session.network
        roadmap = RoadMap(network.surfaces())
    exits = network.exits
    # Streets end at the rim only, with lanes in and out.
    assert len(exits) >= 8
    x, y, heading, half = exits.T

    def at(ahead: float, aside: NDArray[np.float64]) -> WorldState:
        ex, ey = from_ego(np.full(len(x), ahead), aside, heading)
        return world([(0, a, b, h, 5.0) for a, b, h in zip(x + ex, y + ey, heading, strict=True)])

    none = np.zeros(len(x))
    assert left_scene(at(4.0, none), roadmap, exits).all()
    before = at(-4.0, none)
    assert (roadmap.surface_at(before.x, before.y) != Surface.NONE).all()
    assert not left_scene(before, roadmap, exits).any()
    beside = at(-4.0, half + 9.0)
    off = roadmap.surface_at(beside.x, beside.y) == Surface.NONE
    assert off.any()
    assert (left_scene(beside, roadmap, exits) == left_scene(beside, roadmap)).all()


@pytest.mark.parametrize("name", ["intersection", "shared-space"])
def test_a_new_start_is_free_on_a_lane_and_can_stop(name: str) -> None:
    _, points = scene(name)
    random = np.random.default_rng(2)
    rows: list[Row] = []
    for kind, source in enumerate(points):
        rows += [(kind, source.x[i], source.y[i], source.heading[i], 1.0) for i in random.integers(0, len(source), 12)]
    before = world(rows)
    chosen = np.arange(0, len(before), 2)
    max_speed = np.array([14.0, 7.0, 1.8])
    after = start_anew(before, chosen, empty_world(), points, max_speed, np.random.default_rng(3))
    stayed = np.setdiff1d(np.arange(len(before)), chosen)
    np.testing.assert_array_equal(after.x[stayed], before.x[stayed])
    assert (after.speed[chosen] > 0).all()
    assert (after.speed[chosen] <= 0.5 * max_speed[after.type[chosen]]).all()
    touching = {tuple(pair) for pair in contact_pairs(after)[1].tolist()}
    assert touching <= {tuple(pair) for pair in contact_pairs(before)[1].tolist()}
    for row in chosen:
        assert np.hypot(points[after.type[row]].x - after.x[row], points[after.type[row]].y - after.y[row]).min() < 1e-9
        # Others that were put down later took account of this one, so the gap at the end is the gap that counted.
        ahead, aside = to_ego(after.x - after.x[row], after.y - after.y[row], after.heading[row])
        same = (np.abs(wrap_angle(after.heading - after.heading[row])) < 0.1) & (np.abs(aside) < 1.0) & (ahead > 0.0)
        for leader in np.flatnonzero(same):
            gap = ahead[leader] - 0.5 * (after.length[row] + after.length[leader])
            assert after.speed[row] + (after.speed[row] ** 2 - after.speed[leader] ** 2) / 4.0 <= gap + 0.1
    again = start_anew(before, chosen, empty_world(), points, max_speed, np.random.default_rng(3))
    np.testing.assert_array_equal(again.x, after.x)
