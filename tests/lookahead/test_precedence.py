"""Which of two vehicles goes first, and that others are expected to wait for it."""

from dataclasses import replace

import numpy as np
from builders import make_world, straight_routes

from slrl_sumo.lookahead.forecast import YIELD_BRAKING, forecast_boxes, path_following
from slrl_sumo.lookahead.precedence import Precedence, goes_first, precedence
from slrl_sumo.perception.leaders import way_code
from slrl_sumo.perception.route_context import route_context
from slrl_sumo.scene.types import DECISION_INTERVAL

INF = np.inf


def order(entered: list[float], in_way: list[tuple[int, int]] = [], follows: bool = True) -> Precedence:  # noqa: B006
    n = len(entered)
    codes = sorted(way_code(ego, other, n) for ego, other in in_way)
    return Precedence(np.array(entered), np.full(n, follows), np.array(codes, np.int64), n)


def test_the_one_that_entered_first_goes_first() -> None:
    some = order([3.0, 5.0, INF, INF])
    assert goes_first(0, 1, some)
    assert not goes_first(1, 0, some)
    # Those in the junction before those outside; outside there is no order.
    assert goes_first(1, 2, some)
    assert not goes_first(2, 3, some)
    assert not goes_first(3, 2, some)
    # At the same time: one of the two.
    tie = order([4.0, 4.0])
    assert goes_first(0, 1, tie) != goes_first(1, 0, tie)


def test_one_that_is_in_the_way_clears_it_first() -> None:
    # 1 stands on the path of 0, which entered before.
    some = order([3.0, 5.0], [(0, 1)])
    assert goes_first(1, 0, some)
    assert not goes_first(0, 1, some)
    # Each on the path of the other: the order decides again.
    both = order([3.0, 5.0], [(0, 1), (1, 0)])
    assert goes_first(0, 1, both)
    assert not goes_first(1, 0, both)


def test_road_users_without_a_path_do_not_wait() -> None:
    assert not goes_first(0, 1, order([3.0, 5.0], follows=False))
    assert not goes_first(0, 2, order([3.0, 5.0]))
    no_users = precedence(None, path_following(None, make_world([0.0], [0.0])), 1)
    assert not goes_first(0, 0, no_users)


def test_the_order_has_no_circle() -> None:
    rng = np.random.default_rng(1)
    entered = rng.choice([1.0, 2.0, 3.0, INF], 12)
    some = order(entered.tolist())
    before = np.array([[goes_first(i, j, some) for j in range(12)] for i in range(12)])
    reach = before.copy()
    for _ in range(12):
        reach |= reach @ before
    assert not reach.diagonal().any()


def test_a_vehicle_that_waits_brakes_to_a_stand_on_its_path() -> None:
    cars = make_world([0.0, 0.0], [0.0, 10.0], speed=[9.0, 9.0])
    route = straight_routes((0.0, 0.0, 0.0), (0.0, 10.0, 0.0), stop=np.array([INF, 2.0]))
    following = path_following(route_context(route, cars), cars)
    boxes = forecast_boxes(cars, following, np.zeros(len(cars)), yielding=True)
    time = DECISION_INTERVAL * np.arange(1, boxes.x.shape[1] + 1)
    until = np.minimum(time, 9.0 / YIELD_BRAKING)
    assert np.allclose(boxes.x[0], 9.0 * until - 0.5 * YIELD_BRAKING * until**2)
    assert boxes.x[0, -1] > 13.4
    # Never beyond the line before which it stops.
    assert boxes.x[1].max() <= 2.0 + 1e-9
    on = forecast_boxes(cars, following, np.zeros(len(cars)))
    assert np.allclose(on.x[0], 9.0 * time)
    assert replace(route, junction_entry_time=np.array([1.0, 2.0])).junction_entry_time.tolist() == [1.0, 2.0]
