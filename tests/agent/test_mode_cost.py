"""Costs of modes for the teacher, by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.agent.mode_cost import EASY, LEAST, CostWeights, cost_on_route, cost_without_route
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.off_surface import JUST_OFF
from slrl_sumo.lookahead.route_fit import RouteFit
from slrl_sumo.scene.types import RoadUserType

CAR, BICYCLE, PEDESTRIAN = RoadUserType
NOTHING = CostWeights(**{field.name: 0.0 for field in fields(CostWeights)})
NAMES = ("collision", "off_surface", "speed", "turn", *RouteFit._fields)
COLLISION, OFF, SPEED, TURN, STEER, ASIDE, PACE, BRAKE, FOLLOW, LEADER = range(10)


def _rollouts(columns: NDArray[np.float64]) -> ModeRollouts:
    """Rollouts of these values, (n, modes, 4 or 10), columns as in NAMES."""
    fields = {name: columns[..., column] for column, name in zip(range(columns.shape[-1]), NAMES, strict=False)}
    route = RouteFit(**{name: fields.pop(name) for name in RouteFit._fields}) if len(fields) > 4 else None
    still = np.zeros(columns.shape[:2])
    return ModeRollouts(still, still, **fields, route=route)


def _wandering(weights: CostWeights, on_lane: bool = True) -> list[float]:
    """Costs of five modes of a road user that wants 10 m/s and is turned 0.5 rad to the left of its lane."""
    ahead = np.array(
        [
            [0.0, 0.0, 10.0, -0.5],
            [0.5, 0.0, 10.0, -0.5],
            [0.0, 0.25, 10.0, -0.5],
            [0.0, 0.0, 4.0, -0.5],
            [0.0, 0.0, 10.0, np.pi / 2 - 0.5],
        ]
    )
    against = cost_without_route(
        _rollouts(ahead[None]), weights, np.array([10.0]), np.array([0.5]), np.array([on_lane])
    )
    assert against.shape == (1, 5)
    result: list[float] = against[0].tolist()
    return result


def test_without_a_route_every_part_counts_by_its_weight() -> None:
    assert _wandering(NOTHING) == [0.0] * 5
    assert _wandering(replace(NOTHING, collision=4.0)) == pytest.approx([0, 2, 0, 0, 0])
    assert _wandering(replace(NOTHING, off_surface=4.0)) == pytest.approx([0, 0, 1, 0, 0])
    assert _wandering(replace(NOTHING, speed=5.0)) == pytest.approx([0, 0, 0, 3, 0])
    assert _wandering(replace(NOTHING, lane=2.0)) == pytest.approx([0, 0, 0, 0, 2])
    assert _wandering(replace(NOTHING, lane=2.0), on_lane=False) == [0.0] * 5
    assert _wandering(replace(NOTHING, heading_error=9.0, braking=9.0)) == [0.0] * 5
    every = replace(NOTHING, collision=4.0, off_surface=4.0, speed=5.0, lane=2.0)
    assert _wandering(every) == pytest.approx([0, 2, 1, 3, 2])


def _on_route(weights: CostWeights, column: int, value: float, kind: int = CAR, speed: float = 8.0) -> float:
    """Cost of a mode with `value` in one column, and zeros in the others."""
    ahead = np.zeros((1, 2, 10))
    ahead[0, 1, column] = value
    against = cost_on_route(_rollouts(ahead), weights, np.array([kind], np.int8), np.array([speed]))
    assert against.shape == (1, 2)
    assert against[0, 0] == 0.0
    return float(against[0, 1])


def test_with_a_route_every_part_counts_by_its_weight() -> None:
    every = CostWeights(collision=2.0, off_surface=3.0, speed=4.0, lane=5.0, heading_error=6.0, braking=7.0)
    assert _on_route(every, COLLISION, 0.5) == pytest.approx(1.0)
    assert _on_route(every, OFF, 0.5) == pytest.approx(3.0 * 0.5 / JUST_OFF)
    assert _on_route(every, STEER, 0.5) == pytest.approx(1.5)
    assert _on_route(every, PACE, -0.5) == _on_route(every, PACE, 0.5) == pytest.approx(2.0)
    for column in (BRAKE, FOLLOW):
        assert _on_route(every, column, EASY) == 0.0
        assert _on_route(every, column, EASY + 0.5) == pytest.approx(3.5)
    # What the path knows better: speed and turn as such, and how far it is aside now.
    for column in (SPEED, TURN, ASIDE):
        assert _on_route(every, column, 3.0) == 0.0
    for name, column in (("collision", COLLISION), ("off_surface", OFF), ("speed", PACE), ("heading_error", STEER)):
        assert _on_route(replace(every, **{name: 0.0}), column, 1.0) == 0.0
    assert _on_route(replace(every, braking=0.0), BRAKE, 5.0) == 0.0
    assert _on_route(replace(every, lane=0.0), TURN, 1.0) == _on_route(every, TURN, 1.0)


def test_the_distance_in_which_the_leader_stops_is_not_shortened() -> None:
    weights = replace(NOTHING, braking=7.0)
    ahead = np.zeros((1, 2, 10))
    for leader, late in ((0.0, 0.95 - EASY), (0.5, 0.85 - EASY), (0.8, 0.0), (0.95, 0.0)):
        ahead[0, 1, [FOLLOW, LEADER]] = 0.95, leader
        cost = cost_on_route(_rollouts(ahead), weights, np.zeros(1, np.int8), np.array([30.0]))
        assert cost[0, 1] == pytest.approx(7.0 * late), leader
    # Too late is too late, whatever the leader does.
    ahead[0, 1, [FOLLOW, LEADER]] = 1.05, 1.0
    assert cost_on_route(_rollouts(ahead), weights, np.zeros(1, np.int8), np.array([30.0]))[0, 1] > 0.0


def test_a_road_user_that_hardly_moves_need_not_steer() -> None:
    weights = replace(NOTHING, heading_error=10.0)
    assert [_on_route(weights, STEER, 1.0, speed=speed) for speed in (0.0, 1.0, 2.0, 13.0)] == pytest.approx(
        [10.0 * LEAST, 5.0, 10.0, 10.0]
    )


def test_pedestrians_mind_their_path_less() -> None:
    weights = replace(NOTHING, heading_error=10.0)
    for speed in (0.0, 1.3):
        slow = replace(weights, speed=5.0)
        assert _on_route(slow, STEER, 1.0, kind=PEDESTRIAN, speed=speed) == pytest.approx(3.3)
    assert _on_route(weights, STEER, 1.0, kind=BICYCLE) == pytest.approx(10.0)


def test_leaving_the_surface_by_a_metre_costs_four_times_as_much_as_just_leaving_it() -> None:
    weights = replace(NOTHING, off_surface=10.0)
    for kind in (PEDESTRIAN, BICYCLE):
        assert [_on_route(weights, OFF, off, kind=kind) for off in (0.0, JUST_OFF, 1.0)] == pytest.approx([0, 10, 40])
    # A pedestrian rather stands.
    off = _on_route(CostWeights(), OFF, 0.5, kind=PEDESTRIAN, speed=1.3)
    assert off > _on_route(CostWeights(), PACE, -1.0, kind=PEDESTRIAN, speed=1.3)


def test_a_pedestrian_rather_walks_around_than_stands() -> None:
    weights = CostWeights()
    stands = _on_route(weights, PACE, -1.0, kind=PEDESTRIAN, speed=1.3)
    assert _on_route(weights, STEER, 0.8, kind=PEDESTRIAN, speed=1.3) < stands
    assert _on_route(weights, STEER, 1.2, kind=PEDESTRIAN, speed=1.3) > stands
    assert _on_route(weights, STEER, 0.3, kind=BICYCLE, speed=1.3) > stands


def test_a_pedestrian_that_cannot_turn_at_its_pace_stops_to_turn() -> None:
    """The first mode walks on beside its path, the second one brakes to a stop with the same heading."""
    ahead = np.zeros((1, 2, 10))
    ahead[0, :, STEER] = 1.3, 0.85
    ahead[0, 1, PACE] = -1.0
    kind, speed = np.array([PEDESTRIAN], np.int8), np.array([1.3])
    walks_on, stops = cost_on_route(_rollouts(ahead), CostWeights(), kind, speed)[0]
    assert stops < walks_on
    # A small turn is walked.
    ahead[0, :, STEER] = 0.5, 0.3
    walks_on, stops = cost_on_route(_rollouts(ahead), CostWeights(), kind, speed)[0]
    assert walks_on < stops


def test_each_road_user_is_judged_alone() -> None:
    random = np.random.default_rng(1)
    ahead, kind, speed = random.random((6, 4, 10)), np.array([0, 1, 2, 0, 1, 2], np.int8), random.random(6) * 4
    together = cost_on_route(_rollouts(ahead), CostWeights(), kind, speed)
    assert (together >= 0).all()
    for i in range(6):
        alone = cost_on_route(_rollouts(ahead[i : i + 1]), CostWeights(), kind[i : i + 1], speed[i : i + 1])
        np.testing.assert_allclose(together[i], alone[0])
