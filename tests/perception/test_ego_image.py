"""The ego image: geometry, colours, and independence of tiles, order and batch."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from builders import make_crowd, straight_routes
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import Area, Ribbon, RoadMap, Surface, SurfaceShapes
from slrl_sumo.perception import ego_image as raster
from slrl_sumo.perception.ego_image import ego_images, ego_picture
from slrl_sumo.scene.route import HERE, POINTS, RouteAhead
from slrl_sumo.scene.state import WorldState

CAR, BICYCLE, PEDESTRIAN = 0, 1, 2
WHITE, YELLOW, BLACK = [255, 255, 255], [255, 255, 0], [0, 0, 0]
RED, GREEN, BLUE = [255, 0, 0], [0, 255, 0], [0, 0, 255]
GROUNDLESS = RoadMap(SurfaceShapes(()))
Worlds = Callable[..., WorldState]
Routes = Callable[..., RouteAhead]


def image(world: WorldState, roadmap: RoadMap, row: int = 0, route: RouteAhead | None = None) -> NDArray[np.uint8]:
    return ego_images(world, np.array([row]), roadmap, route)[0]


def everyone(world: WorldState) -> NDArray[np.intp]:
    return np.arange(len(world))


def centre_of(weight: NDArray[np.uint8]) -> tuple[float, float]:
    """Centre of mass in the ego frame: m ahead, m to the left."""
    rows, cols = np.indices(weight.shape)
    total = weight.astype(float)
    return float((total * (cols + 0.5)).sum() / total.sum()) - 8, 10 - float((total * (rows + 0.5)).sum() / total.sum())


def test_a_straight_road_has_its_width(place: Worlds, street: SurfaceShapes) -> None:
    seen = image(place([(CAR, 100, 0, 0)]), RoadMap(street))
    assert seen.shape == (20, 40, 3)
    assert seen.dtype == np.uint8
    ahead = seen[:, 13:].astype(int)
    white = (ahead == WHITE).all(axis=2)
    assert white.sum() == 8 * 27  # 8 m wide, 27 m long
    assert white[6:14].all()
    assert (ahead[[4, 15]] == BLACK + np.array(YELLOW)).all()  # the pavements begin 4 m from the middle
    assert (ahead[[0, 1, 2, 17, 18, 19]] == BLACK).all()


def test_width_and_length_of_the_road_in_any_direction(place: Worlds) -> None:
    for angle in np.linspace(-np.pi, np.pi, 12):
        line = np.outer([-50.0, 15.0], [np.cos(angle), np.sin(angle)])
        shapes = SurfaceShapes((Ribbon(Surface.ROAD, line, 6.0),))
        seen = image(place([(PEDESTRIAN, 0, 0, angle)]), RoadMap(shapes))[:, 10:]
        # 13 m of road ahead of column 10 (2 m ahead); borders of a tile's pixel may be painted outside.
        assert seen[:, :, 1].sum() / 255 == pytest.approx(6.0 * 13.0, abs=0.25 * (2 * 13 + 6))
        assert seen[:, :, 1].sum() / 255 >= 6.0 * 13.0 - 1.5


def test_crossings_and_cycle_lanes_are_road_pavements_are_yellow(place: Worlds) -> None:
    squares = tuple(
        Area(surface, np.array([(x, -2.0), (x + 4, -2.0), (x + 4, 2.0), (x, 2.0)]))
        for x, surface in ((6.0, Surface.CROSSING), (12.0, Surface.CYCLEWAY), (18.0, Surface.SIDEWALK))
    )
    seen = image(place([(PEDESTRIAN, 0, 0, 0)]), RoadMap(SurfaceShapes(squares)))
    assert [seen[10, 8 + x].tolist() for x in (8, 14, 20, 26)] == [WHITE, WHITE, YELLOW, BLACK]


def test_left_is_up_and_ahead_is_right(place: Worlds) -> None:
    for heading in (0.0, np.pi / 2, -2.0):
        c, s = np.cos(heading), np.sin(heading)
        # 10 m ahead, 4 m to the left, same direction
        x, y = 50 + 10 * c - 4 * s, -20 + 10 * s + 4 * c
        seen = image(place([(PEDESTRIAN, 50, -20, heading), (CAR, x, y, heading)]), GROUNDLESS)
        assert centre_of(seen[:, :, 0]) == (pytest.approx(10, abs=0.35), pytest.approx(4, abs=0.35))
        assert seen[5:7, 17:20, 0].min() > 100
        assert seen[8:, :, 0].max() == 0
        # The ego itself, in its own colour, at its place.
        assert centre_of(seen[:, :, 1]) == (pytest.approx(0, abs=0.35), pytest.approx(0, abs=0.35))


@pytest.mark.parametrize(("kind", "channel", "area"), [(CAR, 0, 5 * 1.8), (BICYCLE, 2, 1.6 * 1), (PEDESTRIAN, 1, 1.0)])
def test_road_users_are_seen_in_their_colour_and_about_their_size(
    place: Worlds, kind: int, channel: int, area: float
) -> None:
    rng = np.random.default_rng(kind)
    areas, extents = [], []
    for _ in range(50):
        other = (kind, rng.uniform(8, 24), rng.uniform(-4, 4), rng.uniform(-np.pi, np.pi))
        seen = image(place([(CAR if kind else PEDESTRIAN, 0, 0, 0), other]), GROUNDLESS)
        areas.append(seen[:, :, channel].sum() / 255)
        assert seen[:, :, channel].max() >= 127
        assert centre_of(seen[:, :, channel]) == (pytest.approx(other[1], abs=0.4), pytest.approx(other[2], abs=0.4))
        rows, cols = np.nonzero(seen[:, :, channel])
        extents.append(np.hypot(np.ptp(rows) + 1, np.ptp(cols) + 1))
    # Lines have the thickness nearest to the box width, 1.45 m at least, and round ends.
    assert 0.7 * area < np.mean(areas) < 1.7 * area
    assert max(areas) - min(areas) < 0.4 * max(areas)
    assert max(extents) < np.hypot(*((5, 1.8) if kind == CAR else (1.6, 1.4))) + 3


@pytest.mark.parametrize("vulnerable", [BICYCLE, PEDESTRIAN])
@pytest.mark.parametrize("vulnerable_first", [False, True])
def test_cars_never_hide_vulnerable_road_users(place: Worlds, vulnerable: int, vulnerable_first: bool) -> None:
    pair = [(vulnerable, 12.0, 0.0, 0.0), (CAR, 12.0, 0.0, 0.0)]
    ego = (CAR, 0.0, 0.0, 0.0)
    seen = image(place([ego, *(pair if vulnerable_first else pair[::-1])]), GROUNDLESS)
    alone = image(place([ego, pair[0]]), GROUNDLESS)
    channel = GREEN.index(255) if vulnerable == PEDESTRIAN else BLUE.index(255)
    assert np.array_equal(seen[:, :, channel], alone[:, :, channel])
    assert seen[:, 15:, channel].max() >= 127
    assert seen[:, 15:, 0].max() == 255  # the car sticks out


@pytest.mark.parametrize("ego_heading", [0.0, 2.5])
def test_a_nose_to_the_left_points_up(place: Worlds, ego_heading: float) -> None:
    x, y = 15 * np.cos(ego_heading), 15 * np.sin(ego_heading)
    for turn in (0.6, -0.6):
        world = place([(PEDESTRIAN, 0, 0, ego_heading), (CAR, x, y, ego_heading + turn)])
        rows, cols = np.nonzero(image(world, GROUNDLESS)[:, :, 0])
        slope = -np.polyfit(cols, rows, 1)[0]  # rows grow to the right of the ego
        assert slope == pytest.approx(np.tan(turn), abs=0.3)


def test_a_box_beside_the_view_shows_the_side_that_reaches_in(place: Worlds) -> None:
    # Centre lines 90 cm outside, half widths 1.2 m.
    world = place([(PEDESTRIAN, 0, 0, 0), (CAR, 15, 10.9, 0), (CAR, 15, -10.9, 0)], np.full(3, 5.0), np.full(3, 2.4))
    seen = image(world, GROUNDLESS)[:, :, 0]
    assert seen[0, 22:24].min() >= 64
    assert seen[19, 22:24].min() >= 64
    assert seen[1:19].max() == 0


def test_a_long_box_whose_centre_is_outside_is_seen(place: Worlds) -> None:
    # A tram of 30 m, centre 40 m ahead, its tail at 25 m; and one across, centre 20 m to the left, its end at 5 m.
    size = np.array([5.0, 30.0, 30.0]), np.array([1.8, 2.65, 2.65])
    seen = image(place([(CAR, 0, 0, 0), (CAR, 40, 0, 0), (CAR, 15, 20, np.pi / 2)], *size), GROUNDLESS)[:, :, 0]
    assert (seen[9:11, 34:] == 255).all()
    assert seen[9:11, 12:32].max() == 0
    assert (seen[:5, 23] == 255).all()
    assert seen[6:9, 20:26].max() == 0


def rotated(
    shapes: SurfaceShapes, world: WorldState, angle: float, shift: NDArray[np.float64]
) -> tuple[RoadMap, WorldState]:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = []
    for shape in shapes.shapes:
        points = shape.points @ turn + shift
        turned.append(
            Ribbon(shape.surface, points, shape.width) if isinstance(shape, Ribbon) else Area(shape.surface, points)
        )
    x, y = (np.column_stack([world.x, world.y]) @ turn + shift).T
    return RoadMap(SurfaceShapes(tuple(turned))), replace(world, x=x, y=y, heading=world.heading + angle)


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, 2.0, np.pi, -1.1])
def test_a_turned_world_looks_the_same(street: SurfaceShapes, angle: float) -> None:
    world = make_crowd(60, 3, 100.0, -50.0)
    before = ego_images(world, everyone(world), RoadMap(street)).astype(float)
    roadmap, turned = rotated(street, world, angle, np.array([211.3, -77.7]))
    after = ego_images(turned, everyone(turned), roadmap).astype(float)
    assert before.mean() > 40
    # Borders are smoothed differently: nothing but single steps of a fine pixel.
    difference = np.abs(before - after)
    assert difference.mean() < 4
    assert np.mean(difference > 130) < 0.005


def test_images_do_not_depend_on_tiles(street: SurfaceShapes) -> None:
    world = make_crowd(150, 4, 300.0, -150.0)  # over nine cores
    tiled = ego_images(world, everyone(world), RoadMap(street))
    whole = ego_images(world, everyone(world), RoadMap(street, core=2048.0))
    assert np.mean(tiled != whole) < 1e-3
    tight = ego_images(world, everyone(world), RoadMap(street, memory_limit=1))
    assert np.array_equal(tiled, tight)


def test_a_neighbour_in_the_next_tile_is_seen(place: Worlds, street: SurfaceShapes) -> None:
    # The core ends at x = 128 m.
    world = place([(CAR, 120, 0, 0), (PEDESTRIAN, 135, 2, 0)])
    seen = image(world, RoadMap(street))
    assert seen[7:9, 22:24, 1].max() == 255
    assert seen[7:9, 22:24, 0].min() < 100  # green, not the road's white
    assert (seen[10:14, 13:] == WHITE).all()


def test_ground_in_the_next_tile_is_seen(place: Worlds) -> None:
    for angle, (x, y) in ((0.0, (127.0, 64.0)), (np.pi / 2, (64.0, 127.0)), (np.pi, (1.0, 64.0))):
        centre = np.array([x + 29 * np.cos(angle), y + 29 * np.sin(angle)])
        corners = centre + 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        shapes = SurfaceShapes((Area(Surface.SIDEWALK, corners),))
        seen = image(place([(CAR, x, y, angle)]), RoadMap(shapes))
        assert (seen[8:12, 35:39] == YELLOW).all()
        assert (seen[:, 15:34] == BLACK).all()


def test_a_view_is_the_same_alone_and_among_others(street: SurfaceShapes) -> None:
    # Crowded, so that lines leave every view at every side: none may show in the view above or below.
    roadmap = RoadMap(street)
    world = make_crowd(300, 5, 60.0, -30.0)
    together = ego_images(world, everyone(world), roadmap)
    apart = np.stack([image(world, roadmap, row) for row in everyone(world)])
    assert np.array_equal(together, apart)


@pytest.mark.parametrize("width", [0.3, 2.5, 20.0])
def test_wide_boxes_do_not_leak_either(place: Worlds, width: float) -> None:
    base = make_crowd(120, 6, 60.0, -30.0)
    rows = np.column_stack([np.zeros(120), base.x, base.y, base.heading])
    world = place(rows, np.full(120, 14.0), np.full(120, width))
    together = ego_images(world, everyone(world), GROUNDLESS)
    assert np.array_equal(together, np.stack([image(world, GROUNDLESS, row) for row in everyone(world)]))


def test_batches_do_not_matter(street: SurfaceShapes, monkeypatch: pytest.MonkeyPatch) -> None:
    world, roadmap = make_crowd(40, 7, 60.0, -30.0), RoadMap(street)
    at_once = ego_images(world, everyone(world), roadmap)
    monkeypatch.setattr(raster, "VIEWS_AT_ONCE", 7)
    assert np.array_equal(ego_images(world, everyone(world), roadmap), at_once)


def test_the_order_of_the_world_does_not_matter(street: SurfaceShapes) -> None:
    world, roadmap = make_crowd(100, 8, 60.0, -30.0), RoadMap(street)
    order = np.random.default_rng(0).permutation(100)
    assert np.array_equal(ego_images(world.take(order), everyone(world), roadmap), ego_images(world, order, roadmap))


def test_one_alone_and_none(place: Worlds, street: SurfaceShapes) -> None:
    nowhere = image(place([(BICYCLE, 9000, 0, 0)]), RoadMap(street))
    assert nowhere[:, :, 2].max() > 180
    assert nowhere[:, :, :2].max() == 0
    assert (nowhere[:, 11:] == 0).all()
    for world in (place([]), place([(CAR, 0, 0, 0)])):
        assert ego_images(world, np.zeros(0, np.intp), RoadMap(street)).shape == (0, 20, 40, 3)


@pytest.mark.parametrize("heading", [0.0, 1.2, -2.7])
@pytest.mark.parametrize("aside", [4.0, -6.0])
def test_the_path_lies_ahead_in_magenta_a_metre_wide(place: Worlds, heading: float, aside: float) -> None:
    x, y = 50.0 - aside * np.sin(heading), -20.0 + aside * np.cos(heading)
    world = place([(PEDESTRIAN, 50.0, -20.0, heading)])
    seen = image(world, GROUNDLESS, route=straight_routes((x, y, heading)))
    # Red and blue are the path's alone: the pedestrian is green.
    assert np.array_equal(seen[:, :, 0], seen[:, :, 2])
    assert not seen[seen[:, :, 0] > 0][:, 1].any()
    # From beside the road user to the end of the view, 32 m.
    assert centre_of(seen[:, :, 0]) == (pytest.approx(16.0, abs=0.5), pytest.approx(aside, abs=0.35))
    assert seen[:, :, 0].sum() / 255 == pytest.approx(32 * 1.4, rel=0.25)
    assert seen[:, 9:, 0].max(axis=0).min() >= 127
    assert seen[:, :7, 0].max() == 0
    assert image(world, GROUNDLESS)[:, :, [0, 2]].max() == 0


def test_the_path_turns_where_the_route_does(
    place: Worlds,
) -> None:
    world = place([(PEDESTRIAN, 0.0, 0.0, 0.0)])
    left, right = (
        image(world, GROUNDLESS, route=straight_routes((0.0, 0.0, 0.0), turn=turn, after=15))[:, :, 2]
        for turn in (np.pi / 2, -np.pi / 2)
    )
    for seen, beside in ((left, slice(0, 9)), (right, slice(11, 20))):
        assert seen[beside, 22:24].max(axis=1).min() >= 127
        assert seen[:, 25:].max() == 0
        assert seen[beside, :21].max() == 0
        assert seen[9:11, 9:22].max(axis=0).min() >= 127


def test_road_users_lie_on_the_path_and_the_path_on_the_ground(place: Worlds, street: SurfaceShapes) -> None:
    users = [(CAR, 100.0, 0.0, 0.0), (PEDESTRIAN, 115.0, 0.0, 0.0), (CAR, 125.0, 0.0, 0.0)]
    world = place(users, np.array([5.0, 3.0, 5.0]), np.full(3, 2.4))
    with_path = image(world, RoadMap(street), route=straight_routes((100.0, 0.0, 0.0)))
    without = image(world, RoadMap(street))
    for col in range(12, 20):  # magenta on the white road, blended with it at the border
        assert [255, 0, 255] in with_path[9:11, col].tolist()
    # Road users hide what lies under them.
    for colour in (RED, GREEN):
        theirs = (without == colour).all(axis=2)
        assert theirs.any()
        assert np.array_equal(with_path[theirs], without[theirs])
    # And nothing elsewhere.
    assert np.array_equal(with_path[[*range(8), *range(12, 20)]], without[[*range(8), *range(12, 20)]])


def test_with_a_route_crossings_and_cycle_lanes_have_their_own_colours(
    place: Worlds,
) -> None:
    squares = tuple(
        Area(surface, np.array([(x, -2.0), (x + 4, -2.0), (x + 4, 2.0), (x, 2.0)]))
        for x, surface in (
            (4.0, Surface.ROAD),
            (10.0, Surface.CROSSING),
            (16.0, Surface.CYCLEWAY),
            (22.0, Surface.SIDEWALK),
        )
    )
    roadmap, world = RoadMap(SurfaceShapes(squares)), place([(PEDESTRIAN, 0, 0, 0)])
    for route in (straight_routes((0.0, 9.0, 0.0)), RouteAhead.unknown(1)):
        seen = image(world, roadmap, route=route)
        colours = [seen[10, 8 + x].tolist() for x in (6, 12, 18, 24, 30)]
        assert colours == [WHITE, [160, 160, 160], [0, 255, 255], YELLOW, BLACK]
    plain = image(world, roadmap)
    assert [plain[10, 8 + x].tolist() for x in (6, 12, 18)] == [WHITE, WHITE, WHITE]


def wild_routes(world: WorldState, seed: int) -> RouteAhead:
    """Winding paths that leave the views at every side, some begin far beside them; a third have none."""
    rng, n = np.random.default_rng(seed), len(world)
    direction = world.heading[:, None] + rng.normal(0.0, 1.0, (n, 1)) + rng.normal(0.0, 0.3, (n, POINTS)).cumsum(axis=1)
    route = RouteAhead.unknown(n)
    for line, begin, step in ((route.x, world.x, np.cos(direction)), (route.y, world.y, np.sin(direction))):
        line[:] = step.cumsum(axis=1)
        line += (begin + rng.normal(0.0, 8.0, n))[:, None] - line[:, HERE : HERE + 1]
    return replace(route, known=rng.random(n) < 0.67)


def test_a_path_is_the_same_alone_and_among_others(street: SurfaceShapes, monkeypatch: pytest.MonkeyPatch) -> None:
    world, roadmap = make_crowd(120, 9, 60.0, -30.0), RoadMap(street)
    route = wild_routes(world, 1)
    together = ego_images(world, everyone(world), roadmap, route)
    apart = [image(world, roadmap, row, route.take(np.array([row]))) for row in everyone(world)]
    assert np.array_equal(together, np.stack(apart))
    bare = ego_images(world, everyone(world), roadmap, RouteAhead.unknown(120))
    drawn = (together != bare).any(axis=(1, 2, 3))
    # Whose route is not known sees no path, not even that of a neighbour; all others do, but for paths beside the view.
    assert not drawn[~route.known].any()
    assert drawn[route.known].mean() > 0.8
    order = np.random.default_rng(2).permutation(120)[:50]
    assert np.array_equal(ego_images(world, order, roadmap, route.take(order)), together[order])
    monkeypatch.setattr(raster, "VIEWS_AT_ONCE", 7)
    assert np.array_equal(ego_images(world, everyone(world), roadmap, route), together)


def test_a_picture_enlarges_every_pixel() -> None:
    small = np.arange(20 * 40 * 3, dtype=np.uint8).reshape(20, 40, 3)
    large = ego_picture(small, scale=4)
    assert large.shape == (80, 160, 3)
    assert np.array_equal(large[3::4, ::4], small)
    assert np.array_equal(large[::4, 3::4], small)
