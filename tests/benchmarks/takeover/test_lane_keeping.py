"""Lane keeping of a car that is placed by hand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_world

from benchmarks.takeover.lane_keeping import LaneKeeping
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


def test_lane_keeping_measures_offsets_sways_and_driving_against_the_lane(street: Network) -> None:
    lanes = LaneKeeping(street)
    offsets = [0.0, 0.2, 0.1, -0.1, -0.3, -0.1, 0.1, -0.2, 0.5]
    for k, offset in enumerate(offsets):
        lanes.add(scene(("a", RoadUserType.CAR, 10.0 + 5.0 * k, -1.6 + offset, 12.5)))
    assert lanes.distances == pytest.approx(np.abs(offsets), abs=1e-6)
    # + to - and - to +; crossing the line within 0.15 m of it is nothing.
    assert lanes.sways == 2
    assert lanes.metres == pytest.approx(40.0, abs=0.1)
    assert lanes.against == 0
    turned = scene(("a", RoadUserType.CAR, 60.0, -1.6, 5.0))
    lanes.add(replace(turned, heading=np.array([np.pi])))
    assert lanes.against == 1
    steps = len(lanes.distances)
    # Beside the street, and at the junction between the two edges.
    lanes.add(scene(("a", RoadUserType.CAR, 60.0, 8.0, 5.0)))
    assert len(lanes.distances) == steps
