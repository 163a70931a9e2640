"""Constraint `deadlock_release`: road users that stand without a reason, or block each other, are forced to move."""

import math
import random
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_rollouts import ModeRollouts
from slrl_sumo.lookahead.off_surface import JUST_OFF
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN

STANDING = 0.1
"""Speed (m/s) below which a road user stands."""
FREE = 1.0
"""Allowed speed (m/s) above which a road user has no reason to stand."""
IDLE = 2.0
"""Time (s) for which a road user may stand without a reason."""
BLOCKED, SPREAD = 12.0, 8.0
"""Least time (s) for which a blocked road user stands, and the range (s) of an addition that depends on its id, so that
one of several road users that block each other goes first."""
FORCED = 2.0
"""Time (s) for which a road user is forced to move."""
WAITING = 5.0
"""Distance (m) within which a stop line is a reason to stand."""
BEYOND = 1.0
"""Distance (m) past a stop line from which the line is no reason to stand: there a road user blocks crossing road
users, which wait for it."""
LONG, NEAR = 45.0, 2.0
"""Standing time (s) without a reason within NEAR (m) of one place after which a vehicle may choose each mode without an
immediate collision, and a pedestrian any mode, as SUMO's persons walk through each other in a jam. A car that was
forced to creep by 0.2 m at a time, and two persons in contact before it, stood on a crossing for 200 s."""
LONGEST = 90.0
"""The same (s) after which a vehicle may choose each mode on its own surfaces: two that touch collide at once in each
mode that moves, and one across the lanes of a street stopped them for the rest of a run. SUMO teleports after 300 s."""
THROUGH, ANY = 1.5, 2.0
"""Tolerances of all collision scores: on the own surfaces, and anywhere."""
SOON = 0.6
"""Collision score of a collision after 1.6 s."""
MOVING = 0.5
"""Speed (m/s) above which a mode moves (ModeRollouts.speed)."""


class DeadlockTimer:
    """Standing times of road users, by id, and the road users that are forced to move."""

    def __init__(self) -> None:
        self._stood: dict[str, float] = {}
        self._forced: dict[str, tuple[float, float]] = {}
        self._blocked: dict[str, tuple[float, float, float]] = {}
        """Where (m) road users began to stand without a reason, and for how long (s) they have stood near there."""

    def tolerance(self, users: WorldState, context: RouteContext, allowed_speed: Floats) -> Floats:
        """Highest collision score tolerated by each of n road users that is forced to move, (n,); 0: not forced.

        `users` and `context`: all learned road users. `allowed_speed`: m/s, (n,). Call it once per decision.
        """
        route = context.route
        inside = np.isfinite(route.junction_entry_time)
        # An exit that is taken is also a reason to stand: inside the junction, the road user would stop others, until
        # all of them stand in a circle.
        waits = (route.stop < WAITING) | (~inside & (context.stop_distance < WAITING))
        waits &= route.stop > -BEYOND
        # A red signal is a reason to stand at its line, and in a queue before it, but not 260 m before it. Inside a
        # junction, the signal of the next junction is no reason.
        held = context.queues & (allowed_speed <= FREE)
        closed = route.stop_at_signal & ~inside & ((route.stop < WAITING) | held)
        standing = route.known & (users.speed < STANDING)
        rows = np.flatnonzero(standing & ~closed & ~waits).tolist()
        free = (allowed_speed > FREE).tolist() if rows else []
        queues = (context.queues & (users.type != PEDESTRIAN)).tolist() if rows else []
        # A red signal only interrupts the standing time: otherwise two pedestrians would block each other in every
        # green phase.
        stood = {users.ids[row]: self._stood.get(users.ids[row], 0.0) for row in np.flatnonzero(standing).tolist()}
        for row in rows:
            stood[users.ids[row]] += DECISION_INTERVAL
        forced = {
            name: self._forced[name]
            for name in (users.ids if self._forced else ())
            if name in self._forced and name not in stood and self._forced[name][0] > users.time
        }
        for row in rows:
            name, blocked = users.ids[row], self._blocked_time(users, row)
            # A vehicle at the end of a queue is not forced: it would drive into its leader.
            if stood[name] >= (IDLE if free[row] else math.inf if queues[row] else _limit(name)):
                forced[name] = users.time + FORCED, _tolerance(blocked, users.type[row] == PEDESTRIAN)
        self._stood, self._forced = stood, forced
        tolerance = np.zeros(len(users))
        if forced:
            tolerance[:] = [forced[name][1] if name in forced else 0.0 for name in users.ids]
        return np.where(closed | waits, 0.0, tolerance)

    def _blocked_time(self, users: WorldState, row: int) -> float:
        """Time (s) for which a road user has stood without a reason, now included, within NEAR of one place."""
        name, x, y = users.ids[row], users.x.item(row), users.y.item(row)
        begin_x, begin_y, time = self._blocked.get(name, (x, y, 0.0))
        if math.hypot(x - begin_x, y - begin_y) > NEAR:
            begin_x, begin_y, time = x, y, 0.0
        self._blocked[name] = begin_x, begin_y, time + DECISION_INTERVAL
        return time + DECISION_INTERVAL

    def forget(self, ids: tuple[str, ...]) -> None:
        """Drop the standing times of road users that are no longer learned."""
        for name in ids:
            for known in (self._stood, self._forced, self._blocked):
                known.pop(name, None)


def _tolerance(blocked: float, walks: bool) -> float:
    """Highest collision score tolerated by a road user that has been blocked for so long (s)."""
    if blocked < LONG:
        return SOON
    if walks:
        return ANY
    return 1.0 if blocked < LONGEST else THROUGH


@lru_cache(100_000)
def _limit(name: str) -> float:
    """Time (s) for which a blocked road user of this id stands."""
    return BLOCKED + SPREAD * random.Random(name).random()


def force_progress(
    rollouts: ModeRollouts, tolerance: Floats, allowed: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """Mask of the modes that n road users may choose, (n, modes).

    A forced road user (`tolerance` above 0, (n,)) may only choose modes that move, have a collision score below its
    tolerance, and lead no farther off its own surfaces than its slowest mode, or just off these; without such a mode it
    is not forced. With the tolerance ANY, surfaces do not count. `allowed`: mask of the guard; None: all modes. If the
    guard allows no such mode, its mask does not count for this road user, because standing for ever is no solution.
    """
    if not tolerance.any():
        return allowed
    before = np.ones(rollouts.collision.shape, np.bool_) if allowed is None else allowed
    speed = np.ascontiguousarray(rollouts.speed)
    return _force_progress(rollouts.collision, rollouts.off_surface, speed, tolerance, before)


@compiled
def _force_progress(
    collision: Floats, off_surface: Floats, speed: Floats, tolerance: Floats, allowed: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    modes, moving = allowed.copy(), np.empty(allowed.shape[1], np.bool_)
    for row in range(len(tolerance)):
        if tolerance[row] == 0.0:
            continue
        some, both, slowest = False, False, 0
        for mode in range(len(moving)):
            slowest = mode if speed[row, mode] < speed[row, slowest] else slowest
        most = math.inf if tolerance[row] >= ANY else max(off_surface[row, slowest], JUST_OFF)
        for mode in range(len(moving)):
            moving[mode] = speed[row, mode] > MOVING and collision[row, mode] < tolerance[row]
            moving[mode] &= off_surface[row, mode] <= most
            some |= moving[mode]
            both |= moving[mode] and modes[row, mode]
        if some:
            for mode in range(len(moving)):
                modes[row, mode] = moving[mode] and (modes[row, mode] or not both)
    return modes
