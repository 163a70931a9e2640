"""Fit of modes to routes: heading error, lateral offset, speed error, and ratios of stopping distance to distance."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.mode_paths import ModePaths
from slrl_sumo.models.capability import STOPPING, Capability
from slrl_sumo.perception.leaders import BRAKES
from slrl_sumo.perception.route_context import STOP_MARGIN, RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import wrapped
from slrl_sumo.scene.route import on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED

STEERED, PACED = 1, 2
"""Intervals after which the heading of a mode, and its speed, are compared with those of the path. With the heading
after 2 intervals, cars cut tight turns by 0.4 m; with the speed after 1 interval, their motion is twice as jerky."""
TURNING = 1.0
"""Speed (m/s) from which a heading error counts in full: a stopping road user is not on a wrong way."""
RETURN = 1.0
"""Gain (1/s) of the return to the path: beside its path, a road user aims back to it at the angle
atan(RETURN * offset / (speed + SLOW)), SLOW in m/s, at most AIM in rad (as in S. Thrun et al. 2006, Stanley,
https://doi.org/10.1002/rob.20147)."""
SLOW, AIM = 1.5, 0.4
COMFORT_SHARE = 0.5
"""Share of the distance to a stop within which a road user wants to be able to stop."""
AT = 0.3
"""Least distance (m) to a stop in a ratio."""
MAX_RATIO = 8.0
"""Greatest ratio of stopping distance to distance."""
HEADWAY = np.array([1.1, 1.1, 0.5])
"""Headway (s) behind a leader, by type."""
MAX_OFFSET = 5.0
"""Greatest lateral offset (m); larger offsets are clipped."""


class RouteFit(NamedTuple):
    """Fit of the modes of n road users to their routes, (n, modes) each; zeros for road users without a route."""

    heading_error: Floats
    """Angle (rad, not negative) between the heading after STEERED intervals and the heading that leads back to the
    path; scaled down below the speed TURNING, 0 at a stand."""
    lateral_offset: Floats
    """Lateral offset after STEERED intervals, m to the left of the path, within +-MAX_OFFSET."""
    speed_error: Floats
    """Relative difference of the speed after PACED intervals to the allowed speed: -1 at a stand, 1 at twice the
    allowed speed or more. Allowed is the desired speed, or the speed from which the road user can still stop, if that
    is lower."""
    stop_ratio: Floats
    """Stopping distance after one interval over the distance to the stop position; from 1 on, the road user cannot stop
    in time. At most MAX_RATIO."""
    follow_ratio: Floats
    """The same for stopping behind the leader."""
    leader_ratio: Floats
    """Share of `follow_ratio` that the stopping distance of the leader makes up: it over the same distance."""


def route_fit(
    context: RouteContext,
    capability: Capability,
    users: WorldState,
    rows: NDArray[np.intp],
    paths: ModePaths,
    yaw_rate: Floats,
) -> RouteFit:
    """Fit of the modes of n road users to their routes.

    `rows`: rows of the road users in `context`. `users`: their states. `paths`: paths of their modes, before
    `bring_to_paths`. `yaw_rate`: yaw rates of the modes, rad/s, (n, modes).
    """
    route, then = context.route, STEERED - 1
    # Contiguous, so that on_path is compiled for one layout only.
    x, y = np.ascontiguousarray(paths.x[:, then]), np.ascontiguousarray(paths.y[:, then])
    _, offset, direction = on_path(route, x, y, rows)
    heading = users.heading[:, None] + STEERED * DECISION_INTERVAL * yaw_rate
    here = _Here(
        users.type,
        route.known[rows],
        route.desired_speed[rows],
        context.stop_distance[rows],
        context.follow_distance[rows],
        context.follow_speed[rows],
    )
    return _route_fit(here, heading, offset, direction, paths.speed, np.ascontiguousarray(capability.stopping))


def allowed_speed(context: RouteContext, capability: Capability, users: WorldState) -> Floats:
    """Allowed speed (m/s) of each of the n road users of `context`, with the states `users`, (n,).

    The desired speed, or the speed from which the road user stops comfortably where it must, if that is lower.
    """
    here = _Here(
        users.type,
        context.route.known,
        context.route.desired_speed,
        context.stop_distance,
        context.follow_distance,
        context.follow_speed,
    )
    return _allowed_speed(here, users.speed, np.ascontiguousarray(capability.stopping))


class _Here(NamedTuple):
    """State and limits of n road users, (n,) each: see RouteContext."""

    kind: NDArray[np.int8]
    known: NDArray[np.bool_]
    desired: Floats
    stop: Floats
    room: Floats
    leading: Floats


@compiled
def aim(offset: float, speed: float) -> float:
    """Angle (rad) to the right of the path's direction at which a road user `offset` m to the left of the path aims."""
    return min(max(math.atan(RETURN * offset / (speed + SLOW)), -AIM), AIM)


@compiled
def _within(stop: float, room: float, leading: float, alike: float, headway: float) -> float:
    """Distance (m) within which a road user wants to be able to stop with its hardest braking.

    `stop`: distance (m) to the stop position. `room`: distance (m) to the position where the leader stops, from its
    speed `leading` (m/s). `headway`: in m. `alike`: distance (m) in which the ego road user would stop from the
    leader's speed. COMFORT_SHARE does not apply to the leader's stopping distance, because the leader also brakes less
    hard in comfort. The leader counts as braking at least as hard as the ego: otherwise cars, which stop from 14 m/s in
    21 m, would follow a leader with an expected stopping distance of 24 m at 0.7 s instead of their headway of 1.1 s.
    """
    braking = leading * leading / (2.0 * BRAKES)
    return min(COMFORT_SHARE * stop, COMFORT_SHARE * (room - braking - headway) + min(braking, alike))


@compiled
def _ratio(stopping: float, distance: float) -> float:
    """Stopping distance over distance (m): 1 is just possible; at most MAX_RATIO."""
    return min(stopping / max(distance, AT), MAX_RATIO)


@compiled
def _route_fit(
    here: _Here, heading: Floats, offset: Floats, direction: Floats, speeds: Floats, stopping: Floats
) -> RouteFit:
    """`heading`, `offset` and `direction` after STEERED intervals, (n, modes); `speeds` (n, STEPS, modes);
    `stopping`: Capability.stopping."""
    n, modes = heading.shape
    dt = DECISION_INTERVAL
    heading_error, lateral_offset, speed_error = np.zeros((n, modes)), np.zeros((n, modes)), np.zeros((n, modes))
    stop_ratio, follow_ratio, leader_ratio = np.zeros((n, modes)), np.zeros((n, modes)), np.zeros((n, modes))
    for i in range(n):
        if not here.known[i]:
            continue
        wanted, ahead, ways = here.desired[i], here.leading[i], stopping[here.kind[i]]
        fast = slow = 0 * i  # not just 0: see _allowed_speed
        alike, _ = _interpolated(ahead, STOPPING, ways, 0 * i)
        for mode in range(modes):
            first, turned, speed = speeds[i, 0, mode], speeds[i, STEERED - 1, mode], speeds[i, PACED - 1, mode]
            off = heading[i, mode] - direction[i, mode] + aim(offset[i, mode], turned)
            heading_error[i, mode] = abs(wrapped(off)) * min(turned / TURNING, 1.0)
            lateral_offset[i, mode] = min(max(offset[i, mode], -MAX_OFFSET), MAX_OFFSET)
            needed, fast = _interpolated(first, STOPPING, ways, fast)
            left = here.stop[i] - first * dt
            # Past a stop position, any speed is too high: otherwise road users creep over the line at red. The ratio
            # grows with the speed: otherwise a road user that cannot stop at once would not brake.
            creeps = left < -STOP_MARGIN[here.kind[i]] and first > STANDING_SPEED
            late = 0.5 * MAX_RATIO if creeps else 0.0
            stop_ratio[i, mode] = min(late + _ratio(needed, left), MAX_RATIO)
            behind = here.room[i] + (ahead - (1.0 + HEADWAY[here.kind[i]] / dt) * first) * dt
            follow_ratio[i, mode] = _ratio(needed, behind)
            leader_ratio[i, mode] = min(
                _ratio(min(ahead * ahead / (2.0 * BRAKES), alike), behind), follow_ratio[i, mode]
            )
            covered = (first + speed) * dt
            room = here.room[i] + 2.0 * ahead * dt - covered
            within = _within(here.stop[i] - covered, room, ahead, alike, HEADWAY[here.kind[i]] * speed)
            allowed, slow = _interpolated(within, ways, STOPPING, slow)
            allowed = min(allowed, wanted)
            speed_error[i, mode] = min(max((speed - allowed) / max(allowed, 1.0), -1.0), 1.0)
    return RouteFit(heading_error, lateral_offset, speed_error, stop_ratio, follow_ratio, leader_ratio)


@compiled
def _allowed_speed(here: _Here, speed: Floats, stopping: Floats) -> Floats:
    n = len(speed)
    allowed, last = np.empty(n), 0 * n  # not just 0: it would be compiled for that number, then for any
    for i in range(n):
        headway = HEADWAY[here.kind[i]] * speed[i]
        alike, _ = _interpolated(here.leading[i], STOPPING, stopping[here.kind[i]], 0 * i)
        within = max(_within(here.stop[i], here.room[i], here.leading[i], alike, headway), 0.0)
        most, last = _interpolated(within, stopping[here.kind[i]], STOPPING, last)
        allowed[i] = min(most, here.desired[i])
    return allowed


@compiled
def _interpolated(value: float, x: Floats, y: Floats, k: int) -> tuple[float, int]:
    """Like np.interp, but searches from segment `k` on; also returns the segment in which it found the value."""
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
