"""How road users and their modes fit their routes."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.leaders import Leaders
from slrl_sumo.lookahead.mode_rollout import ModeRollouts
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.perception.observation import Way
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

STEERED = 2
"""Intervals after which it is seen whether a mode leads back to the path."""
RETURN = 1.0
"""1/s, and m/s, rad: who is beside its path heads back to it with atan(RETURN * aside / (speed + SLOW)), at most AIM
(as in S. Thrun et al. 2006, Stanley, https://doi.org/10.1002/rob.20147)."""
SLOW, AIM = 1.5, 0.4
CALM = 0.5
"""Share of the way there is within which it wants to be able to stop."""
SPARE = 1.5
"""m before a line to stop at, for who does not stop to the centimetre."""
AT = 0.3
"""m within which somebody is at the place to stop at."""
TOO_MUCH = 8.0
"""At most so many times as much."""
GAP = np.array([1.5, 1.5, 0.4])
"""m that each type keeps behind a leader."""
HEADWAY = 0.5
"""s of it."""
LEADER_BRAKES = 4.0
"""m/s² with which a leader is expected to brake at most."""
FAR_ASIDE = 5.0
"""m beside the path that are told apart at most."""


@dataclass(frozen=True, eq=False)
class RouteFit:
    """How the modes of n road users fit their routes, (n, modes) each; zeros for those without."""

    steer: Floats
    """rad between the heading after STEERED intervals and the one that leads back to the path."""
    aside: Floats
    """m beside the path then."""
    pace: Floats
    """Speed after STEERED intervals relative to the desired one, or to that from which it still stops where it must, if
    that is lower: -1 at none, 1 at twice of it or more."""
    brake: Floats
    """After one interval, the way to a stand relative to the way to where it must stop: from 1 on it is too late. Up to
    TOO_MUCH."""
    follow: Floats
    """The same for who is ahead on the path."""


@dataclass(frozen=True, eq=False)
class RouteContext:
    """What is known of routes when modes are looked at: of the first road users of a world, who are the learned."""

    route: RouteAhead
    leaders: Leaders
    able: Capability

    @property
    def way(self) -> Way:
        """The same as perception has it."""
        return Way(self.route, self.leaders.gap, self.leaders.speed)

    def take(self, rows: NDArray[np.intp]) -> "RouteContext":
        """Those of the learned road users `rows`."""
        return RouteContext(self.route.take(rows), Leaders(self.leaders.gap[rows], self.leaders.speed[rows]), self.able)


def on_route(
    context: RouteContext, users: WorldState, rows: NDArray[np.intp], free: ModeRollouts, yaw_rate: Floats
) -> RouteFit:
    """How the modes of the n road users `rows` of those with `context`, whose states are `users`, fit their routes.

    `free`: the courses of their modes; `yaw_rate`: of the modes, rad/s, (n, modes).
    """
    route, then = context.route, STEERED - 1
    # Contiguous, so that it is compiled for nothing else.
    x, y = np.ascontiguousarray(free.x[:, then]), np.ascontiguousarray(free.y[:, then])
    _, aside, direction = on_path(route, x, y, rows)
    stop, room = ways_left(context, users, rows)
    ends = users.heading[:, None] + STEERED * DECISION_INTERVAL * yaw_rate
    able = np.ascontiguousarray(context.able.stopping)
    leading = context.leaders.speed
    columns = _on_route(
        ends,
        free.speed,
        aside,
        direction,
        users.type,
        rows,
        route.known,
        route.desired,
        leading,
        stop,
        room,
        able,
        STOPPING,
        DECISION_INTERVAL,
    )
    return RouteFit(*columns)


def allowed_speed(context: RouteContext, users: WorldState) -> Floats:
    """m/s at which each of n road users with a route may go on: desired, and low enough to stop where it must, (n,)."""
    stop, room = ways_left(context, users, np.arange(len(users)))
    able = np.ascontiguousarray(context.able.stopping)
    return _allowed_speed(stop, room, users.speed, users.type, context.route.desired, able, STOPPING)


def ways_left(context: RouteContext, users: WorldState, rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """m to where the n road users `rows` of those with `context`, whose states are `users`, must stop, and m in which
    they must be able to stop behind their leaders, (n,) each.

    They stop where their routes say, and before junctions whose exits are taken.
    """
    route, leaders = context.route, context.leaders
    # What other modules say must not be a constant of the compiled function.
    car = int(RoadUserType.CAR)
    return _ways_left(
        users.type, users.length, rows, route.stop, route.line, route.out, leaders.gap, leaders.speed, GAP, car
    )


@compiled
def strain(stopping: float, distance: float) -> float:
    """The way to a stand (m) relative to the way there is (m): 1 is just possible; up to TOO_MUCH."""
    return min(stopping / max(distance, AT), TOO_MUCH)


@compiled
def _on_route(
    ends: Floats,
    speeds: Floats,
    aside: Floats,
    direction: Floats,
    kind: NDArray[np.int8],
    rows: NDArray[np.intp],
    known: NDArray[np.bool_],
    desired: Floats,
    leading: Floats,
    stop: Floats,
    room: Floats,
    able: Floats,
    braking: Floats,
    dt: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """The fields of RouteFit; `ends`: headings after STEERED intervals, (n, modes); `able`: Capability.stopping, of the
    speeds `braking`; `known`, `desired` and `leading` of all with context."""
    n, modes = ends.shape
    steer, beside, pace = np.zeros((n, modes)), np.zeros((n, modes)), np.zeros((n, modes))
    brake, follow = np.zeros((n, modes)), np.zeros((n, modes))
    for i in range(n):
        row, one = rows[i], kind[i]
        if not known[row]:
            continue
        wanted, ahead, ways = desired[row], leading[row], able[one]
        fast = slow = 0 * i  # not just 0: see _allowed_speed
        for mode in range(modes):
            first, speed = speeds[i, 0, mode], speeds[i, STEERED - 1, mode]
            aim = math.atan(RETURN * aside[i, mode] / (speed + SLOW))
            off = ends[i, mode] - direction[i, mode] + min(max(aim, -AIM), AIM)
            steer[i, mode] = abs(off - 2.0 * math.pi * math.ceil((off - math.pi) / (2.0 * math.pi)))
            beside[i, mode] = min(max(aside[i, mode], -FAR_ASIDE), FAR_ASIDE)
            stopping, fast = _interpolated(first, braking, ways, fast)
            brake[i, mode] = strain(stopping, stop[i] - first * dt)
            follow[i, mode] = strain(stopping, room[i] + (ahead - (1.0 + HEADWAY / dt) * first) * dt)
            covered = (first + speed) * dt
            within = min(stop[i], room[i] + 2.0 * ahead * dt - HEADWAY * speed) - covered
            allowed, slow = _interpolated(CALM * within, ways, braking, slow)
            allowed = min(allowed, wanted)
            pace[i, mode] = min(max((speed - allowed) / max(allowed, 1.0), -1.0), 1.0)
    return steer, beside, pace, brake, follow


@compiled
def _allowed_speed(
    stop: Floats,
    room: Floats,
    speed: Floats,
    kind: NDArray[np.int8],
    desired: Floats,
    able: Floats,
    braking: Floats,
) -> Floats:
    allowed, last = np.empty(len(stop)), 0 * len(stop)  # not just 0: it would be compiled for that number, then for any
    for i in range(len(stop)):
        within = CALM * max(min(stop[i], room[i] - HEADWAY * speed[i]), 0.0)
        most, last = _interpolated(within, able[kind[i]], braking, last)
        allowed[i] = min(most, desired[i])
    return allowed


@compiled
def _ways_left(
    kind: NDArray[np.int8],
    length: Floats,
    rows: NDArray[np.intp],
    stop: Floats,
    line: Floats,
    out: Floats,
    gap: Floats,
    leading: Floats,
    behind: Floats,
    car: int,
) -> tuple[Floats, Floats]:
    """`ways_left` of the columns of RouteAhead and Leaders, of which `rows` count."""
    n = len(rows)
    must, room = np.empty(n), np.empty(n)
    for i in range(n):
        row = rows[i]
        must[i] = stop[row] - SPARE
        stands_there = leading[row] < 1.0 and line[row] < gap[row] < out[row] + length[i] + behind[car]
        if stands_there and 1.0 < line[row] < np.inf and out[row] < np.inf:
            must[i] = min(stop[row], line[row] - 1.0) - SPARE
        room[i] = gap[row] - behind[kind[i]] + leading[row] ** 2 / (2.0 * LEADER_BRAKES)
    return must, room


@compiled
def _interpolated(value: float, x: Floats, y: Floats, k: int) -> tuple[float, int]:
    """np.interp, looking from piece `k` on; with the piece in which it was found."""
    last = len(x) - 1
    if not value < x[last]:
        return y[last], k
    if value <= x[0]:
        return y[0], k
    while x[k] > value:
        k -= 1
    while x[k + 1] <= value:
        k += 1
    return y[k] + (y[k + 1] - y[k]) / (x[k + 1] - x[k]) * (value - x[k]), k
