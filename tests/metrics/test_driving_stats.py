"""Overlaps, braking, surfaces and lane keeping of road users that are placed by hand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


@pytest.fixture
def street(bare_network: Callable[[str], Path]) -> Network:
    """200 m of street along +x in one lane of 3.2 m, its centre line at y = -1.6, with a junction in the middle."""
    with SumoSession(
        find_scenario(str(bare_network('<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c"/>')))
    ) as s:
        return s.network


def scene(*users: tuple[str, RoadUserType, float, float, float]) -> WorldState:
    """Road users (id, type, x, y, speed) that head along +x; cars 5 x 2 m, the others 1 x 1 m."""
    ids, kind, x, y, speed = zip(*users, strict=True)
    car = np.array(kind) == RoadUserType.CAR
    return make_world(
        x, y, speed=speed, type=kind, ids=ids, length=np.where(car, 5.0, 1.0), width=np.where(car, 2.0, 1.0)
    )


CAR, BICYCLE, PEDESTRIAN = RoadUserType


def test_pairs_count_once_and_only_with_a_counted_road_user(street: Network) -> None:
    stats = DrivingStats(RoadMap(street.surfaces()))
    apart = scene(("a", CAR, 20.0, -1.6, 5.0), ("b", CAR, 30.0, -1.6, 5.0), ("p", PEDESTRIAN, 60.0, 0.0, 1.0))
    both = frozenset({"a", "p"})
    stats.add(apart, both)
    near = replace(apart, x=np.array([25.05, 30.0, 60.0]))
    # The person walks into a: counts for both types, once for all.
    hit = replace(near, x=np.array([25.05, 40.0, 25.0]), y=np.array([-1.6, -1.6, -1.6]))
    for number, world in enumerate((near, near, apart, near, hit)):
        stats.add(replace(world, time=0.4 * (number + 1)), both)
    found = stats.record()
    kinds = ("car", "bicycle", "pedestrian", "all")
    assert [found[k]["collisions"] for k in kinds] == [2, 0, 1, 2]
    assert [found[k]["collisions_with_background"] for k in kinds] == [1, 0, 0, 1]
    # No counted road user in it.
    stats.add(replace(near, x=np.array([80.0, 82.0, 60.0]), time=2.4), frozenset({"p"}))
    assert stats.record()["all"]["collisions"] == 2


def test_speeds_braking_and_surfaces_are_shares_of_steps(street: Network) -> None:
    stats = DrivingStats(RoadMap(street.surfaces()))
    # -4.4 and -4.6 m/s², then standing beside the street.
    for x, y, speed in ((20.0, -1.6, 9.0), (23.0, -1.6, 7.24), (26.0, -1.6, 5.4), (28.0, 40.0, 0.05)):
        stats.add(scene(("a", CAR, x, y, speed), ("b", BICYCLE, 60.0, -1.6, 4.0)), frozenset({"a", "b"}))
    found = stats.record()
    assert found["car"]["steps"] == 4
    assert found["car"]["mean_speed_mps"] == pytest.approx((9.0 + 7.24 + 5.4 + 0.05) / 4, abs=1e-4)
    assert found["car"]["standing_share"] == 0.25
    assert found["car"]["off_surface_share"] == 0.25
    assert found["car"]["hard_braking_share"] == pytest.approx(2.0 / 3.0, abs=1e-4)
    assert found["bicycle"]["hard_braking_share"] == 0.0
    assert found["pedestrian"]["mean_speed_mps"] is None
    assert found["all"]["steps"] == 8
