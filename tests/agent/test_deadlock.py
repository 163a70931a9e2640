"""Road users that have stood long enough go on, and not before."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_routes, make_world

from slrl_sumo.agent.deadlock import (
    ANY,
    BLOCKED,
    IDLE,
    LONG,
    LONGEST,
    NEAR,
    SOON,
    SPREAD,
    THROUGH,
    DeadlockTimer,
    force_progress,
)
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.off_surface import JUST_OFF
from slrl_sumo.lookahead.route_fit import allowed_speed
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.perception.route_context import GAP, RouteContext, route_context
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

ABLE = Capability(np.zeros((3, 2, 2)), np.broadcast_to(STOPPING, (3, len(STOPPING))))


def _car(time: float, speed: float = 0.0) -> WorldState:
    return make_world(speed=speed, ids=("one",), time=time)


def _context(gap: float = np.inf, stop: float = np.inf, closed: bool = False) -> RouteContext:
    """A route straight ahead with a leader that stands `gap` m away."""
    route = make_routes(np.zeros((1, 1)), desired_speed=10.0, stop=stop, stop_at_signal=closed)
    return replace(
        route_context(route, _car(0.0)), leader_gap=np.array([gap]), follow_distance=np.array([gap - GAP[0]])
    )


def _tolerance(timer: DeadlockTimer, car: WorldState, context: RouteContext) -> float:
    return float(timer.tolerance(car, context, allowed_speed(context, ABLE, car))[0])


def _first(context: RouteContext, most: float, speed: float = 0.0) -> tuple[float, float]:
    """s after which the car is forced to go on, inf if not within `most` s, and the tolerance then."""
    timer = DeadlockTimer()
    for step in range(1, round(most / DECISION_INTERVAL) + 1):
        tolerance = _tolerance(timer, _car(step * DECISION_INTERVAL, speed), context)
        if tolerance:
            return step * DECISION_INTERVAL, tolerance
    return np.inf, 0.0


def test_a_road_user_without_a_reason_to_stand_goes_on_soon() -> None:
    after, tolerance = _first(_context(), 10.0)
    assert after == pytest.approx(IDLE)
    assert tolerance == SOON
    assert _first(_context(), 10.0, speed=1.0)[0] == np.inf


def test_a_road_user_that_stands_before_others_goes_on_later() -> None:
    after, _ = _first(_context(gap=1.0), 60.0)
    assert BLOCKED <= after <= BLOCKED + SPREAD + DECISION_INTERVAL


def test_a_vehicle_in_a_queue_waits_for_its_leader_as_long_as_that_stands() -> None:
    queues = replace(_context(gap=1.0), queues=np.array([True]))
    assert _first(queues, 120.0)[0] == np.inf
    # Behind a leader far ahead it drives up.
    assert _first(replace(_context(gap=40.0), queues=np.array([True])), 10.0)[0] == pytest.approx(IDLE)


@pytest.mark.parametrize("waits", [_context(stop=2.0), _context(stop=2.0, closed=True)])
def test_lines_to_stop_at_are_waited_for_as_long_as_it_takes(waits: RouteContext) -> None:
    assert _first(waits, 120.0)[0] == np.inf


def test_a_red_signal_far_ahead_is_no_reason_to_stand() -> None:
    assert _first(_context(stop=260.0, closed=True), 10.0)[0] == pytest.approx(IDLE)
    # Nor is it one for two that stand before each other; behind others that go the same way it may be.
    after, _ = _first(_context(gap=1.0, stop=260.0, closed=True), 60.0)
    assert BLOCKED <= after <= BLOCKED + SPREAD + DECISION_INTERVAL
    on_foot = replace(_car(0.0), type=np.full(1, RoadUserType.PEDESTRIAN, np.int8))
    queues = replace(_context(gap=0.2, stop=12.0, closed=True), queues=np.array([True]))
    green = replace(queues, route=replace(queues.route, stop_at_signal=np.zeros(1, np.bool_)))
    for context, forced in ((queues, False), (green, True)):
        timer = DeadlockTimer()
        seen = [_tolerance(timer, replace(on_foot, time=k * DECISION_INTERVAL), context) for k in range(150)]
        assert any(seen) == forced


def test_beyond_its_line_a_road_user_goes_on_as_one_that_stands_before_others() -> None:
    after, _ = _first(_context(stop=-1.3), 60.0)
    assert BLOCKED <= after <= BLOCKED + SPREAD + DECISION_INTERVAL
    assert _first(_context(stop=-0.5), 60.0)[0] == np.inf
    assert _first(_context(stop=-1.3, closed=True), 60.0)[0] == np.inf


def test_a_red_signal_interrupts_the_time_that_a_road_user_has_stood() -> None:
    timer, blocked, red = DeadlockTimer(), _context(gap=1.0), _context(gap=1.0, stop=3.0, closed=True)
    # Green for 8 s, red for 20 s: less than BLOCKED in each green.
    seen = [_tolerance(timer, _car(k * DECISION_INTERVAL), blocked if k % 70 < 20 else red) for k in range(4 * 70)]
    assert not any(seen[:70])
    assert any(seen[70:210])
    assert not any(tolerance for k, tolerance in enumerate(seen) if k % 70 >= 20)
    # One that moves begins anew.
    _tolerance(timer, _car(200.0, speed=1.0), blocked)
    assert _tolerance(timer, _car(210.0), blocked) == 0.0


def test_in_the_end_any_mode_counts_that_does_not_collide_at_once() -> None:
    timer, held = DeadlockTimer(), _context(gap=1.0)
    seen = [_tolerance(timer, _car(k * DECISION_INTERVAL), held) for k in range(round(60.0 / DECISION_INTERVAL))]
    first = next(k for k, tolerance in enumerate(seen) if tolerance == 1.0)
    assert LONG <= (first + 1) * DECISION_INTERVAL <= LONG + 2 * DECISION_INTERVAL
    # A signal that closes is obeyed even then.
    assert _tolerance(timer, _car(61.0), _context(stop=3.0, closed=True)) == 0.0
    # After driving for a while, the time begins anew.
    _tolerance(timer, _car(70.0, speed=5.0), held)
    assert _tolerance(timer, _car(70.4), held) == 0.0


def test_creeping_does_not_begin_the_time_anew() -> None:
    """A car that crept by 0.2 m every 20 s kept two persons waiting for 200 s."""
    timer, held, place, most = DeadlockTimer(), _context(gap=1.0), 0.0, []
    for k in range(round(120.0 / DECISION_INTERVAL)):
        creeps = k % 50 == 49
        place += 0.2 * creeps
        car = replace(_car(k * DECISION_INTERVAL, speed=0.5 * creeps), x=np.array([place]))
        most.append(_tolerance(timer, car, held))
    assert max(most[: round(LONG / DECISION_INTERVAL)]) == SOON
    assert max(most[: round(LONGEST / DECISION_INTERVAL)]) == 1.0
    assert most[-2] == THROUGH
    far = replace(_car(121.0), x=np.array([place + NEAR]))
    later = [_tolerance(timer, replace(far, time=121.0 + k * DECISION_INTERVAL), held) for k in range(60)]
    assert max(later) == SOON


def test_persons_that_block_each_other_for_long_may_choose_any_mode() -> None:
    timer, held = DeadlockTimer(), _context(gap=1.0)
    walker = replace(_car(0.0), type=np.array([RoadUserType.PEDESTRIAN], np.int8))
    seen = [_tolerance(timer, replace(walker, time=k * DECISION_INTERVAL), held) for k in range(round(60 / 0.4))]
    assert max(seen) == ANY
    none, collision = np.zeros((1, 2)), np.array([[0.0, 1.0]])
    modes = force_progress(
        ModeRollouts(none, none, collision, none, np.array([[0.0, 1.2]]), none), np.array([ANY]), None
    )
    assert modes is not None
    assert modes[0].tolist() == [False, True]


def test_only_modes_that_move_and_do_not_collide_soon_are_left() -> None:
    none = np.zeros((1, 4))
    collision, speed = np.array([[0.0, 0.0, 0.5, 0.875]]), np.array([[0.0, 3.0, 3.0, 3.0]])
    rollouts = ModeRollouts(none, none, collision, none, speed, none)
    assert force_progress(rollouts, np.zeros(1), None) is None
    modes = force_progress(rollouts, np.array([SOON]), None)
    assert modes is not None
    assert modes[0].tolist() == [False, True, True, False]
    # A guard's choice is kept to where it leaves a mode that moves, and does not count where it leaves standing alone.
    guarded = np.array([[True, False, True, False]])
    assert force_progress(rollouts, np.array([SOON]), guarded).tolist() == [[False, False, True, False]]  # type: ignore[union-attr]
    standing = np.array([[True, False, False, False]])
    assert force_progress(rollouts, np.array([SOON]), standing).tolist() == [[False, True, True, False]]  # type: ignore[union-attr]
    # Where every way on is blocked, one waits, but not for ever.
    collision[0, 1:] = 1.0
    assert force_progress(rollouts, np.array([1.0]), None).all()  # type: ignore[union-attr]
    assert force_progress(rollouts, np.array([THROUGH]), None).tolist() == [[False, True, True, True]]  # type: ignore[union-attr]


def test_a_forced_road_user_does_not_leave_the_ground() -> None:
    """Persons in a crowd at a corner were forced off it by more than 1 m, where they stayed until the way was free."""
    none, speed = np.zeros((1, 4)), np.array([[0.0, 1.2, 1.2, 1.2]])

    def left(off_surface: list[float], tolerance: float = SOON) -> list[bool]:
        rollouts = ModeRollouts(none, none, none, np.array([off_surface]), speed, none)
        modes = force_progress(rollouts, np.array([tolerance]), None)
        assert modes is not None
        return modes[0].tolist()

    assert left([0.0, 0.0, JUST_OFF, 0.5]) == [False, True, True, False]
    # Off it already, no farther.
    assert left([0.5, 0.5, 0.25, 0.75]) == [False, True, True, False]
    # With no other way on, one stands, until any mode counts.
    assert left([0.0, 0.5, 0.5, 0.5]) == left([0.0, 0.5, 0.5, 0.5], THROUGH) == [True] * 4
    assert left([0.0, 0.5, 0.5, 0.5], ANY) == [False, True, True, True]


def test_road_users_without_a_route_are_not_forced() -> None:
    lost = _context()
    unknown = replace(lost, route=replace(lost.route, known=np.zeros(1, np.bool_)))
    assert _first(unknown, 60.0)[0] == np.inf
