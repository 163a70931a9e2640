"""What the teacher holds against modes, by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest

from slrl_sumo.learning.rl.teacher import EASY, LEAST, TeacherWeights, on_route, wandering
from slrl_sumo.scene.types import RoadUserType

CAR, BICYCLE, PEDESTRIAN = RoadUserType
NOTHING = TeacherWeights(**{field.name: 0.0 for field in fields(TeacherWeights)})
MEETING, OFF, SPEED, TURN, STEER, ASIDE, PACE, BRAKE, FOLLOW = range(9)


def _wandering(weights: TeacherWeights, on_lane: bool = True) -> list[float]:
    """Against five modes of somebody who wants 10 m/s and is turned 0.5 rad to the left of its lane."""
    ahead = np.array(
        [
            [0.0, 0.0, 10.0, -0.5],
            [0.5, 0.0, 10.0, -0.5],
            [0.0, 0.25, 10.0, -0.5],
            [0.0, 0.0, 4.0, -0.5],
            [0.0, 0.0, 10.0, np.pi / 2 - 0.5],
        ]
    )
    against = wandering(ahead[None], weights, np.array([10.0]), np.array([0.5]), np.array([on_lane]))
    assert against.shape == (1, 5)
    result: list[float] = against[0].tolist()
    return result


def test_without_a_route_every_part_counts_by_its_weight() -> None:
    assert _wandering(NOTHING) == [0.0] * 5
    assert _wandering(replace(NOTHING, meeting=4.0)) == pytest.approx([0, 2, 0, 0, 0])
    assert _wandering(replace(NOTHING, off_surface=4.0)) == pytest.approx([0, 0, 1, 0, 0])
    assert _wandering(replace(NOTHING, speed=5.0)) == pytest.approx([0, 0, 0, 3, 0])
    assert _wandering(replace(NOTHING, lane=2.0)) == pytest.approx([0, 0, 0, 0, 2])
    assert _wandering(replace(NOTHING, lane=2.0), on_lane=False) == [0.0] * 5
    assert _wandering(replace(NOTHING, steer=9.0, brake=9.0)) == [0.0] * 5
    every = replace(NOTHING, meeting=4.0, off_surface=4.0, speed=5.0, lane=2.0)
    assert _wandering(every) == pytest.approx([0, 2, 1, 3, 2])


def _on_route(weights: TeacherWeights, column: int, value: float, kind: int = CAR, speed: float = 8.0) -> float:
    """Against a mode that leads to `value` in one column, and to nothing in the others."""
    ahead = np.zeros((1, 2, 9))
    ahead[0, 1, column] = value
    against = on_route(ahead, weights, np.array([kind], np.int8), np.array([speed]))
    assert against.shape == (1, 2)
    assert against[0, 0] == 0.0
    return float(against[0, 1])


def test_with_a_route_every_part_counts_by_its_weight() -> None:
    every = TeacherWeights(meeting=2.0, off_surface=3.0, speed=4.0, lane=5.0, steer=6.0, brake=7.0)
    assert _on_route(every, MEETING, 0.5) == pytest.approx(1.0)
    assert _on_route(every, OFF, 0.5) == pytest.approx(1.5)
    assert _on_route(every, STEER, 0.5) == pytest.approx(3.0)
    assert _on_route(every, PACE, -0.5) == _on_route(every, PACE, 0.5) == pytest.approx(2.0)
    for column in (BRAKE, FOLLOW):
        assert _on_route(every, column, EASY) == 0.0
        assert _on_route(every, column, EASY + 0.5) == pytest.approx(3.5)
    # What the path knows better: speed and turn as such, and how far it is aside now.
    for column in (SPEED, TURN, ASIDE):
        assert _on_route(every, column, 3.0) == 0.0
    for name, column in (("meeting", MEETING), ("off_surface", OFF), ("speed", PACE), ("steer", STEER)):
        assert _on_route(replace(every, **{name: 0.0}), column, 1.0) == 0.0
    assert _on_route(replace(every, brake=0.0), BRAKE, 5.0) == 0.0
    assert _on_route(replace(every, lane=0.0), TURN, 1.0) == _on_route(every, TURN, 1.0)


def test_who_hardly_moves_need_not_steer() -> None:
    weights = replace(NOTHING, steer=10.0)
    assert [_on_route(weights, STEER, 1.0, speed=speed) for speed in (0.0, 1.0, 2.0, 13.0)] == pytest.approx(
        [10.0 * LEAST, 5.0, 10.0, 10.0]
    )


def test_pedestrians_mind_their_path_and_their_pavement_less() -> None:
    weights = replace(NOTHING, steer=10.0, off_surface=10.0)
    for speed in (0.0, 1.3):
        assert _on_route(weights, STEER, 1.0, kind=PEDESTRIAN, speed=speed) == pytest.approx(3.3)
    assert _on_route(weights, OFF, 1.0, kind=PEDESTRIAN) == pytest.approx(4.0)
    assert _on_route(weights, OFF, 1.0, kind=BICYCLE) == pytest.approx(10.0)
    assert _on_route(weights, STEER, 1.0, kind=BICYCLE) == pytest.approx(10.0)


def test_everybody_is_judged_alone() -> None:
    random = np.random.default_rng(1)
    ahead, kind, speed = random.random((6, 4, 9)), np.array([0, 1, 2, 0, 1, 2], np.int8), random.random(6) * 4
    together = on_route(ahead, TeacherWeights(), kind, speed)
    assert (together >= 0).all()
    for i in range(6):
        alone = on_route(ahead[i : i + 1], TeacherWeights(), kind[i : i + 1], speed[i : i + 1])
        np.testing.assert_allclose(together[i], alone[0])
