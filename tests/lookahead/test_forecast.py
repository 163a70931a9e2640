"""Where road users are expected: on paths by interpolation, beside them as `advance` does."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_crowd, make_routes, make_world

from slrl_sumo.lookahead.collision import MARGIN
from slrl_sumo.lookahead.forecast import PathFollowing, bring_to_paths, forecast_boxes, path_following
from slrl_sumo.lookahead.mode_paths import STEPS, mode_paths
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

BACK = 1.0 - np.arange(1, STEPS + 1) / STEPS


def routed(users: WorldState, n: int) -> RouteAhead:
    """Paths of the first `n`, that wind away from where they are."""
    along = SPACING * (np.arange(POINTS) - HERE)
    heading = users.heading[:n, None] + 0.03 * along
    x = users.x[:n, None] + SPACING * np.cumsum(np.cos(heading), axis=1)
    y = users.y[:n, None] + SPACING * np.cumsum(np.sin(heading), axis=1)
    stop = np.random.default_rng(3).uniform(-1.0, 30.0, n)
    return make_routes(x, y, stop=stop)


def shifted(route: RouteAhead, along: Floats, shift: Floats) -> tuple[Floats, ...]:
    """x, y, cos and sin `along` (n, m) metres on, `shift` to the left; beyond its ends a path goes straight on."""
    place = along / SPACING + HERE
    begin = np.clip(np.floor(place).astype(np.intp), 0, POINTS - 2)
    row, share = np.arange(len(route))[:, None], place - begin
    x0, y0 = route.x[row, begin], route.y[row, begin]
    dx, dy = route.x[row, begin + 1] - x0, route.y[row, begin + 1] - y0
    x, y, heading = x0 + share * dx, y0 + share * dy, np.arctan2(dy, dx)
    return x - shift * np.sin(heading), y + shift * np.cos(heading), np.cos(heading), np.sin(heading)


def test_vehicles_on_their_path_keep_to_it() -> None:
    car = replace(make_crowd(5, 1, 1.0), type=np.array([0, 0, 1, 2, 0], np.int8), x=np.zeros(5))
    # On it, beside it but along it, beside it and askew, on foot, without a route.
    car = replace(car, y=np.array([0.2, -3.0, 3.0, 0.0, 0.0]), heading=np.array([1.0, 0.3, -0.4, 0.0, 0.0]))
    route = make_routes(np.tile(ALONG, (5, 1)), known=[True, True, True, True, False])
    kept = path_following(route_context(route, car), car)
    assert kept.follows.tolist() == [True, True, False, False, False]
    np.testing.assert_allclose(kept.lateral_offset[:2], [0.2, -3.0])


def test_mode_paths_along_routes_are_those_of_the_path() -> None:
    users = make_crowd(12, 2, 80.0)
    route, rows = routed(users, 12), np.array([7, 0, 3, 11, 4])
    keeps, beside = np.arange(12) % 4 != 0, np.linspace(-2.0, 2.0, 12)
    acceleration, yaw_rate = np.random.default_rng(4).normal(0.0, 1.5, (2, 5, 6))
    # Some get beyond the end of their path.
    quick = replace(users.take(rows), speed=np.array([0.0, 3.0, 6.0, 9.0, 16.0]))
    free = mode_paths(quick, acceleration, yaw_rate, np.full(5, 20.0), on_route=True)
    found = mode_paths(quick, acceleration, yaw_rate, np.full(5, 20.0), on_route=True)
    bring_to_paths(found, PathFollowing(keeps, beside, route.stop, route.x, route.y, route.spacing), rows)
    for k, row in enumerate(rows):
        own, way = route.take(rows[k : k + 1]), free.distance[k].reshape(1, -1)
        shift = beside[row] * np.repeat(BACK, 6)[None]
        kept = shifted(own, way, shift) if keeps[row] else (free.x[k], free.y[k], free.cos[k], free.sin[k])
        for name, values in zip(("x", "y", "cos", "sin"), kept, strict=True):
            np.testing.assert_allclose(getattr(found, name)[k].ravel(), values.ravel(), atol=1e-9)
    assert free.distance.max() > (POINTS - HERE) * SPACING
    np.testing.assert_array_equal(found.speed, free.speed)


def test_others_go_on_as_they_are_or_along_their_paths_up_to_lines() -> None:
    world = make_crowd(20, 5, 80.0)
    route = routed(world, 12)
    keeps, beside = np.arange(12) % 3 != 0, np.linspace(-2.0, 2.0, 12)
    margin = MARGIN[world.type]
    found = forecast_boxes(world, PathFollowing(keeps, beside, route.stop, route.x, route.y, route.spacing), margin)
    straying = forecast_boxes(world, path_following(None, world), margin)
    np.testing.assert_allclose(found.size[:, 0], world.length + MARGIN[world.type])
    np.testing.assert_allclose(found.size[:, 1], world.width + MARGIN[world.type])
    for step in range(STEPS):
        seconds = (step + 1) * DECISION_INTERVAL
        moved = advance(world, np.zeros(20), world.yaw_rate, np.full(20, np.inf), seconds)
        ends = moved.x, moved.y, np.cos(moved.heading), np.sin(moved.heading)
        driven = np.minimum(world.speed[:12] * seconds, np.maximum(route.stop, 0.0))
        on_path = shifted(route, driven[:, None], BACK[step] * beside[:, None])
        for name, free, kept in zip(("x", "y", "cos", "sin"), ends, on_path, strict=True):
            np.testing.assert_allclose(getattr(straying, name)[:, step], free, atol=1e-9)
            np.testing.assert_allclose(
                getattr(found, name)[:12, step], np.where(keeps, kept[:, 0], free[:12]), atol=1e-9
            )
            np.testing.assert_allclose(getattr(found, name)[12:, step], free[12:], atol=1e-9)


def test_fast_vehicles_are_forecast_along_their_path_as_far_as_they_get() -> None:
    # 33 m/s through a left turn of 500 m: after 3.2 s it is 11.1 m beside the straight line.
    car, spacing = make_world([0.0], [0.0], speed=33.0), spacing_at(33.0)
    angle = spacing * np.arange(-HERE, POINTS - HERE) / 500.0
    route = make_routes(500.0 * np.sin(angle), 500.0 * (1.0 - np.cos(angle)), spacing=spacing, stop=np.inf)
    found = forecast_boxes(car, path_following(route_context(route, car), car), MARGIN[car.type])
    way = 33.0 * DECISION_INTERVAL * STEPS
    assert found.y[0, -1] == pytest.approx(500.0 * (1.0 - np.cos(way / 500.0)), abs=0.1)
    assert np.arctan2(found.sin[0, -1], found.cos[0, -1]) == pytest.approx(way / 500.0, abs=0.01)
