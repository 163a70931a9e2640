"""Positions of learned road users on their routes, and the leaders and stops that limit them there."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.perception.leaders import Leaders, leaders
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.route import RouteAhead, on_path
from slrl_sumo.scene.state import WorldState

STOP_MARGIN = np.array([1.5, 1.5, 0.2])
"""Distance (m) kept before a stop position, by type: road users do not stop to the centimetre."""
GAP = np.array([1.5, 1.5, 0.4])
"""Gap (m) kept behind a leader, by type."""
SAME_WAY = 0.7
"""Least cosine (45 degrees) between the directions of a vehicle and of its leader in a queue."""
QUEUE = 8
"""Number of road users, one behind the other, whose stops are predicted."""
NEAR, LONGEST = 5.0, 200
"""Distance (m) to a stop within which a road user may be part of a circle of waiting road users, and the greatest
number of road users in such a circle."""
BEFORE = 1.0
"""Distance (m) before its line at which a vehicle keeps a junction clear."""


@dataclass(frozen=True, eq=False)
class RouteContext:
    """The routes of n learned road users, the first rows of a world; all arrays but `in_way` are (n,)."""

    route: RouteAhead
    along: Floats
    """Position (m along the own path) of the place nearest to the road user; inside a corner it may differ from 0."""
    lateral_offset: Floats
    """Lateral offset, m to the left of the own path."""
    direction: Floats
    """Direction (rad) of the own path beside the road user."""
    leader_gap: Floats
    """Gap (m) to the leader along the path; inf without a leader within sight."""
    leader_speed: Floats
    """Speed (m/s) of the leader along the path."""
    queues: NDArray[np.bool_]
    """The leader has the same direction and does not wait for the road user in turn: a queue, which only the leader's
    start can dissolve."""
    stop_distance: Floats
    """Distance (m) to where the road user must stop: a stop line, or a junction whose exit is taken."""
    follow_distance: Floats
    """Distance (m) within which the road user must be able to stop behind road users on its path."""
    follow_speed: Floats
    """Speed (m/s) of the road user that sets `follow_distance`; it need not be the leader (see
    perception.leaders.Leaders)."""
    in_way: NDArray[np.int64]
    """Pairs of vehicles and road users in their way (see perception.leaders.Leaders), (p,)."""

    def __len__(self) -> int:
        return len(self.route)

    def take(self, rows: NDArray[np.intp]) -> "RouteContext":
        """The entries of the road users `rows`."""
        arrays = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name not in ("route", "in_way")}
        return RouteContext(self.route.take(rows), in_way=self.in_way, **arrays)


def route_context(
    route: RouteAhead, world: WorldState, threads: RowThreads = ONE, levels: Levels = FLAT
) -> RouteContext:
    """Project the first road users of `world`, one for each row of `route`, onto their paths; find their leaders."""
    n = len(route)
    along, lateral_offset, direction = on_path(route, world.x[:n, None], world.y[:n, None])
    found = leaders(route, world, lateral_offset[:, 0], threads, levels)
    stop, follow = stop_distances(route, world, found)
    queues = _queues(found.row, world.heading, direction[:, 0])
    return RouteContext(
        route, along[:, 0], lateral_offset[:, 0], direction[:, 0], found.gap, found.speed, queues, stop, follow,
        found.stop_speed, found.in_way,
    )  # fmt: skip


def _queues(leader: NDArray[np.int64], heading: Floats, direction: Floats) -> NDArray[np.bool_]:
    """`RouteContext.queues` of n road users; `leader`: row of each leader (-1: none), `direction`: of each path."""
    n = len(leader)
    theirs = np.append(leader, np.full(len(heading) - n, -1))[leader]
    same_way = np.cos(heading[leader] - direction) > SAME_WAY
    return np.asarray((leader >= 0) & same_way & (theirs != np.arange(n)))


def stop_distances(route: RouteAhead, world: WorldState, ahead: Leaders) -> tuple[Floats, Floats]:
    """`RouteContext.stop_distance` and `follow_distance`, (n,) each, of the first road users of `world`.

    These are the road users of `route`; `ahead`: their leaders.
    """
    n = len(route)
    lines = route.stop, route.keep_clear_line, route.keep_clear_exit, route.waiting_position
    return _stop_distances(world.type[:n], world.length[:n], *lines, ahead.gap, ahead.speed, ahead.row, ahead.stop)


@compiled
def _stop_distances(
    kind: NDArray[np.int8],
    length: Floats,
    stop: Floats,
    keep: Floats,
    out: Floats,
    wait: Floats,
    gap: Floats,
    leading: Floats,
    leader: NDArray[np.int64],
    ahead: Floats,
) -> tuple[Floats, Floats]:
    n = len(kind)
    must, room, stand, waits = np.empty(n), np.empty(n), stop.copy(), np.zeros(n, np.bool_)
    # Predict where each road user will come to a stop: at its line, behind a leader that stands or will stand, or
    # before a junction whose exit is then taken.
    for _ in range(QUEUE):
        for i in range(n):
            if leader[i] < 0:
                continue
            later = 0.0 if leading[i] < 1.0 else (stand[leader[i]] if leader[i] < n else np.inf)
            behind = max(gap[i] - GAP[kind[i]], 0.0) + max(later, 0.0)
            stand[i] = min(stop[i], behind)
            # A stop inside the junction, as before a left turn, is temporary: the room behind the leader decides.
            line = np.inf if keep[i] < stop[i] < out[i] else stop[i]
            waits[i] = _exit_taken(min(line, behind), line, keep[i], out[i], wait[i], length[i])
            if waits[i]:
                stand[i] = keep[i] - BEFORE
    for i in range(n):
        keeps = waits[i] and not (stand[i] < NEAR and _in_circle(i, leader, leading))
        must[i] = (stand[i] if keeps else stop[i]) - STOP_MARGIN[kind[i]]
        room[i] = ahead[i] - GAP[kind[i]]
    return must, room


@compiled
def _in_circle(first: int, leader: NDArray[np.int64], leading: Floats) -> bool:
    """Whether the chain of leaders from a road user leads back to it, with all leaders slower than 1 m/s.

    In such a circle, no road user can move unless each one uses the room before it.
    """
    row = first
    for _ in range(LONGEST):
        if leader[row] < 0 or leader[row] >= len(leader) or leading[row] >= 1.0:
            return False
        row = leader[row]
        if row == first:
            return True
    return False


@compiled
def _exit_taken(stand: float, stop: float, keep: float, out: float, wait: float, length: float) -> bool:
    """Whether a vehicle that will stop `stand` m ahead would stand in a junction that it must keep clear.

    This includes standing in it with the rear only. Other arguments: see RouteAhead.
    """
    taken = keep < stand < min(out + length, stop)
    # Before a waiting position inside the junction, there may be room for the whole vehicle.
    taken &= not keep + length <= stand <= wait
    return bool(taken and BEFORE < keep < np.inf and out < np.inf)
