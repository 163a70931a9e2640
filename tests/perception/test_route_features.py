"""The route as numbers, by hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import straight_routes
from numpy.typing import NDArray

from slrl_sumo.perception.route_context import route_context
from slrl_sumo.perception.route_features import (
    MOST_PATH,
    PATH_FEATURES,
    PATH_POINTS,
    ROUTE_FEATURES,
    path_features,
    route_features,
)
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.state import WorldState

Worlds = Callable[..., WorldState]
Routes = Callable[..., RouteAhead]


def told(world: WorldState, route: RouteAhead, **leader: Any) -> list[dict[str, float]]:
    """The features of the first road users of `world` by name."""
    n = len(route)
    gap, leading = (np.array(leader.get(name, default), float) for name, default in (("gap", [np.inf]), ("speed", [0])))
    context = replace(
        route_context(route, world), leader_gap=np.broadcast_to(gap, n), leader_speed=np.broadcast_to(leading, n)
    )
    table = route_features(world.heading[:n], context)
    assert table.shape == (n, len(ROUTE_FEATURES))
    assert table.dtype == np.float32
    return [dict(zip(ROUTE_FEATURES, row.tolist(), strict=True)) for row in table]


def test_every_column_in_its_unit(
    place: Worlds,
) -> None:
    # 1 m to the left of a straight path, turned 0.1 rad to the left of it.
    world = place([(0, 30.0, 6.0, 0.1)])
    route = straight_routes(
        (30.0, 5.0, 0.0), stop=25.0, line=30.0, signal=3, desired_speed=13.0, remaining_distance=44.0
    )
    assert told(world, route, gap=[12.0], speed=[5.0])[0] == pytest.approx(
        {
            "known": 1.0,
            "lateral_offset": 1.0,
            "heading_error": 0.1,
            "turn_distance": 4.0,
            "turn": 0.0,
            "stop": 2.5,
            "line": 3.0,
            "green": 0.0,
            "yellow": 0.0,
            "red": 1.0,
            "desired_speed": 1.3,
            "left": 4.4,
            "leader_gap": 1.2,
            "leader_speed": 0.5,
        },
        abs=1e-5,
    )


@pytest.mark.parametrize(("signal", "shown"), [(0, []), (1, ["green"]), (2, ["yellow"]), (3, ["red"])])
def test_one_signal_is_shown_at_most(place: Worlds, signal: int, shown: list[str]) -> None:
    (row,) = told(place([(0, 0, 0, 0)]), straight_routes((0, 0, 0), signal=signal))
    assert [name for name in ("green", "yellow", "red") if row[name]] == shown
    assert all(row[name] == 1.0 for name in shown)


@pytest.mark.parametrize("heading", [0.0, 2.0, np.pi - 0.05, -3.1])
@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2, 0.5, -2.5])
def test_the_next_turn_and_its_distance_in_any_direction(place: Worlds, heading: float, turn: float) -> None:
    (row,) = told(place([(0, 7.0, -3.0, heading)]), straight_routes((7.0, -3.0, heading), turn=turn, after=13))
    assert row["turn_distance"] == pytest.approx(1.3)
    assert row["turn"] == pytest.approx(turn, abs=1e-4)
    assert row["heading_error"] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("heading", [0.0, 0.3, 1.0, 2.0, -0.7, -2.9, np.pi])
def test_straight_back_is_to_the_left(place: Worlds, heading: float) -> None:
    for turn in (np.pi, -np.pi):
        (row,) = told(place([(0, 7.0, -3.0, heading)]), straight_routes((7.0, -3.0, heading), turn=turn, after=30))
        assert (row["turn"], row["turn_distance"]) == (pytest.approx(np.pi), pytest.approx(3.0))


def test_turns_that_lie_behind_or_are_slight_do_not_count(
    place: Worlds,
) -> None:
    behind = straight_routes((0.0, 0.0, 0.0))
    # The path came from the right, round a corner 4 m behind.
    x, y = behind.x.copy(), behind.y.copy()
    x[0, :4], y[0, :4] = -4.0, [-4.0, -3.0, -2.0, -1.0]
    for route, turned in ((replace(behind, x=x, y=y), 0.0), (straight_routes((0, 0, 0), turn=0.25, after=10), 0.25)):
        (row,) = told(place([(0, 0, 0, 0)]), route)
        assert row["turn_distance"] == pytest.approx(4.0)
        assert row["turn"] == pytest.approx(turned, abs=1e-5)


def test_what_is_far_is_all_alike(
    place: Worlds,
) -> None:
    far = straight_routes((0, 0, 0), stop=np.inf, line=61.0, remaining_distance=4000.0)
    (row,) = told(place([(0, 0.0, 40.0, 0.0)]), far, gap=[np.inf], speed=[80.0])
    assert [row[name] for name in ("stop", "line", "left", "leader_gap", "leader_speed")] == [6.0] * 5
    assert row["lateral_offset"] == 5.0
    (row,) = told(place([(0, 0.0, -40.0, 0.0)]), far)
    assert row["lateral_offset"] == -5.0


def test_without_a_route_all_is_zero(
    place: Worlds,
) -> None:
    world = place([(0, 3.0, 2.0, 0.3), (1, 0.0, 0.5, 0.0), (2, 9.0, 9.0, 1.0)])
    whole = straight_routes((0, 0, 0), (0, 0, 0), (9, 9, 0), stop=5.0, signal=2)
    route = replace(whole, known=np.array([False, True, False]), remaining_distance=np.full(3, np.nan))
    table = told(world, replace(route, remaining_distance=np.array([np.nan, 20.0, np.nan])))
    assert not any(table[0].values())
    assert not any(table[2].values())
    assert (table[1]["known"], table[1]["lateral_offset"], table[1]["yellow"]) == (1.0, 0.5, 1.0)
    lost: NDArray[np.float32] = route_features(world.heading, route_context(RouteAhead.unknown(3), world))
    assert not lost.any()


def test_routes_belong_to_the_rows_that_are_asked_for(
    place: Worlds,
) -> None:
    world = place([(0, 0.0, 1.0, 0.0), (0, 50.0, 3.0, 0.0), (0, 90.0, -2.0, 0.0)])
    route = straight_routes((0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (90.0, 0.0, 0.0))
    rows = np.array([2, 0])
    context = replace(route_context(route, world), leader_gap=np.array([20.0, 30.0, 10.0])).take(rows)
    table = route_features(world.heading[rows], context)
    np.testing.assert_allclose(table[:, ROUTE_FEATURES.index("lateral_offset")], [-2.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(table[:, ROUTE_FEATURES.index("leader_gap")], [1.0, 2.0], atol=1e-6)


def test_the_path_ahead_is_seen_from_the_ego() -> None:
    # Of two on the same path to the north, the second one is 2 m to its right and looks to the west.
    north = (10.0, 20.0, np.pi / 2)
    route = straight_routes(north, north)
    x, y, heading = np.array([10.0, 12.0]), np.array([20.0, 20.0]), np.array([np.pi / 2, np.pi])
    table = path_features(route, x, y, heading).reshape(2, len(PATH_POINTS), 2)
    away = np.array(PATH_POINTS) / 10.0
    np.testing.assert_allclose(table[0], np.column_stack([away, 0.0 * away]), atol=1e-6)
    np.testing.assert_allclose(table[1], np.column_stack([0.2 + 0.0 * away, -away]), atol=1e-6)


def test_without_a_route_and_far_away_the_path_is_bounded() -> None:
    here = (0.0, 0.0, 0.0)
    route = straight_routes(here, here, known=np.array([True, False]))
    table = path_features(route, np.full(2, 1e4), np.zeros(2), np.zeros(2))
    assert table.shape == (2, len(PATH_FEATURES))
    assert table[0].min() == -MOST_PATH
    assert not table[1].any()
