"""Mode paths off the own surface, against a look at every place."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_crowd, make_routes, make_world

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE, Area, Surface, SurfaceShapes
from slrl_sumo.lookahead.mode_paths import STEPS, mode_paths
from slrl_sumo.lookahead.off_surface import FOREIGN, NEAR, OWN, WALK, distance_off, off_surface
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead
from slrl_sumo.scene.types import RoadUserType

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
ROAD, SIDEWALK = Area(Surface.ROAD, 30.0 * SQUARE), Area(Surface.SIDEWALK, 30.0 * SQUARE + np.array([30.0, 0.0]))
CROSSING = Area(Surface.CROSSING, 30.0 * SQUARE + np.array([0.0, 30.0]))
GROUND = RoadMap(SurfaceShapes((ROAD, SIDEWALK, CROSSING)))


def test_places_off_the_own_surface_are_counted() -> None:
    world = make_crowd(40, 1, 60.0)
    rows = np.random.default_rng(2).permutation(40)[:30]
    me = world.take(rows)
    acceleration, yaw_rate = np.random.default_rng(3).normal(0.0, 1.0, (2, 30, 5))
    free = mode_paths(me, acceleration, yaw_rate, np.full(30, 12.0), on_route=True)
    route = make_routes(world.x[:, None] + ALONG, world.y[:, None], known=np.arange(40) % 3 != 0)
    # Without routes all intervals count, and the ground alone.
    for known, given in ((np.zeros(40, np.bool_), None), (route.known, route)):
        found = off_surface(free, me.type, GROUND, rows, given)
        excused = 0
        for i, row in enumerate(rows):
            own = OWN[WALK if known[row] and me.type[i] == RoadUserType.PEDESTRIAN else me.type[i]]
            for mode in range(5):
                off = ~own[GROUND.surface_at(free.x[i, :, mode], free.y[i, :, mode])]
                if known[row]:
                    point = np.minimum(HERE + np.rint(free.distance[i, :, mode] / SPACING).astype(np.intp), POINTS - 1)
                    path = GROUND.surface_at(route.x[row, point], route.y[row, point])
                    on_some = GROUND.surface_at(free.x[i, :, mode], free.y[i, :, mode]) != Surface.NONE
                    right = ~own[path] & (on_some | (path == Surface.NONE))
                    excused += int((off & right)[:NEAR].sum())
                    off = (off & ~right)[:NEAR]
                counts = off.astype(np.float64)
                if known[row]:
                    places = free.x[i, :NEAR, mode][off], free.y[i, :NEAR, mode][off]
                    foreign = OWN_SURFACE[me.type[i], GROUND.surface_at(*places)]
                    counts[off] = np.where(foreign, FOREIGN, distance_off(GROUND, me.type[[i] * off.sum()], *places))
                assert found[i, mode] == pytest.approx(counts.mean())
        assert 0.05 < (found > 0.0).mean() < 0.95
        assert len(np.unique(found)) >= NEAR
        assert bool(excused) == (given is not None)
    assert off_surface(free, me.type, GROUND, rows, None).shape == (30, 5)


def test_no_road_users_are_off_the_surface() -> None:
    no_users, none = make_crowd(0, 1, 1.0), np.zeros((0, 5))
    free = mode_paths(no_users, none, none, np.zeros(0), on_route=True)
    assert off_surface(free, no_users.type, GROUND, np.zeros(0, np.intp), RouteAhead.unknown(0)).shape == (0, 5)
    assert free.x.shape == (0, STEPS, 5)


def test_paths_that_are_nan_are_off_the_surface_without_a_route() -> None:
    users = replace(make_crowd(4, 1, 1.0), type=np.zeros(4, np.int8), x=np.full(4, 10.0), y=np.full(4, 10.0))
    users = replace(users, speed=np.array([1.0, np.nan, np.inf, np.nan]))
    still = np.zeros((4, 2))
    free = mode_paths(users, still, still, np.full(4, np.inf), on_route=False)
    # Paths whose last points lie where there is no ground; the last road user has none.
    known, path = np.array([True, True, True, False]), np.full((4, POINTS), 15.0)
    path[:, -1] = -15.0
    route = make_routes(path, path, known=known)
    assert off_surface(free, users.type, GROUND, np.arange(4), route).tolist() == [[0.0] * 2] * 3 + [[1.0] * 2]


def test_a_crossing_belongs_to_pedestrians_whose_path_leads_over_it() -> None:
    world = make_world([15.0, 15.0], [31.0, 31.0], speed=1.0, type=RoadUserType.PEDESTRIAN)
    still = np.zeros((2, 1))
    free = mode_paths(world, still, still, np.full(2, 2.0), on_route=True)
    # That of the second one leads along the sidewalk.
    route = make_routes(np.array([[15.0], [45.0]]), np.array([[40.0], [20.0]]))
    assert off_surface(free, world.type, GROUND, np.arange(2), route) == pytest.approx(np.array([[0.0], [FOREIGN]]))


def test_places_count_the_more_the_farther_they_are_off() -> None:
    away = np.array([0.1, 0.4, 0.6, 0.9, 1.5, 5.0])
    for kind in (RoadUserType.PEDESTRIAN, RoadUserType.BICYCLE, RoadUserType.CAR):
        counts = distance_off(GROUND, np.full(6, kind, np.int8), -away, np.full(6, 15.0))
        assert counts.tolist() == [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
    # Sidewalks are no ground of cars, and on the own ground nothing is off.
    on_sidewalk = distance_off(GROUND, np.zeros(1, np.int8), np.array([30.4]), np.array([15.0]))
    assert on_sidewalk.tolist() == [0.5]


def test_a_pedestrian_off_the_ground_is_led_back_by_modes_that_come_nearer() -> None:
    """It is 0.9 m west of the carriageway on which its path leads; the modes go west, stand, and go east."""
    world = make_world(-0.9, 10.0, speed=1.2, heading=0.5 * np.pi, type=RoadUserType.PEDESTRIAN)
    still = np.zeros((1, 3))
    free = mode_paths(world, still, np.array([[1.5, 0.0, -1.5]]), np.full(1, 2.0), on_route=True)
    route = make_routes(5.0, np.array([[12.0]]))
    west, ahead, east = off_surface(free, world.type, GROUND, np.arange(1), route)[0]
    assert west >= ahead > east > 0.0


def test_a_path_over_the_carriageway_leads_off_no_ground() -> None:
    """The first pedestrian walks on the carriageway beside its path, the second one at the rim of the world."""
    world = make_world([10.0, -2.0], 10.0, speed=1.0, type=RoadUserType.PEDESTRIAN)
    still = np.zeros((2, 1))
    free = mode_paths(world, still, still, np.full(2, 2.0), on_route=True)
    route = make_routes(5.0, np.array([[12.0], [12.0]]))
    assert off_surface(free, world.type, GROUND, np.arange(2), route).tolist() == [[0.0], [1.0]]
