"""Positions on lanes: the nearest one of the own direction, the place of the front, and the way off the lanes."""

import numpy as np
import pytest

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.studies.flow.trace import TraceBuilder, on_lanes
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, Lane
from tests.builders import make_world


def lane(name: str, *shape: tuple[float, float], classes: frozenset[str] = MOTOR_CLASSES) -> Lane:
    line = np.array(shape)
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    return Lane(name, name, line, 3.2, length, 13.89, classes, False, Surface.ROAD)


def test_rows_are_sorted_by_vehicle_and_time_without_pedestrians() -> None:
    builder = TraceBuilder()
    for time in (0.4, 0.8):
        builder.add(make_world(x=[5.0, time, 9.0], type=[0, 1, 2], ids=("b", "a", "walker"), time=time))
    trace = builder.build()
    assert trace.ids == ("b", "a")
    assert trace.vehicle.tolist() == [0, 0, 1, 1]
    assert trace.time.tolist() == [0.4, 0.8, 0.4, 0.8]
    assert trace.x.tolist() == [5.0, 5.0, 0.4, 0.8]
    assert trace.starts.tolist() == [0, 2, 4]
    assert len(TraceBuilder().build()) == 0


def test_a_car_is_on_the_lane_of_its_direction_and_its_distance_off_the_road_is_that_of_the_nearest() -> None:
    lanes = [
        lane("path", (0.0, -3.0), (100.0, -3.0), classes=frozenset({"pedestrian"})),
        lane("east", (0.0, 0.0), (100.0, 0.0)),
        lane("across", (50.0, -50.0), (50.0, 50.0)),
        lane("west", (100.0, 3.2), (0.0, 3.2)),
    ]
    builder = TraceBuilder()
    # On its lane; at the crossing; 4 m beside the road; on the lane of the other direction.
    builder.add(
        make_world(x=[20.3, 50.2, 20.0, 20.0], y=[0.5, 0.1, -5.6, 3.0], length=5.0, heading=[0.0, np.pi / 2, 0.0, 0.0])
    )
    on = on_lanes(builder.build(), lanes)
    assert [on.lanes[k].id for k in on.lane] == ["east", "across", "east", "east"]
    assert on.front == pytest.approx([22.8, 52.6, 22.5, 22.5])
    assert on.aside == pytest.approx([0.5, -0.2, -5.6, 3.0])
    assert on.outside == pytest.approx([0.0, 0.0, 4.0, 0.0])
