"""The ground as pixels: what is painted where, in which tile, in how much memory."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.ground import tiles
from slrl_sumo.ground.road_map import Area, Ribbon, RoadMap, Surface, SurfaceShapes
from slrl_sumo.ground.shape_index import index_by_tile, piece_boxes
from slrl_sumo.ground.surfaces import paint

PIXEL = 0.25  # m, at the default 4 px/m
TILE = 896 * 896 // 2  # bytes: 128 m and twice 48 m of margin


def roadmap(*shapes: Ribbon | Area, **options: float) -> RoadMap:
    return RoadMap(SurfaceShapes(shapes), **options)  # type: ignore[arg-type]


def road(points: list[tuple[float, float]], width: float = 8.0, surface: Surface = Surface.ROAD) -> Ribbon:
    return Ribbon(surface, np.array(points, np.float64).reshape(-1, 2), width)


def square(x: float, y: float, half: float, surface: Surface) -> Area:
    return Area(
        surface, np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])
    )


def surfaces(where: RoadMap, *points: tuple[float, float]) -> list[int]:
    x, y = np.array(points, np.float64).T
    return where.surface_at(x, y).tolist()


def distance_to_segment(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.float64]:
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.hypot(*(points - a - along[:, None] * (b - a)).T)


def test_a_ribbon_is_as_wide_as_it_says_and_ends_straight() -> None:
    where = roadmap(road([(0.0, 0.0), (50.0, 0.0)]))
    inside = [(25.0, 3.9), (25.0, -3.9), (0.1, 3.9), (49.9, -3.9)]
    outside = [(25.0, 4.3), (25.0, -4.3), (-0.3, 0.0), (50.3, 0.0), (300.0, 0.0), (-5000.0, 70.0)]
    assert surfaces(where, *inside) == [Surface.ROAD] * 4
    assert surfaces(where, *outside) == [Surface.NONE] * 6


def test_joints_are_round_and_do_not_stick_out_at_the_ends() -> None:
    # A right turn whose last segment is shorter than half the width.
    where = roadmap(road([(0.0, 0.0), (20.0, 0.0), (20.0, -1.0)]))
    rim = 4.0 * np.sqrt(0.5)
    assert surfaces(where, (20.0 + rim - 0.2, rim - 0.2), (23.8, -0.9)) == [Surface.ROAD] * 2
    # Beyond the arc, below the butt end, behind the start.
    assert surfaces(where, (20.0 + rim + 0.3, rim + 0.3), (22.0, -1.3), (-0.3, 0.0)) == [Surface.NONE] * 3


def test_a_ribbon_that_begins_where_another_ends_is_painted() -> None:
    where = roadmap(road([(0, 0), (20, 0)]), road([(20, 0), (20, 30)], 4.0, Surface.SIDEWALK))
    assert surfaces(where, (10.0, 0.0), (20.0, 20.0)) == [Surface.ROAD, Surface.SIDEWALK]


@pytest.mark.parametrize("seed", range(5))
def test_a_winding_ribbon_covers_what_is_near_its_centre_line(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bearing = np.cumsum(rng.uniform(-0.6, 0.6, 30))
    line = np.cumsum(rng.uniform(5, 15, 30)[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1), axis=0)
    line += rng.uniform(-300, 300, 2)
    points = line[rng.integers(0, 30, 20000)] + rng.uniform(-12, 12, (20000, 2))
    distance = np.min([distance_to_segment(points, a, b) for a, b in pairwise(line)], axis=0)
    # Butt ends are tested above: leave out what lies round the two ends.
    ends = np.minimum(np.hypot(*(points - line[0]).T), np.hypot(*(points - line[-1]).T)) < 4.0
    found = roadmap(Ribbon(Surface.CYCLEWAY, line, 7.0)).surface_at(points[:, 0], points[:, 1])
    assert (found[(distance < 3.5 - PIXEL) & ~ends] == Surface.CYCLEWAY).all()
    assert (found[distance > 3.5 + 1.5 * PIXEL] == Surface.NONE).all()


def test_neighbouring_lanes_leave_no_gap() -> None:
    for angle in np.linspace(0.0, np.pi, 23):
        along, left = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        line = np.outer([0.0, 90.0], along) + np.array([3.3, 7.7])
        where = roadmap(Ribbon(Surface.ROAD, line + 1.6 * left, 3.2), Ribbon(Surface.ROAD, line - 1.6 * left, 3.2))
        seam = np.outer(np.arange(1.0, 89.0, 0.05), along) + np.array([3.3, 7.7])
        assert (where.surface_at(seam[:, 0], seam[:, 1]) == Surface.ROAD).all(), angle


def test_later_shapes_cover_earlier_ones() -> None:
    shapes = (
        square(0, 0, 10, Surface.ROAD),
        square(0, 0, 8, Surface.SIDEWALK),
        road([(-20, 0), (20, 0)], 4.0, Surface.CYCLEWAY),
        square(0, 0, 1, Surface.CROSSING),
    )
    at = [(9.0, 9.0), (7.0, 7.0), (7.0, 0.0), (15.0, 0.0), (0.0, 0.0), (15.0, 5.0)]
    order = [Surface.ROAD, Surface.SIDEWALK, Surface.CYCLEWAY, Surface.CYCLEWAY, Surface.CROSSING, Surface.NONE]
    assert surfaces(roadmap(*shapes), *at) == order
    assert surfaces(roadmap(*shapes[::-1]), *at) == [Surface.ROAD] * 3 + [Surface.CYCLEWAY, Surface.ROAD, Surface.NONE]


def test_bounds() -> None:
    where = roadmap(road([(0, 0), (50, 0)], 8.0), square(100, 7, 5, Surface.SIDEWALK))
    assert where.bounds == pytest.approx((-4.0, -4.0, 105.0, 12.0))


DEGENERATE = (
    road([]),
    road([(5, 5)]),
    road([(5, 5), (5, 5), (5, 5)]),
    road([(0, 60), (0, 60), (30, 60), (30, 60), (60, 60)]),
    road([(0, 80), (30, 80), (0, 80)]),  # straight back
    road([(0, 100), (50, 100)], width=0.0),
    Area(Surface.SIDEWALK, np.zeros((0, 2))),
    Area(Surface.SIDEWALK, np.array([[5.0, 5.0]])),
    Area(Surface.SIDEWALK, np.array([[5.0, 5.0], [9.0, 5.0]])),
    Area(Surface.SIDEWALK, np.array([[5.0, 5.0]] * 4)),
    Area(Surface.CROSSING, np.array([[100.0, 0.0], [120.0, 20.0], [120.0, 0.0], [100.0, 20.0]])),  # crosses itself
)


def test_degenerate_shapes_paint_nothing_and_do_no_harm() -> None:
    where = roadmap(*DEGENERATE, road([(0, 40), (50, 40)]))
    at = [(20.0, 40.0), (30.0, 60.0), (10.0, 80.0), (7.0, 4.0), (25.0, 100.0), (118.0, 10.0), (110.0, 18.0)]
    assert surfaces(where, *at) == [1, 1, 1, 0, 0, Surface.CROSSING, 0]
    x, y = np.meshgrid(np.arange(-10.0, 130.0, 0.2), np.arange(-10.0, 130.0, 0.2))
    assert (where.surface_at(x.ravel(), y.ravel()) == Surface.SIDEWALK).sum() <= (1 / 0.2) ** 2  # a dot at most


@pytest.mark.parametrize("shapes", [(), DEGENERATE[:3]])
def test_a_map_without_ground(shapes: tuple[Ribbon | Area, ...]) -> None:
    where = roadmap(*shapes)
    assert surfaces(where, (0.0, 0.0), (1e6, -1e6)) == [0, 0]
    assert not where.near_surface(np.array([0.0, 200.0]), np.zeros(2)).any()
    assert np.isfinite(where.bounds).all()
    assert where.surface_at(np.zeros(0), np.zeros(0)).shape == (0,)


def scene(seed: int = 0) -> tuple[Ribbon | Area, ...]:
    """Random roads, pavements and squares over 400 m x 400 m, also left and below of the origin."""
    rng = np.random.default_rng(seed)
    lines = rng.uniform(-200, 200, (40, 1, 2)) + np.cumsum(rng.uniform(-40, 40, (40, 4, 2)), axis=1)
    ribbons = tuple(Ribbon(Surface(1 + i % 4), line, 2.0 + i % 5) for i, line in enumerate(lines))
    return ribbons + tuple(square(*rng.uniform(-200, 200, 2), 10, Surface(1 + i % 4)) for i in range(10))


def test_tiles_of_any_size_show_the_same_ground() -> None:
    small, large = roadmap(*scene()), roadmap(*scene(), core=1024.0)
    x, y = np.random.default_rng(1).uniform(-250, 250, (2, 50000))
    a, b = small.surface_at(x, y), large.surface_at(x, y)
    assert len(set(a.tolist())) == 5
    # OpenCV clips what leaves a tile, which moves a border by a pixel here and there.
    assert np.mean(a != b) < 1e-3


def test_ego_surfaces_are_the_surfaces_at_the_pixels_of_the_view() -> None:
    where = roadmap(*scene())
    rng = np.random.default_rng(2)
    x, y, heading = rng.uniform(-220, 220, 60), rng.uniform(-220, 220, 60), rng.uniform(-np.pi, np.pi, 60)
    x[0], y[0] = 127.9, 128.1  # by the corner of a core
    crops = where.ego_surfaces(x, y, heading, behind=8, ahead=32, side=10, resolution=2)
    assert crops.shape == (60, 40, 80)
    ex, ey = np.arange(80) / 2 + 0.25 - 8, 10 - 0.25 - np.arange(40) / 2
    c, s = np.cos(heading)[:, None, None], np.sin(heading)[:, None, None]
    px = x[:, None, None] + c * ex - s * ey[:, None]
    py = y[:, None, None] + s * ex + c * ey[:, None]
    expected = where.surface_at(px.ravel(), py.ravel()).reshape(crops.shape)
    assert len(np.unique(crops)) == 5
    # At another tile's painting and at ties of the rounding pixels may differ.
    assert np.mean(crops != expected) < 5e-3


def test_ego_surfaces_are_opencvs_affine_warps() -> None:
    shapes = scene()
    where = roadmap(*shapes)
    rng = np.random.default_rng(7)
    x, y, heading = rng.uniform(0, 128, 200), rng.uniform(0, 128, 200), rng.uniform(-np.pi, np.pi, 200)
    heading[:40] = np.pi / 2 * rng.integers(-2, 3, 40)
    crops = where.ego_surfaces(x, y, heading, behind=8, ahead=32, side=10, resolution=2)
    tile = np.zeros((896, 896), np.uint8)
    paint(tile, shapes, -48.0, -48.0, 4.0)
    warped = []
    for c, s, u, v in zip(np.cos(heading), np.sin(heading), x + 48.0, y + 48.0, strict=True):
        column, row = 4 * (u - 7.75 * c - 9.75 * s) - 0.5, 4 * (v - 7.75 * s + 9.75 * c) - 0.5
        matrix = np.array([[2 * c, 2 * s, column], [2 * s, -2 * c, row]])
        warped.append(cv2.warpAffine(tile, matrix, (80, 40), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP))
    # Ties of the rounding; older releases of OpenCV round to 1/1024 px before.
    assert np.mean(crops != warped) < (1e-5 if cv2.__version__ >= "5" else 1e-3)


def test_what_has_no_place_has_no_ground() -> None:
    where = roadmap(*scene())
    far = np.array([np.nan, np.inf, -np.inf, 1e300, 2.0**31 * 128, 2.0**32 * 128, 1e12, 64.0])
    assert where.surface_at(np.zeros(8), far)[:-1].tolist() == [0] * 7
    assert where.surface_at(far, np.zeros(8))[:-1].tolist() == [0] * 7
    view = {"behind": 8.0, "ahead": 32.0, "side": 10.0, "resolution": 2.0}
    crops = where.ego_surfaces(far, np.zeros(8), np.zeros(8), **view)
    assert not crops[:-1].any()
    assert crops[-1].any()
    headings = np.array([np.nan, np.nan, 1e300, 0.5])
    crops = where.ego_surfaces(np.full(4, 64.0), np.zeros(4), headings, **view)
    assert not crops[:2].any()
    assert crops[2:].any(axis=(1, 2)).all()


def test_places_with_fewer_numbers_are_refused() -> None:
    where, three = roadmap(*scene()), np.zeros(3)
    view = {"behind": 8.0, "ahead": 32.0, "side": 10.0, "resolution": 2.0}
    with pytest.raises(ValueError, match=r"one shape, not \(3,\), \(2,\)"):
        where.surface_at(three, three[:2])
    with pytest.raises(ValueError, match=r"one shape, not \(3,\), \(3,\), \(1,\)"):
        where.ego_surfaces(three, three, three[:1], **view)


def test_a_view_beyond_the_margin_is_refused() -> None:
    one = np.zeros(1)
    with pytest.raises(ValueError, match="margin of 48"):
        roadmap(*scene()).ego_surfaces(one, one, one, behind=8, ahead=50, side=10, resolution=2)


def test_near_surface_is_true_to_10_m_and_false_from_20_m() -> None:
    line = np.array([(0.0, 0.0), (90.0, 35.0), (70.0, 160.0)])
    for width in (0.3, 7.0):
        where = roadmap(Ribbon(Surface.ROAD, line, width))
        points = np.random.default_rng(4).uniform(-60, 220, (40000, 2))
        distance = np.min([distance_to_segment(points, a, b) for a, b in pairwise(line)], axis=0)
        near = where.near_surface(points[:, 0], points[:, 1])
        assert near[distance < 10.0].all()
        assert not near[distance > 20.0 + 0.5 * width].any()
    far = np.array([1e7, -1e7, 50.0, np.inf])
    assert not where.near_surface(far, np.array([0.0, 0.0, 1e7, 0.0])).any()


def test_memory_stays_bounded_on_a_network_of_10_km() -> None:
    limit = 8 * 2**20
    lines = np.arange(0.0, 10001.0, 100.0)
    streets = [road([(v, 0), (v, 10000)]) for v in lines] + [road([(0, v), (10000, v)]) for v in lines]
    where = roadmap(*streets, memory_limit=limit)
    assert where.near_surface(np.array([5050.0, 5050.0]), np.array([5030.0, 5050.0])).tolist() == [False, False]
    assert where.near_surface(np.array([5000.0, 5050.0]), np.array([5003.0, 5010.0])).all()
    rng = np.random.default_rng(5)
    seen = []
    for _ in range(20):
        x, y = rng.uniform(0, 10000, (2, 20))
        found = where.surface_at(x, y)
        seen.append(where.resident_bytes)
        off = np.minimum(np.abs((x + 50) % 100 - 50), np.abs((y + 50) % 100 - 50))
        assert (found[off < 3.7] == Surface.ROAD).all()
        assert (found[off > 4.3] == Surface.NONE).all()
    assert max(seen) <= limit
    assert max(seen) > limit / 2  # tiles are really kept


def test_the_least_recently_used_tile_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    painted = []
    monkeypatch.setattr(tiles, "paint", lambda canvas, shapes, x0, y0, *rest, **more: painted.append(x0))
    where = roadmap(road([(0, 0), (1000, 0)]), memory_limit=2 * TILE)
    for column in (0, 1, 0, 2, 0, 1):
        surfaces(where, (128.0 * column + 5.0, 5.0))
    assert painted == [128.0 * column - 48.0 for column in (0, 1, 2, 1)]


def test_a_limit_below_one_tile_keeps_one() -> None:
    where = roadmap(*scene(), memory_limit=1)
    x, y = np.random.default_rng(6).uniform(-200, 200, (2, 500))
    assert np.array_equal(where.surface_at(x, y), roadmap(*scene()).surface_at(x, y))
    assert where.resident_bytes == TILE


def test_the_index_lists_a_long_diagonal_where_it_shows_and_hardly_elsewhere() -> None:
    shapes = (square(0, 0, 3, Surface.ROAD), road([(0, 0), (5000, 5000)]))
    index = index_by_tile(piece_boxes(shapes, 128.0), 128.0, 48.0)
    for d in np.arange(0.0, 5000.0, 7.0):
        corner = (d - 1.0) / 128.0
        for i in (int(corner - 0.3), int(corner), int(corner + 0.3)):
            for j in (int(corner - 0.3), int(corner), int(corner + 0.3)):
                if all(k * 128 - 48 <= d <= (k + 1) * 128 + 48 for k in (i, j)):
                    assert 1 in index[i, j]
    assert len(index) < 250  # of the 1600 in its bounding box
    assert index[0, 0].tolist() == [0, 1]
    assert 0 not in index[1, 1]
