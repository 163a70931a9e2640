"""Lane changes with cooperation: gaps in the next lane, and speeds that make room for a change.

The changing vehicle adapts its speed to its future leader in the next lane, and the vehicle behind the gap, its future
follower, makes room. A vehicle that overlaps the changing vehicle along the lane goes first, so that two vehicles never
wait for each other.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.routing.next_lane import FAR_SIGHT, NextLane, lane_positions
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import apart
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN

BESIDE, BEYOND = 0.6, 1.2
"""Lateral bounds of the next lane: m from the centre of the changing vehicle, and m beyond the lane's centre line."""
MARGIN, HURRIED_MARGIN = 2.5, 1.0
"""Least gap (m) to the leader and to the follower in the next lane; the second value within HURRY."""
CLOSING, HURRIED_CLOSING = 1.5, 0.6
"""Time (s) at the speed difference that the gap needs in addition, until the faster vehicle brakes."""
BRAKES = 4.0
"""Deceleration (m/s²) with which the faster vehicle then adapts to the speed of the slower vehicle."""
HURRY = 50.0
"""Distance (m) to the end of its lane below which a vehicle accepts smaller gaps."""
SOON = 10.0, 100.0
"""Time (s) and distance (m) before the end of a lane, whichever is longer, from which other vehicles make room."""
HEADWAY = 1.1
"""Desired headway (s) to the leader in the next lane, as behind any leader (lookahead.route_fit)."""
STANDING_GAP = 1.5
"""Desired gap (m) at a stand."""
RELAXATION = 3.0
"""Time (s) in which a vehicle corrects its gap."""
EASY = 1.5
"""Greatest deceleration (m/s²) of a vehicle that makes room or seeks a gap."""
ACTS_IN = 0.8
"""Time (s) until the allowed speed is compared with the speed of a mode (lookahead.route_fit)."""
GAIN, PAUSE = 2.0, 6.0
"""Least gain of speed (m/s) for which vehicles overtake, and least time (s) between two lane changes."""
KEEPS_RIGHT = 15.0
"""Desired speed (m/s) from which a vehicle returns towards the kerb, in left-hand traffic to the left. Slower vehicles,
such as on city streets, choose their lane freely."""
FORESEEN = 4.0
"""Time (s) for which a leader is expected to keep its acceleration: a vehicle does not overtake a leader that starts at
a signal."""
STEADY = 0.5
"""Deceleration (m/s²) above which a leader brakes for a reason farther ahead, which holds for the next lane, too."""
FAR = 30.0, 300.0
"""Time (s) and distance (m) before the end of its lane, whichever is longer, from which a vehicle seeks the lane that
its route needs; farther away it overtakes on any lane."""
CHANGES_WITHIN = 4.0, 50.0
"""Time (s), and at most this distance (m), before the end of its lane within which a vehicle does not start to
overtake."""
QUEUED, SHORTER = 2.0, 12.0
"""Speed (m/s) below which a leader is in a queue, and least advantage (m, two cars) of the queue in the next lane; the
lane change needs the same distance before the queue."""
SETTLES = 4.0
"""Time (s) for which a vehicle stays on its lane after its insertion. At a motorway junction (A10KW), nearly all
collisions at lane changes were with vehicles that SUMO had just inserted on the other lane."""
HALF_LANE = 1.7
"""Half the width (m) of a lane."""
SIGHT = 60.0
"""Distance (m) ahead and behind within which vehicles cooperate."""


class LaneChange(NamedTuple):
    """A lane change that is under way, or for which a vehicle waits for a gap."""

    row: int
    """Row of the vehicle in the world."""
    lateral_offset: float
    """Position of the vehicle, m to the left of the centre line of the next lane."""
    direction: float
    """Direction (rad) of the next lane; the vehicle may still be turning, such as at the end of a ramp."""
    left: float
    """Distance (m) to the end of the present lane; 0 during the change."""
    lane: NextLane
    elsewhere: tuple[int, ...] = ()
    """Rows of vehicles in a junction that reach another lane of the edge than the next lane; they may cross the way to
    it. If one of these counted, it and the changing vehicle waited for each other."""


