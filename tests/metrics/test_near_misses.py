import numpy as np
import pytest

from slrl_sumo.metrics.near_misses import Conflict, find_conflicts
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, RoadUserType

CAR, PEDESTRIAN = RoadUserType.CAR, RoadUserType.PEDESTRIAN


Way = tuple[RoadUserType, float, float, float, float]
"""Type, x and y at 0 s (m), heading (rad), speed (m/s)."""


def look(ways: list[Way], seconds: float, stop: float = np.inf) -> list[Conflict]:
    """What is found while all go straight ahead; the first one stands from `stop` on (s)."""
    kind, x, y, heading, speed = np.array(ways, np.float64).T
    types = kind.astype(np.int8)
    times = 0.4 * np.arange(round(seconds / 0.4) + 1)
    boxes, speeds = [], []
    for time in times:
        gone = np.full(len(ways), time)
        gone[0] = min(time, stop)
        now = speed.copy()
        now[0] *= time < stop
        at = (x + gone * speed * np.cos(heading), y + gone * speed * np.sin(heading), heading)
        boxes.append(np.column_stack([*at, DEFAULT_LENGTH[types], DEFAULT_WIDTH[types]]))
        speeds.append(now)
    return find_conflicts(
        box=np.concatenate(boxes),
        speed=np.concatenate(speeds),
        kind=np.tile(types, len(times)),
        user=np.tile(np.arange(len(ways)) + 10, len(times)),
        frame=np.repeat(np.arange(len(times)), len(ways)),
        times=times,
    )


def test_a_car_that_stops_late_is_a_near_miss() -> None:
    # 30 m from its front to the other's tail at 10 m/s: at 2.0 s there are 10 m left, 1.0 s; then it stands.
    (miss,) = look([(CAR, 0, 0, 0, 10), (CAR, 35, 0, 0, 0)], 8.0, stop=2.2)
    assert (miss.kind, miss.a, miss.b) == ("near miss", 10, 11)
    assert miss.time == pytest.approx(2.0)
    assert miss.value == pytest.approx(1.0)
    assert (miss.x, miss.y) == pytest.approx((0.5 * (20 + 35), 0))


def test_a_car_that_stops_in_time_is_none() -> None:
    assert look([(CAR, 0, 0, 0, 10), (CAR, 35, 0, 0, 0)], 8.0, stop=1.5) == []


def test_a_crash_is_one_collision_and_no_near_miss() -> None:
    # Bumpers meet after 3.0 s; boxes overlap in the steps 3.2 s to 4.0 s, then the first is through.
    (hit,) = look([(CAR, 0, 0, 0, 10), (CAR, 35, 0, 0, 0)], 8.0)
    assert (hit.kind, hit.a, hit.b) == ("collision", 10, 11)
    assert hit.time == pytest.approx(3.2)
    assert hit.end == pytest.approx(4.0)
    assert hit.value == pytest.approx(10.0)


def test_two_parked_in_one_place_do_not_collide() -> None:
    assert look([(CAR, 0, 0, 0, 0), (CAR, 1, 0, 0, 0)], 4.0) == []


def test_walkers_come_near_without_being_near_misses_but_cars_and_walkers_are() -> None:
    # Two that stand still 0.6 m beside a walk are passed; with a car in place of one, it is 1.2 m short at 1 s.
    assert look([(PEDESTRIAN, 0, 0, 0, 1.5), (PEDESTRIAN, 2, 0.1, 0, 0)], 0.8) == []
    (miss,) = look([(CAR, 0, 0, 0, 5), (PEDESTRIAN, 8, 0.1, 0, 0)], 2.0, stop=0.9)
    assert miss.kind == "near miss"
    assert miss.time == pytest.approx(0.8)
    assert miss.value == pytest.approx((8 - 4 - 2.5 - 0.5 * DEFAULT_LENGTH[PEDESTRIAN]) / 5)


def test_the_same_pair_later_is_another_event() -> None:
    # The first passes the second, and two cars cross elsewhere at another time.
    events = look([(CAR, 0, 0, 0, 10), (CAR, 20, 0, 0, 0), (CAR, 60, 0, 0, 0)], 7.0)
    assert [(e.kind, e.a, e.b) for e in events] == [("collision", 10, 11), ("collision", 10, 12)]
    assert events[0].time == pytest.approx(1.6)
    assert events[1].time == pytest.approx(5.6)
