"""Who has stood long enough goes on, and not before."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.agent.deadlock import DESPERATE, HELD, IDLE, SOON, SPREAD, DeadlockTimer, going
from slrl_sumo.lookahead.leaders import Leaders
from slrl_sumo.lookahead.lookahead import RouteContext
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

ABLE = Capability(np.zeros((3, 2, 2)), np.broadcast_to(STOPPING, (3, len(STOPPING))))


def _car(time: float, speed: float = 0.0) -> WorldState:
    return make_world(speed=speed, ids=("one",), time=time)


def _prospects(gap: float = np.inf, stop: float = np.inf, closed: bool = False) -> RouteContext:
    route = RouteAhead.unknown(1)
    route.known[:], route.desired[:], route.stop[:], route.closed[:] = True, 10.0, stop, closed
    return RouteContext(route, Leaders(np.array([gap]), np.zeros(1)), ABLE)


def _first(context: RouteContext, most: float, speed: float = 0.0) -> tuple[float, float]:
    """s after which somebody must go on, inf within `most` s for nobody, and the tolerance then."""
    patience = DeadlockTimer()
    for step in range(1, round(most / DECISION_INTERVAL) + 1):
        tolerance = patience.tolerance(_car(step * DECISION_INTERVAL, speed), context)[0]
        if tolerance:
            return step * DECISION_INTERVAL, float(tolerance)
    return np.inf, 0.0


def test_who_has_nothing_to_wait_for_goes_on_soon() -> None:
    after, tolerance = _first(_prospects(), 10.0)
    assert after == pytest.approx(IDLE)
    assert tolerance == SOON
    assert _first(_prospects(), 10.0, speed=1.0)[0] == np.inf


def test_who_stands_before_others_goes_on_later() -> None:
    after, _ = _first(_prospects(gap=1.0), 60.0)
    assert HELD <= after <= HELD + SPREAD + DECISION_INTERVAL


@pytest.mark.parametrize("waits", [_prospects(stop=2.0), _prospects(stop=2.0, closed=True), _prospects(closed=True)])
def test_lines_to_stop_at_are_waited_for_as_long_as_it_takes(waits: RouteContext) -> None:
    assert _first(waits, 120.0)[0] == np.inf


def test_in_the_end_anything_goes_but_contact_at_once() -> None:
    patience, held = DeadlockTimer(), _prospects(gap=1.0)
    seen = [patience.tolerance(_car(k * DECISION_INTERVAL), held)[0] for k in range(round(60.0 / DECISION_INTERVAL))]
    first = next(k for k, tolerance in enumerate(seen) if tolerance == 1.0)
    assert DESPERATE <= (first + 1) * DECISION_INTERVAL <= DESPERATE + 2 * DECISION_INTERVAL
    # A signal that closes is obeyed even then.
    assert patience.tolerance(_car(61.0), _prospects(closed=True))[0] == 0.0
    # And who has been driving for a while has patience again.
    patience.tolerance(_car(70.0, speed=5.0), held)
    assert patience.tolerance(_car(70.4), held)[0] == 0.0


def test_only_modes_that_move_and_meet_nobody_soon_are_left() -> None:
    ahead = np.zeros((1, 4, 9), np.float32)
    ahead[0, :, 2] = 0.0, 3.0, 3.0, 3.0
    ahead[0, :, 0] = 0.0, 0.0, 0.5, 0.875
    assert going(ahead, np.zeros(1), None) is None
    modes = going(ahead, np.array([SOON]), None)
    assert modes is not None
    assert modes[0].tolist() == [False, True, True, False]
    # A guard's choice is kept to where it leaves a mode that moves, and does not count where it leaves standing alone.
    guarded = np.array([[True, False, True, False]])
    assert going(ahead, np.array([SOON]), guarded).tolist() == [[False, False, True, False]]  # type: ignore[union-attr]
    standing = np.array([[True, False, False, False]])
    assert going(ahead, np.array([SOON]), standing).tolist() == [[False, True, True, False]]  # type: ignore[union-attr]
    # Where every way on is blocked, one waits.
    ahead[0, 1:, 0] = 1.0
    assert going(ahead, np.array([1.0]), None).all()  # type: ignore[union-attr]


def test_nobody_without_a_route_is_driven_on() -> None:
    lost = _prospects()
    unknown = replace(lost, route=replace(lost.route, known=np.zeros(1, np.bool_)))
    assert _first(unknown, 60.0)[0] == np.inf