class _Around(NamedTuple):
    """Positions of all m road users of a world relative to the changing vehicle, (m,) each."""

    in_lane: NDArray[np.bool_]
    """Whether the road user is in the next lane."""
    ahead: Floats
    """Distance (m) along the lane from the centre of the changing vehicle to the centre of the road user."""
    clear: Floats
    """Gap (m) between the two boxes along the lane; negative if they overlap."""


def is_soon(left: float, speed: float) -> bool:
    """Whether a vehicle at `speed` (m/s), `left` m before the end of its lane, is so near that others make room."""
    return left <= max(SOON[0] * speed, SOON[1])


def is_far(left: float, speed: float) -> bool:
    """Whether a vehicle at `speed` (m/s), `left` m before the end of its lane, may use any lane."""
    return left > max(FAR[0] * speed, FAR[1])


def has_gap(world: WorldState, change: LaneChange, entering: Sequence[int] = (), levels: Levels = FLAT) -> bool:
    """Whether the gap in the next lane suffices; `entering`: rows of other vehicles that are changing to that lane."""
    around, speed = _around(world, change, levels), world.speed[change.row]
    around.in_lane[list(entering)] = True
    faster = np.maximum(np.where(around.ahead > 0, speed - world.speed, world.speed - speed), 0.0)
    hurried = change.left < HURRY
    margin, closing = (HURRIED_MARGIN, HURRIED_CLOSING) if hurried else (MARGIN, CLOSING)
    needed = margin + closing * faster + faster**2 / (2.0 * BRAKES)
    return bool(np.all(around.clear[around.in_lane] > needed[around.in_lane]))


def faster_there(
    world: WorldState, change: LaneChange, desired: float, levels: Levels = FLAT, *, back: bool = False
) -> bool:
    """Whether the next lane is better for a vehicle with the desired speed `desired` (m/s).

    That is so if a leader slows the vehicle down and the next lane is faster. `back`: the next lane is nearer to the
    kerb; a fast vehicle then also changes if no leader slows it down there.
    """
    there = min(_foreseen(*_ahead(world, change, -change.lateral_offset, levels)), desired)
    if back and desired >= KEEPS_RIGHT:
        return there > desired - 0.5 * GAIN
    speed, acceleration = _ahead(world, change, 0.0, levels)
    here = desired if acceleration < -STEADY else min(_foreseen(speed, acceleration), desired)
    return there > here + GAIN


def shorter_queue(world: WorldState, change: LaneChange, left: float, levels: Levels = FLAT) -> bool:
    """Whether a queue before the end of the present lane, `left` m ahead, is longer than the queue in the next lane."""
    here, there = (_queue(world, change, aside, levels) for aside in (0.0, -change.lateral_offset))
    return here > SHORTER and min(there, left) > here + SHORTER


def _ahead(world: WorldState, change: LaneChange, aside: float, levels: Levels) -> tuple[float, float]:
    """Speed (m/s) and acceleration (m/s²) of the leader within FAR_SIGHT on the line `aside` m to the left; inf and 0
    without a leader."""
    rows, along = _in_lane_ahead(world, change, aside, levels)
    if not len(rows):
        return math.inf, 0.0
    row = rows[along.argmin()]
    return world.speed.item(row), world.acceleration.item(row)


def _foreseen(speed: float, acceleration: float) -> float:
    """Speed (m/s) after FORESEEN, if a vehicle keeps its acceleration."""
    return speed + FORESEEN * max(acceleration, 0.0)


def _queue(world: WorldState, change: LaneChange, aside: float, levels: Levels) -> float:
    """Distance (m) to the next queued vehicle within FAR_SIGHT on the line `aside` m to the left; inf without one."""
    rows, along = _in_lane_ahead(world, change, aside, levels)
    return float(np.min(along[world.speed[rows] < QUEUED], initial=math.inf))


