"""The guard: which modes it leaves, by hand, and that it holds throughout a run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import make_routes
from numpy.typing import NDArray

from slrl_sumo.agent import decide
from slrl_sumo.agent.guard import guard
from slrl_sumo.agent.selectors import PolicySelector
from slrl_sumo.errors import InputError
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.route_fit import RouteFit
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings

CAR, BICYCLE, PEDESTRIAN = RoadUserType
NAMES = ("collision", "off_surface", "speed", "turn", *RouteFit._fields)
MEETING, OFF, SPEED, TURN, STEER, ASIDE, PACE, BRAKE, FOLLOW, _ = range(10)


def rolled_out(columns: NDArray[np.float64], off_route: NDArray[np.float64]) -> ModeRollouts:
    """Rollouts of these values, (n, modes, 10), columns as in NAMES."""
    fields = {name: columns[..., column] for column, name in enumerate(NAMES)}
    route = RouteFit(**{name: fields.pop(name) for name in RouteFit._fields})
    still = np.zeros(off_route.shape)
    return ModeRollouts(still, still, **fields, route=route, collision_off_route=off_route)


def left(
    *modes: dict[int, float],
    kind: int = CAR,
    closed: bool = False,
    known: bool = True,
    touching: tuple[float, ...] = (),
) -> list[int]:
    """The modes that are left of `modes`, which lead to these values by column and to nothing in the others."""
    ahead = np.zeros((1, len(modes), 10))
    for mode, values in enumerate(modes):
        for column, value in values.items():
            ahead[0, mode, column] = value
    route = make_routes(0.0, known=known, stop_at_signal=closed)
    touched = np.zeros((1, len(modes)))
    touched[0, : len(touching)] = touching
    allowed = guard(rolled_out(ahead, touched), np.array([kind], np.int8), route)
    assert allowed.shape == (1, len(modes))
    assert allowed.dtype == np.bool_
    return [int(mode) for mode in np.flatnonzero(allowed[0])]


@pytest.mark.parametrize("kind", [CAR, BICYCLE, PEDESTRIAN])
def test_modes_without_a_conflict_are_all_allowed(kind: int) -> None:
    assert left({}, {SPEED: 20.0}, {TURN: 2.0}, {STEER: 1.0, ASIDE: 5.0, PACE: -1.0}, kind=kind) == [0, 1, 2, 3]


@pytest.mark.parametrize("kind", [CAR, BICYCLE, PEDESTRIAN])
def test_collisions_and_leaving_the_surface_are_masked(kind: int) -> None:
    assert left({MEETING: 0.5}, {}, {MEETING: 1.0}, kind=kind) == [1]
    # Road users that are met later than in 2 s are left to the selector.
    assert left({MEETING: 0.375}, {}, {MEETING: 1.0}, kind=kind) == [0, 1]
    assert left({OFF: 1 / 3}, {}, {OFF: 1.0}, kind=kind) == [1]


def test_a_road_user_on_the_rollout_of_a_mode_is_hit_soon() -> None:
    # Within 1.2 s, three intervals; later the path says where it goes.
    assert left({}, {}, {}, {MEETING: 1.0}, touching=(1.0, 0.75, 0.625)) == [2]
    assert left({}, {}, touching=(1.0, 0.875)) == [1]


def test_braking_too_late_counts_before_closed_signals_only() -> None:
    late = ({BRAKE: 1.01}, {BRAKE: 1.0}, {BRAKE: 8.0}, {BRAKE: 0.2})
    for kind in RoadUserType:
        assert left(*late, kind=kind, closed=True) == [1, 3]
        # Where others have to go first, or the lane ends, it is for the selector to decide.
        assert left(*late, kind=kind, closed=False) == [0, 1, 2, 3]
    assert left(*late, closed=True, known=False) == [0, 1, 2, 3]


def test_vehicles_keep_behind_their_leader() -> None:
    late = ({FOLLOW: 1.01}, {FOLLOW: 0.99}, {FOLLOW: 8.0})
    assert left(*late) == left(*late, kind=BICYCLE) == [1]
    assert left(*late, kind=PEDESTRIAN) == [0, 1, 2]


def test_where_nothing_is_left_the_latest_conflict_is() -> None:
    assert left({MEETING: 1.0}, {MEETING: 0.5}, {MEETING: 0.625}, {MEETING: 0.5}) == [1, 3]
    assert left({OFF: 1.0}, {OFF: 1 / 3}, {OFF: 2 / 3}) == [1]
    assert left({BRAKE: 3.0}, {BRAKE: 1.5}, {BRAKE: 8.0}, closed=True) == [1]
    assert left({FOLLOW: 3.0}, {FOLLOW: 2.0}) == [1]
    # Contact is worse than a signal, and that than a kerb.
    assert left({MEETING: 1.0}, {BRAKE: 8.0}, {OFF: 1.0}, closed=True) == [2]
    assert left({MEETING: 1.0}, {BRAKE: 8.0}, closed=True) == [1]
    assert left({FOLLOW: 8.0}, {BRAKE: 8.0}, closed=True) == [1]
    # Of two conflicts of one mode the worse one counts.
    assert left({MEETING: 0.25, OFF: 1.0}, {MEETING: 0.5}) == [1]


def test_each_keeps_at_least_one_mode_and_is_judged_alone() -> None:
    random = np.random.default_rng(1)
    n = 300
    ahead = random.random((n, 20, 10)) * (random.random((n, 20, 10)) < 0.6) * 8.0
    ahead[..., :2] = np.minimum(ahead[..., :2], 1.0)
    kind = random.integers(0, 3, n).astype(np.int8)
    route = make_routes(np.zeros((n, 1)), known=random.random(n) < 0.8, stop_at_signal=random.random(n) < 0.5)
    touching = random.integers(0, 9, (n, 20)) / 8.0 * (random.random((n, 20)) < 0.3)
    allowed = guard(rolled_out(ahead, touching), kind, route)
    assert allowed.any(axis=1).all()
    assert 0.05 < allowed.mean() < 0.95
    for row in range(0, n, 23):
        some = np.array([row])
        alone = guard(rolled_out(ahead[some], touching[some]), kind[some], route.take(some))
        np.testing.assert_array_equal(alone, allowed[some])


GUARDED = RunSettings("signalised", agents=6, steps=4, seed=3, bundle="intersection-paper", guard=True)


def chosen(settings: RunSettings) -> list[list[int]]:
    """The modes of every decision of a run."""
    decisions = [event for event in run(settings) if isinstance(event, Decision)]
    return [decision.modes.tolist() for decision in decisions if decision.modes is not None]


@pytest.mark.parametrize("selector", ["prior", "greedy", "sampled"])
def test_in_a_run_only_what_the_guard_leaves_is_chosen(monkeypatch: pytest.MonkeyPatch, selector: str) -> None:
    asked: list[NDArray[np.bool_]] = []

    def strict(rollouts: ModeRollouts, kind: NDArray[np.int8], route: RouteAhead) -> NDArray[np.bool_]:
        assert rollouts.route is not None
        assert rollouts.collision_off_route is not None
        assert rollouts.collision_off_route.shape == rollouts.route.follow_ratio.shape == (6, 20)
        assert len(kind) == len(route) == 6
        assert route.known[kind != PEDESTRIAN].all()
        allowed = np.zeros((6, 20), np.bool_)
        allowed[np.arange(6), (3 * np.arange(6) + len(asked)) % 20] = True
        asked.append(allowed)
        return allowed

    monkeypatch.setattr(decide, "guard", strict)
    modes = chosen(replace(GUARDED, selector=selector))
    assert modes == [allowed.argmax(axis=1).tolist() for allowed in asked]
    assert len(modes) == 4
    # Without it nothing is masked.
    assert chosen(replace(GUARDED, selector=selector, guard=False)) != modes
    assert len(asked) == 4


def test_the_guard_changes_what_a_selector_sees_of_modes_in_no_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """A policy of the preset `paper` was not trained on routes."""
    seen: list[tuple[tuple[int, ...], bool]] = []
    choose = PolicySelector.choose

    def watched(self: PolicySelector, observation: Any, rollouts: Any, ids: Any = None, masks: Any = ()) -> Any:
        seen.append((rollouts.collision.shape, rollouts.route is None and observation.route is None))
        return choose(self, observation, rollouts, ids, masks)

    monkeypatch.setattr(PolicySelector, "choose", watched)
    assert len(list(run(replace(GUARDED, selector="greedy", steps=2)))) == 3
    assert seen == [((6, 20), True)] * 2


def test_a_guard_of_the_lane_follower_is_refused() -> None:
    with pytest.raises(InputError, match="guard: `selector='lane'` chooses no modes"):
        next(run(replace(GUARDED, selector="lane")))
