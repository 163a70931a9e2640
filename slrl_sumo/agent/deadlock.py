"""Who has stood long enough: road users that wait for nothing, or for each other, go on."""

import random
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.route_fit import RouteContext, allowed_speed
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

STANDING = 0.1
"""m/s below which somebody stands."""
FREE = 1.0
"""m/s that are allowed to who has nothing to wait for."""
IDLE = 2.0
"""s that such a road user may stand."""
HELD, SPREAD = 12.0, 8.0
"""s that somebody stands before others without a line or a signal that would say so, at least, and what chance adds:
of those that wait for each other one goes first."""
GOING = 2.0
"""s for which who has run out of patience goes on."""
WAITING = 5.0
"""m within which a line to stop at is what somebody waits for."""
DESPERATE = 45.0
"""s after which anything goes but contact at once."""
SOON = 0.6
"""`meeting` (see lookahead) of who is met after 1.6 s."""
MOVING = 0.5
"""m/s of modes that go on."""


class DeadlockTimer:
    """Remembers for how long road users have stood, by id."""

    def __init__(self) -> None:
        self._stood: dict[str, float] = {}
        self._goes: dict[str, tuple[float, float]] = {}

    def tolerance(self, users: WorldState, context: RouteContext) -> Floats:
        """Up to which `meeting` n road users with `context` must go on now, (n,): 0 for who need not.

        Call it once per decision.
        """
        waits = context.route.stop < WAITING
        standing = context.route.known & (users.speed < STANDING) & ~context.route.closed & ~waits
        rows = np.flatnonzero(standing).tolist()
        free = (allowed_speed(context, users) > FREE).tolist() if rows else []
        stood = {users.ids[row]: self._stood.get(users.ids[row], 0.0) + DECISION_INTERVAL for row in rows}
        goes = {
            name: self._goes[name]
            for name in (users.ids if self._goes else ())
            if name in self._goes and name not in stood and self._goes[name][0] > users.time
        }
        for row in rows:
            name = users.ids[row]
            if stood[name] >= (IDLE if free[row] else _held(name)):
                goes[name] = users.time + GOING, SOON if stood[name] < DESPERATE else 1.0
        self._stood, self._goes = stood, goes
        most_met = np.zeros(len(users))
        if goes:
            most_met[:] = [goes[name][1] if name in goes else 0.0 for name in users.ids]
        return np.where(context.route.closed | waits, 0.0, most_met)


@lru_cache(100_000)
def _held(name: str) -> float:
    """s that a road user of this id stands before others."""
    return HELD + SPREAD * random.Random(name).random()


def going(ahead: NDArray[np.float32], tolerance: Floats, allowed: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    """Modes that n road users may choose, (n, modes): who must go on (`tolerance` above 0, (n,)) only such that move
    and meet nobody sooner than that.

    `ahead` (n, modes, 9) as Observation has it; `allowed` what a guard leaves, None for all. Where it leaves none that
    moves, it does not count: standing for ever is no way out.
    """
    if not tolerance.any():
        return allowed
    return _going(ahead, tolerance, np.ones(ahead.shape[:2], np.bool_) if allowed is None else allowed)


@compiled
def _going(ahead: NDArray[np.float32], tolerance: Floats, allowed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    modes, moving = allowed.copy(), np.empty(allowed.shape[1], np.bool_)
    for row in np.flatnonzero(tolerance):
        both = False
        for mode in range(len(moving)):
            moving[mode] = ahead[row, mode, 2] > MOVING and ahead[row, mode, 0] < tolerance[row]
            both |= moving[mode] and modes[row, mode]
        if moving.any():
            for mode in range(len(moving)):
                modes[row, mode] = moving[mode] and (modes[row, mode] or not both)
    return modes