def _in_lane_ahead(
    world: WorldState, change: LaneChange, aside: float, levels: Levels
) -> tuple[NDArray[np.intp], Floats]:
    """Rows of the road users within FAR_SIGHT on the line `aside` m to the left, and distances (m), (k,) each."""
    along, across, _ = lane_positions(change.lane, world, change.row)
    rows = np.flatnonzero((along > 0.0) & (along < FAR_SIGHT) & (np.abs(across - aside) < HALF_LANE))
    rows = _on_the_level(levels, world, change, rows)
    return rows, along[rows]


def cooperative_speeds(world: WorldState, n: int, lane_changes: Sequence[LaneChange], levels: Levels = FLAT) -> Floats:
    """Speeds (m/s), (n,), with which the first `n` road users of `world` cooperate in lane changes; inf without need.

    A changing vehicle adapts to its future leader, and the future follower makes room.
    """
    allowed = np.full(n, math.inf)
    rows = {change.row for change in lane_changes}
    for change in lane_changes:
        i, speed = change.row, world.speed.item(change.row)
        if not is_soon(change.left, speed):
            continue
        around = _around(world, change, levels)
        near = np.flatnonzero(around.in_lane & (np.abs(around.ahead) < SIGHT))
        # A vehicle that has stopped too close behind cannot make room any more: it goes first. Else both would stand.
        room = around.clear > HURRIED_MARGIN
        behind = [j for j in near.tolist() if around.ahead[j] < 0.0 and room[j]]
        # If two vehicles side by side want each other's lane, the vehicle in front goes first.
        before = [j for j in near.tolist() if not (around.ahead[j] < 0.0 and (room[j] or j in rows))]
        if before:
            j = min(before, key=lambda k: around.ahead[k])
            allowed[i] = min(allowed[i], _following(speed, world.speed.item(j), around.clear.item(j)))
        if behind:
            j = max(behind, key=lambda k: around.ahead[k])
            if j < n:
                allowed[j] = min(allowed[j], _following(world.speed.item(j), speed, around.clear.item(j)))
    return allowed


def _on_the_level(levels: Levels, world: WorldState, change: LaneChange, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The `rows` of road users that are on the same level as the changing vehicle, not above or below it."""
    if not len(levels.x):
        return rows
    x, y, cos, sin = world.x[rows], world.y[rows], np.cos(world.heading[rows]), np.sin(world.heading[rows])
    c, s = math.cos(change.direction), math.sin(change.direction)
    theirs = zip(x.tolist(), y.tolist(), cos.tolist(), sin.tolist(), strict=True)
    return rows[np.array([not apart(levels, *place[:2], c, s, *place) for place in theirs], np.bool_)]


def _around(world: WorldState, change: LaneChange, levels: Levels) -> _Around:
    row, lateral_offset = change.row, change.lateral_offset
    along, across, directions = lane_positions(change.lane, world, row)
    same_way = (np.cos(world.heading - directions) > 0.5) & (world.type != PEDESTRIAN)
    # From just beside the vehicle to the far edge of the wanted lane.
    low, high = sorted(
        (-math.copysign(BESIDE, lateral_offset), -lateral_offset - math.copysign(BEYOND, lateral_offset))
    )
    in_lane = (across > low) & (across < high) & same_way
    in_lane[[row, *change.elsewhere]] = False
    rows = np.flatnonzero(in_lane)
    in_lane[rows] = np.isin(rows, _on_the_level(levels, world, change, rows))
    return _Around(in_lane, along, np.abs(along) - 0.5 * (world.length + world.length[row]))


def _following(speed: float, leading: float, gap: float) -> float:
    """Speed (m/s) with which a vehicle at `speed` approaches its desired headway behind a leader at the speed
    `leading`, `gap` m ahead."""
    wanted = leading + (gap - STANDING_GAP - HEADWAY * speed) / RELAXATION
    return max(wanted, speed - EASY * ACTS_IN, 0.0)
