"""Rollouts on the routes that road users are expected to take."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.routing.expected_routes import ExpectedRoutes
from slrl_sumo.studies.prediction.evaluate import evaluate
from slrl_sumo.studies.prediction.expectations import expectations
from slrl_sumo.studies.prediction.rollout import cast_of
from slrl_sumo.sumo.network.lanes import Lane

SHARES = [[0.15, 0.1], [0.0, 0.0], [0.0, 0.0]]


@pytest.fixture(scope="module")
def trained() -> ModelBundle:
    bundle = load_bundle("intersection")
    return replace(bundle, policy_training={**(bundle.policy_training or {}), "expected_route": SHARES})


@pytest.fixture(scope="module")
def routes() -> ExpectedRoutes:
    """A lane that goes east, and from x = 100 m on in a curve of 20 m radius to the north."""
    turn = np.radians(np.arange(0, 91, 10))
    curve = np.stack([100.0 + 20.0 * np.sin(turn), 20.0 - 20.0 * np.cos(turn)], -1)
    shape = np.concatenate([[[0.0, 0.0]], curve, [[120.0, 300.0]]])
    every = frozenset({"passenger", "bicycle"})
    return ExpectedRoutes([Lane("a_0", "a", shape, 3.2, 400.0, 13.9, every, False, Surface.ROAD)], {})


@pytest.fixture(scope="module")
def made() -> Trajectories:
    """A car that follows the lane at 7.5 m/s into its curve, a bicycle 40 m behind it, and a pedestrian."""
    along = 60.0 + 3.0 * np.arange(24)
    bent = np.clip((along - 100.0) / 20.0, 0.0, np.pi / 2)
    beyond = np.maximum(along - 100.0 - 10.0 * np.pi, 0.0)
    x = np.minimum(along, 100.0) + 20.0 * np.sin(bent)
    y = 20.0 - 20.0 * np.cos(bent) + beyond
    ways = (x, y, bent), (20.0 + 1.6 * np.arange(24), 0.0, 0.0), (0.5 * np.arange(24), -8.0, 0.0)
    return make_recording(*ways, type=(0, 1, 2), source="by hand")


def test_a_car_follows_the_curve_ahead_of_it(trained: ModelBundle, made: Trajectories, routes: ExpectedRoutes) -> None:
    selectors = ["greedy", "sampled"]
    plain, routed = (
        evaluate(made, trained, selectors=selectors, starts_every=30, routes=one) for one in (None, routes)
    )
    assert plain["expected_routes"] == []
    assert routed["expected_routes"] == ["car"]
    for selector in selectors:
        assert _final(routed, selector, "car") < 0.75 * _final(plain, selector, "car")
        for kind in ("bicycle", "pedestrian"):  # of which the selector does not count
            assert _final(routed, selector, kind) == pytest.approx(_final(plain, selector, kind), rel=1e-6)


def _final(result: dict[str, Any], selector: str, kind: str) -> float:
    """The last error of a type by a selector, in m."""
    rows = [row for row in result["rows"] if (row["selector"], row["type"]) == (selector, kind)]
    return float(rows[-1]["fde_m"])


def test_scenes_with_routes_do_not_see_each_other(
    trained: ModelBundle, made: Trajectories, routes: ExpectedRoutes
) -> None:
    one, many = (
        evaluate(made, trained, selectors=["greedy"], starts_every=4, routes=routes, batch=batch) for batch in (1, 16)
    )
    assert one["rows"] == many["rows"]


def test_routes_begin_where_road_users_enter(trained: ModelBundle, made: Trajectories, routes: ExpectedRoutes) -> None:
    expected = expectations(trained, routes)
    assert expected is not None
    cast = cast_of(made, np.array([0, 8]))
    first, again = expected.of(made, cast), expected.of(made, cast)
    for k in range(len(cast)):
        route, other = first[k], again[k]
        if made.type[cast.track[k]] != 0:
            assert route is None
            continue
        assert route is not None
        assert other is not None
        assert route.desired == pytest.approx(7.5)
        x, _, _ = route.line.at(route.s)
        assert x == pytest.approx(made.x[cast.row[k] + cast.enters[k]])
        route.s = 0.0
        assert other.s > 0.0  # each has its own place


def test_a_selector_that_was_not_calibrated_to_them_has_no_expectations(
    trained: ModelBundle, routes: ExpectedRoutes
) -> None:
    assert expectations(trained, None) is None
    record = {name: value for name, value in (trained.policy_training or {}).items() if name != "expected_route"}
    assert expectations(replace(trained, policy_training=record), routes) is None
    assert expectations(replace(trained, policy=None), routes) is None
