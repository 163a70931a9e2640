"""Ways along lanes and routes, and the boxes swept on them."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slrl_sumo.background.lane_paths import SPACING, Paths, resampled
from slrl_sumo.background.swept_boxes import STRAIGHTENING, sweep
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane

WITHOUT_LINKS: Any = SimpleNamespace(lane=SimpleNamespace(getLinks=lambda _: ()))
"""An API in which no lane leads on."""


def lane(name: str, shape: list[tuple[float, float]], *, allowed: str = "passenger", length: float = 0.0) -> Lane:
    points = np.array(shape, np.float64)
    drawn = float(np.hypot(*np.diff(points, axis=0).T).sum())
    edge = name.rsplit("_", 1)[0]
    return Lane(
        name, edge, points, 3.2, length or drawn, 13.9, frozenset(allowed.split()), name[0] == ":", Surface.ROAD
    )


LANES = (
    lane("a_0", [(0, 0), (40, 0)]),
    lane(":j_0_0", [(40, 0), (50, 0)]),
    lane(":j_1_0", [(40, 0), (48, 2), (50, 10)]),
    lane("b_0", [(50, 0), (90, 0)], allowed="bicycle"),
    lane("b_1", [(50, 0), (90, 0)]),
    lane("b_2", [(50, 3), (90, 3)]),
    lane("c_0", [(90, 3), (130, 3)]),
    lane("d_0", [(50, 10), (50, 60)]),
)
LINKS = {
    "a_0": [("b_0", ":j_0_0"), ("b_1", ":j_0_0"), ("b_2", ":j_0_0"), ("d_0", ":j_1_0")],
    ":j_0_0": [("b_1", ""), ("b_2", "")],
    ":j_1_0": [("d_0", "")],
    "b_2": [("c_0", "")],
}


@pytest.fixture
def paths() -> Paths:
    def links(name: str) -> list[tuple[Any, ...]]:
        return [(to, True, True, False, inside, "M", "s", 1.0) for to, inside in LINKS.get(name, [])]

    return Paths(SimpleNamespace(lane=SimpleNamespace(getLinks=links)), Network(LANES, ()))


def test_a_way_follows_the_route_through_the_junction(paths: Paths) -> None:
    assert paths.chain("a_0", ("d",), "passenger") == ("a_0", ":j_1_0", "d_0")


def test_a_way_ends_with_the_route(paths: Paths) -> None:
    assert paths.chain("a_0", (), "passenger") == ("a_0",)


def test_a_way_ends_on_a_lane_that_does_not_lead_to_the_next_edge(paths: Paths) -> None:
    assert paths.chain("b_1", ("c",), "passenger") == ("b_1",)


def test_of_several_lanes_the_way_takes_the_one_that_leads_on(paths: Paths) -> None:
    assert paths.chain("a_0", ("b", "c"), "passenger") == ("a_0", ":j_0_0", "b_2", "c_0")


def test_lanes_are_chosen_by_vehicle_class(paths: Paths) -> None:
    assert paths.chain(":j_0_0", ("b",), "passenger")[-1] == "b_1"
    assert "b_0" not in paths.chain("a_0", ("b",), "passenger")


def test_a_vehicle_inside_a_junction_at_the_end_of_its_route_still_leaves_it(paths: Paths) -> None:
    assert paths.chain(":j_1_0", (), "passenger") == (":j_1_0", "d_0")


def test_points_lie_every_half_metre_from_the_vehicle_on(paths: Paths) -> None:
    rows = np.array([paths.row("a_0", ("b",), "passenger"), paths.row("a_0", ("d",), "passenger")])
    x, y, _, room = paths.sample(rows, np.array([10.2, 39.0]), 60)
    np.testing.assert_allclose(x[0], 10.2 + SPACING * np.arange(60), atol=1e-9)
    np.testing.assert_allclose(y[0], 0.0, atol=1e-9)
    assert room[0] == pytest.approx(79.8, abs=SPACING)
    steps = np.hypot(np.diff(x[1]), np.diff(y[1]))
    # Corners of the polyline are cut, never stretched.
    assert steps.max() <= SPACING + 1e-9
    assert steps.min() > 0.8 * SPACING
    assert (x[1, -1], y[1, -1]) == pytest.approx((50.0, 20.0), abs=3.0)


def test_points_inside_junctions_are_marked(paths: Paths) -> None:
    x, _, inside, _ = paths.sample(np.array([paths.row("a_0", ("b",), "passenger")]), np.array([30.2]), 60)
    assert (x[inside].min(), x[inside].max()) == (pytest.approx(40.0, abs=SPACING), pytest.approx(50.0, abs=SPACING))
    assert inside.sum() == pytest.approx(10.0 / SPACING, abs=1.0)


def test_past_the_end_of_the_way_its_last_point_recurs(paths: Paths) -> None:
    x, _, _, room = paths.sample(np.array([paths.row("a_0", (), "passenger")]), np.array([38.0]), 12)
    assert room[0] == pytest.approx(2.0)
    np.testing.assert_allclose(x[0, 4:], 40.0)


def test_positions_on_a_lane_are_in_sumos_measure() -> None:
    paths = Paths(WITHOUT_LINKS, Network((lane("long_0", [(0, 0), (40, 0)], length=80.0),), ()))
    x, _, _, room = paths.sample(np.array([paths.row("long_0", (), "passenger")]), np.array([60.0]), 3)
    assert x[0, 0] == pytest.approx(30.0)
    assert room[0] == pytest.approx(10.0)


def test_the_same_way_is_kept_once_and_the_pool_grows(paths: Paths) -> None:
    row = paths.row("a_0", ("b",), "passenger")
    assert paths.row("a_0", ("b",), "passenger") == row
    assert paths.row("a_0", ("d",), "passenger") != row
    long = Paths(WITHOUT_LINKS, Network((lane("x_0", [(0, 0), (9000, 0)]),), ()))
    x, _, _, _ = long.sample(np.array([long.row("x_0", (), "passenger")]), np.array([8990.0]), 4)
    np.testing.assert_allclose(x[0], 8990.0 + SPACING * np.arange(4))


def test_resampling_keeps_the_begin_and_the_spacing() -> None:
    points = resampled(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.2]]), 0.5)
    assert len(points) == 15
    np.testing.assert_allclose(points[0], (0, 0))
    np.testing.assert_allclose(points[-1], (3.0, 4.0))


def swept(x: np.ndarray, y: np.ndarray, front: tuple[float, float], heading: float, room: float = 1e3) -> Any:
    return sweep(
        x[None], y[None], np.array([room]), np.array([front[0]]), np.array([front[1]]), np.array([heading]),
        np.array([[5.0, 1.8]]),
    )  # fmt: skip


def test_boxes_on_a_straight_way_start_where_the_vehicle_is() -> None:
    s = SPACING * np.arange(40)
    boxes = swept(20.0 + s, 0.0 * s, (20.0, 0.0), 0.0, room=10.0)
    np.testing.assert_allclose(boxes.x[0], 17.5 + s, atol=1e-9)
    np.testing.assert_allclose(boxes.y[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(boxes.heading[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(boxes.width[0], 1.8)
    assert boxes.valid[0].sum() == 21


def test_beside_the_lanes_centre_the_box_covers_staying_there_and_coming_back() -> None:
    s = SPACING * np.arange(60)
    boxes = swept(s, 0.0 * s, (0.0, 1.2), 0.0)
    assert boxes.y[0, 0] == pytest.approx(1.2)
    assert boxes.width[0, 0] == pytest.approx(1.8)
    far = s >= STRAIGHTENING + 5.0
    np.testing.assert_allclose(boxes.y[0, far], 0.6, atol=1e-6)
    np.testing.assert_allclose(boxes.width[0, far], 1.8 + 1.2)


def test_long_vehicles_cut_corners() -> None:
    radius = 8.0
    angle = SPACING * np.arange(30) / radius
    boxes = swept(radius * np.sin(angle), radius * (1 - np.cos(angle)), (0.0, 0.0), 0.0)
    distance = np.hypot(boxes.x[0], boxes.y[0] - radius)
    # In a steady turn, front and rear are on the circle and the middle of the box inside it.
    expected = math.sqrt(radius**2 - 2.5**2)
    np.testing.assert_allclose(distance[15:29], expected, atol=0.05)


def test_a_vehicle_that_faces_against_its_lane_is_expected_to_go_straight_on() -> None:
    s = SPACING * np.arange(20)
    boxes = swept(10.0 + s, 0.0 * s, (10.0, 0.0), math.pi, room=0.0)
    np.testing.assert_allclose(boxes.x[0], 12.5 - s, atol=1e-9)
    assert boxes.valid.all()
