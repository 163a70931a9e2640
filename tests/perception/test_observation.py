"""Observations are the vector and the image of the same road users."""

import numpy as np
from builders import make_crowd, straight_routes

from slrl_sumo.ground.road_map import RoadMap, SurfaceShapes
from slrl_sumo.perception.ego_image import ego_images
from slrl_sumo.perception.features import features
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.perception.route_features import route_features
from slrl_sumo.perception.scene import Scene


def test_rows_belong_together(street: SurfaceShapes) -> None:
    world, roadmap, rows = make_crowd(30, 1, 40.0, -20.0), RoadMap(street), np.array([7, 3, 29])
    seen = observe(Scene(world, rows, roadmap))
    assert len(seen) == 3
    assert seen.type.tolist() == world.type[rows].tolist()
    assert np.array_equal(seen.vector, features(world, rows))
    assert seen.image is not None
    assert np.array_equal(seen.image, ego_images(world, rows, roadmap))


def test_without_looking_there_is_no_image(street: SurfaceShapes) -> None:
    world, roadmap, rows = make_crowd(30, 1, 40.0, -20.0), RoadMap(street), np.arange(30)
    blind = observe(Scene(world, rows, roadmap), with_image=False)
    assert blind.image is None
    assert np.array_equal(blind.vector, observe(Scene(world, rows, roadmap)).vector)
    assert roadmap.resident_bytes > 0


def test_no_road_users(street: SurfaceShapes) -> None:
    seen = observe(Scene(make_crowd(30, 1, 40.0, -20.0), np.zeros(0, np.intp), RoadMap(street)))
    assert len(seen) == 0
    assert seen.vector.shape == (0, 12)
    assert seen.image is not None
    assert seen.image.shape == (0, 20, 40, 3)


def test_a_known_route_is_seen_as_numbers_and_in_the_image(street: SurfaceShapes) -> None:
    world, roadmap, rows = make_crowd(30, 1, 40.0, -20.0), RoadMap(street), np.array([7, 3, 9])
    places = [(float(world.x[row]), float(world.y[row]), float(world.heading[row])) for row in range(10)]
    route = straight_routes(*places, stop=9.0)
    context = route_context(route, world)
    seen = observe(Scene(world, rows, roadmap, route), context=context)
    assert seen.image is not None
    assert seen.route is not None
    assert np.array_equal(seen.route, route_features(world.heading[rows], context.take(rows)))
    assert np.array_equal(seen.image, ego_images(world, rows, roadmap, route.take(rows)))
    paper = observe(Scene(world, rows, roadmap))
    assert paper.image is not None
    assert paper.route is None
    assert not np.array_equal(seen.image, paper.image)
    assert np.array_equal(seen.vector, paper.vector)
